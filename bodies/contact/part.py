"""A built contact: its term inside the step, and its loads and histories along a known motion."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.quadrature import gauss
from sparsemor.bodies.contact.restless import unsettled
from sparsemor.bodies.contact.resultants import Resultants
from sparsemor.bodies.contact.side import Side
from sparsemor.bodies.contact.surface import Surface, plane
from sparsemor.bodies.contact.term import ContactTerm
from sparsemor.bodies.contact.tractions import Interface, nodal
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.stage import FrameHistory, SurfaceLoads

AT_ONCE = 200
"""Times that are evaluated together: memory for a few MB of pairs."""
IMPORTED = 8
"""Least number of Gauss points a piece for tabled loads."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactPart:
    """reach: deepest penetration (m) that is followed; deforms: surfaces move with the
    displacements; heats: friction heat and conduction enter the bodies that have temperatures."""

    name: str
    first: Surface
    second: Surface
    face: Interface
    near: Near
    reach: float
    deforms: bool
    heats: bool
    localized: bool = True
    moving: bool = True

    def blocks(self) -> Sequence[Block]:
        return ()

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        """The contact inside the step, at the unknowns of the layout."""
        sides = [Side.of(s, layout, moves=True, deforms=self.deforms, conducts=self.heats)
                 for s in (self.first, self.second)]
        term = ContactTerm.of(
            (sides[0], sides[1]), self.face, self.near, self.deforms, self.reach)
        return [term] if len(term.rows) else []

    def conduction(
        self, layout: Layout, motion: Mapping[str, FrameHistory]
    ) -> Sequence[Term]:
        """Conduction between surfaces whose frames move as told; friction heat is not in it."""
        if self.face.conductance == 0:
            return []
        sides = [Side.of(s, layout, moves=False, deforms=False, conducts=True,
                         motion=motion.get(s.body.name)) for s in (self.first, self.second)]
        face = replace(self.face, friction=None)
        term = ContactTerm.of((sides[0], sides[1]), face, self.near, False, self.reach)
        return [term] if len(term.rows) else []

    def missed(self, motion: Mapping[str, FrameHistory]) -> str:
        """What a user should know when the surfaces never met; "" when they did."""
        pressed = bool(self.history(motion)["pressure"].any())
        gap = 0.0 if pressed else self._closest(motion)
        if gap <= (self.reach if self.deforms else 0.0):
            return ""
        one, other = self.first.body.name, self.second.body.name
        return (f"contact {self.name}: the surfaces of {one} and {other} never met; the nearest "
                f"they came is {gap:.3g} m: check the poses, and that the sets name the sides that "
                "face each other")

    def unsettled(self, history: Mapping[str, FloatArray]) -> str:
        """What a user should know of the contact's history at the steps of a run; "" if nothing."""
        return unsettled(self.name, history["normal"])

    def _closest(self, motion: Mapping[str, FrameHistory]) -> float:
        """Smallest distance of a point of either surface from the other, at 100 of the times."""
        a, b = (_Path(s, motion) for s in (self.first, self.second))
        found = np.inf
        for k in np.unique(np.linspace(0, _steps(motion) - 1, 100).astype(int)):
            now = slice(k, k + 1)
            za, zb = (plane(p.points(now)[0][0]) for p in (a, b))
            for z, corners in ((za, zb[self.second.facets]), (zb, za[self.first.facets])):
                found = min(found, float(nearest(z, corners).distance.min()))
        return found

    # ------------------------------------------------------------------ along a known motion

    def imported(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, SurfaceLoads]:
        """Body -> nodal forces in its own axes (N) and nodal friction heat (W) at each time."""
        a, b = (_Path(s, motion) for s in (self.first, self.second))
        steps, sides = _steps(motion), (a, b)
        force = [np.zeros((steps, len(p.surface.nodes)), complex) for p in sides]
        heat = [np.zeros((steps, len(p.surface.nodes))) for p in sides]
        points, weights = gauss(max(IMPORTED, len(self.face.points)))
        face = replace(self.face, conductance=0.0, points=points, weights=weights)
        for m in self._meetings(a, b, face):
            f, h, _ = nodal(m.overlaps, m.pieces, face, None)
            if not self.heats:
                h = np.zeros_like(h)
            for side, ends in enumerate((slice(0, 2), slice(2, 4))):
                where = m.time[:, None], m.nodes[:, ends]
                np.add.at(force[side], where, f[:, ends])
                np.add.at(heat[side], where, h[:, ends])
        return {
            p.surface.body.name: SurfaceLoads(
                p.surface.nodes, plane(f * p.turned(slice(0, steps)).conj()), h)
            for p, f, h in zip(sides, force, heat, strict=True)}

    def history(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, FloatArray]:
        """Resultants at the times (T,) of the motion (see `Resultants`)."""
        summed = Resultants(_steps(motion))
        a, b = (_Path(s, motion) for s in (self.first, self.second))
        for m in self._meetings(a, b, self.face):
            summed.add(m.time, m.overlaps, m.pieces, self.face)
        return summed.found()

    def _meetings(self, a: "_Path", b: "_Path", face: Interface) -> Iterator["_Meeting"]:
        """Pieces in contact at some of the times at once."""
        i, j = self.first.facets, self.second.facets
        steps = max(a.steps, b.steps)
        for begin in range(0, steps, AT_ONCE):
            now = slice(begin, min(begin + AT_ONCE, steps))
            (za, va), (zb, vb) = a.points(now), b.points(now)
            seen = (za - b.origin(now)) * b.turned(now).conj()
            middles = seen[:, i].mean(axis=2)
            here, g = self.near.pairs(plane(middles.ravel()), self.second.tree)
            k, f = np.divmod(here, len(i))
            k1, k2 = k[:, None] % len(za), k[:, None] % len(zb)
            pairs = Pairs(np.concatenate([za[k1, i[f]], zb[k2, j[g]]], axis=1),
                          np.concatenate([va[k1, i[f]], vb[k2, j[g]]], axis=1),
                          self.second.turns[g])
            o, kept = Overlaps.of(pairs)
            pieces = Pieces.cut(o, face.normal, face.friction)
            of = kept[pieces.of]
            nodes = np.concatenate([i[f[of]], j[g[of]]], axis=1)
            yield _Meeting(begin + k[of], nodes, o, pieces)


