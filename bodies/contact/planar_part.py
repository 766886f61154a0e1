"""A built contact of bodies in the plane: its loads and histories along a known motion."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.contact.part import ContactPart, Motion, steps
from sparsemor.bodies.contact.path import Path
from sparsemor.bodies.contact.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.quadrature import gauss
from sparsemor.bodies.contact.resultants import Resultants
from sparsemor.bodies.contact.side import Side
from sparsemor.bodies.contact.surface import Surface, plane
from sparsemor.bodies.contact.term import ContactTerm
from sparsemor.bodies.contact.tractions import Interface, nodal
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.stage import SurfaceLoads

AT_ONCE = 200
"""Times that are evaluated together: memory for a few MB of pairs."""
IMPORTED = 8
"""Least number of Gauss points a piece for tabled loads."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanarContact(ContactPart[Surface]):
    """In the plane: see `ContactPart`."""

    def _term(
        self, layout: Layout, motion: Motion, face: Interface, *, moves: bool, deforms: bool,
        conducts: bool,
    ) -> ContactTerm:
        first, second = (
            Side.of(s, layout, moves=moves, deforms=deforms, conducts=conducts,
                    motion=motion.get(s.body.name)) for s in (self.first, self.second))
        return ContactTerm.of((first, second), face, self.near, deforms, self.reach)

    def _pressed(self, motion: Motion) -> bool:
        return bool(self.history(motion)["pressure"].any())

    def _points(self, motion: Motion) -> Callable[[slice], tuple[FloatArray, FloatArray]]:
        a, b = (Path(s, motion) for s in (self.first, self.second))
        return lambda now: (plane(a.points(now)[0][0]), plane(b.points(now)[0][0]))

    def imported(self, motion: Motion) -> Mapping[str, SurfaceLoads]:
        a, b = (Path(s, motion) for s in (self.first, self.second))
        times, sides = steps(motion), (a, b)
        force = [np.zeros((times, len(p.surface.nodes)), complex) for p in sides]
        heat = [np.zeros((times, len(p.surface.nodes))) for p in sides]
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
                p.surface.nodes, plane(f * p.turned(slice(0, times)).conj()), h)
            for p, f, h in zip(sides, force, heat, strict=True)}

    def history(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Resultants at the times (T,) of the motion (see `Resultants`)."""
        summed = Resultants(steps(motion))
        a, b = (Path(s, motion) for s in (self.first, self.second))
        for m in self._meetings(a, b, self.face):
            summed.add(m.time, m.overlaps, m.pieces, self.face)
        return summed.found()

    def _meetings(self, a: Path, b: Path, face: Interface) -> Iterator["_Meeting"]:
        """Pieces in contact at some of the times at once."""
        i, j = self.first.facets, self.second.facets
        times = max(a.steps, b.steps)
        for begin in range(0, times, AT_ONCE):
            now = slice(begin, min(begin + AT_ONCE, times))
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