@dataclass(frozen=True, slots=True, eq=False)
class _Meeting:
    """time (N,) number and nodes (N, 4) of each piece, two of either surface."""

    time: IntArray
    nodes: IntArray
    overlaps: Overlaps
    pieces: Pieces


class _Path:
    """A rigid surface along a motion; one row for all times where the body stands still."""

    def __init__(self, surface: Surface, motion: Mapping[str, FrameHistory]) -> None:
        self.surface, history = surface, motion.get(surface.body.name)
        self.pose = surface.body.pose[None] if history is None else history.pose
        self.rate = np.zeros((1, 3)) if history is None else history.rate
        self.steps = len(self.pose)

    def _rows(self, values: FloatArray, now: slice) -> FloatArray:
        return values[now] if self.steps > 1 else values

    def origin(self, now: slice) -> ComplexArray:
        pose = self._rows(self.pose, now)
        return np.asarray(pose[:, :1] + 1j * pose[:, 1:2])

    def turned(self, now: slice) -> ComplexArray:
        """(T, 1) exp(i theta)."""
        return np.asarray(np.exp(1j * self._rows(self.pose, now)[:, 2:]))

    def points(self, now: slice) -> tuple[ComplexArray, ComplexArray]:
        """Positions and velocities (T, n)."""
        rate = self._rows(self.rate, now)
        r = self.turned(now) * self.surface.X
        v = rate[:, :1] + 1j * rate[:, 1:2] + 1j * rate[:, 2:] * r
        return self.origin(now) + r, v


def _steps(motion: Mapping[str, FrameHistory]) -> int:
    return max((len(h.times) for h in motion.values()), default=1)
