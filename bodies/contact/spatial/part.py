"""A built contact of bodies in space: its loads and histories along a known motion."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.spatial.meetings import Meeting, meetings
from sparsemor.bodies.contact.spatial.path import Path, seen, steps
from sparsemor.bodies.contact.spatial.pieces import pressure
from sparsemor.bodies.contact.spatial.side import Side
from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.bodies.contact.spatial.term import SpatialContactTerm
from sparsemor.bodies.contact.spatial.tractions import nodal
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.stage import FrameHistory, SurfaceLoads


@dataclass(frozen=True, slots=True, eq=False)
class SpatialContact:
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
        term = SpatialContactTerm.of(
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
        term = SpatialContactTerm.of((sides[0], sides[1]), face, self.near, False, self.reach)
        return [term] if len(term.rows) else []

    def missed(self, motion: Mapping[str, FrameHistory]) -> str:
        """What a user should know when the surfaces never met; "" when they did."""
        gap = 0.0 if any(map(self._presses, self._meetings(motion))) else self._closest(motion)
        if gap <= (self.reach if self.deforms else 0.0):
            return ""
        one, other = self.first.body.name, self.second.body.name
        return (f"contact {self.name}: the surfaces of {one} and {other} never met; the nearest "
                f"they came is {gap:.3g} m: check the poses, and that the sets name the sides that "
                "face each other")

    def _presses(self, m: Meeting) -> bool:
        return bool((pressure(m.overlaps, m.pieces.of, m.pieces.polygons.places,
                              self.face.normal) > 0).any())

    def _closest(self, motion: Mapping[str, FrameHistory]) -> float:
        """Smallest distance of a point of either surface from the other, at 100 of the times."""
        one, other = Path(self.first, motion), Path(self.second, motion)
        found = np.inf
        for k in np.unique(np.linspace(0, steps(motion) - 1, 100).astype(int)):
            z, _ = seen(one, other, self.first.X, slice(k, k + 1))
            back = ((z[0], self.second.X[self.second.facets]),
                    (self.second.X, z[0][self.first.facets]))
            found = min(found, *(float(nearest(p, q).distance.min()) for p, q in back))
        return found

    # ------------------------------------------------------------------ along a known motion

    def imported(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, SurfaceLoads]:
        """Body -> nodal forces in its own axes (N) and nodal friction heat (W) at each time, on
        the points that are touched at any of them (all, where none is)."""
        n = len(self.first.nodes), len(self.second.nodes)
        made = _Sums(n[0]), _Sums(n[1])
        for m in self._meetings(motion):
            loads = nodal(m.overlaps, m.pieces, self.face, None)
            nodes, time = m.nodes[m.pieces.overlap], m.time[m.pieces.overlap]
            heat = loads.heat if self.heats else 0.0 * loads.heat
            for side, ends in enumerate((slice(0, 3), slice(3, 6))):
                made[side].add(m.times, time, nodes[:, ends], loads.force[:, ends], heat[:, ends])
        found = {}
        for side, surface in enumerate((self.first, self.second)):
            touched, force, heat = made[side].loads()
            if side == 0:
                force = self._in_first(force, motion)
            found[surface.body.name] = SurfaceLoads(surface.nodes[touched], force, heat)
        return found

    def _in_first(self, force: FloatArray, motion: Mapping[str, FrameHistory]) -> FloatArray:
        """(T, j, 3) in the first body's axes of forces in the second's."""
        A, B = (Path(s, motion).A for s in (self.first, self.second))
        return np.asarray(force @ (B.transpose(0, 2, 1) @ A))

    def history(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, FloatArray]:
        """Over the times (T,) of the motion: "normal" and "friction" N, the sizes of the
        resultants of pressure and of friction; "power" W; "area" m2 in contact; "pressure" Pa,
        the largest."""
        T = steps(motion)
        found = {name: np.zeros(T) for name in (
            "normal", "friction", "power", "area", "pressure")}
        for m in self._meetings(motion):
            loads = nodal(m.overlaps, m.pieces, self.face, None)
            time, now = m.time[m.pieces.overlap], slice(m.begin, m.stop)
            for name, vectors in (("normal", loads.push), ("friction", loads.drag)):
                whole = [np.bincount(time, x, m.times) for x in vectors.T]
                found[name][now] = np.linalg.norm(whole, axis=0)
            for name, values in (("power", loads.power), ("area", loads.area)):
                found[name][now] = np.bincount(time, values, m.times)
            polygons = m.pieces.polygons
            p = pressure(m.overlaps, m.pieces.of, polygons.places, self.face.normal)
            top = np.where(polygons.used, p, 0.0).max(axis=1, initial=0.0)
            np.maximum.at(found["pressure"], m.begin + m.time[m.pieces.of], top)
        return found

    def _meetings(self, motion: Mapping[str, FrameHistory]) -> Iterator[Meeting]:
        return meetings(self.first, self.second, self.near, self.face.normal, motion)


class _Sums:
    """Loads on n points, collected from some of the times after the other: of the points touched
    at those times only."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.touched: list[IntArray] = []
        self.values: list[FloatArray] = []

    def add(
        self, times: int, time: IntArray, nodes: IntArray, force: FloatArray, heat: FloatArray
    ) -> None:
        """time (M,), nodes (M, 3), force (M, 3, 3), heat (M, 3) of the next `times`."""
        touched, at = np.unique(nodes, return_inverse=True)
        at = (time[:, None] * len(touched) + at.reshape(nodes.shape)).ravel()
        columns = [*force.reshape(-1, 3).T, heat.ravel()]
        size = times * len(touched)
        whole: FloatArray = np.array([np.bincount(at, c, size) for c in columns]).T
        self.touched.append(touched)
        self.values.append(np.asarray(whole).reshape(times, len(touched), 4))

    def loads(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Touched points (j,), force (T, j, 3), heat (T, j)."""
        ever = np.unique(np.concatenate(self.touched))
        if not len(ever):
            ever = np.arange(self.n)
        times = sum(len(v) for v in self.values)
        force, heat, begin = np.zeros((times, len(ever), 3)), np.zeros((times, len(ever))), 0
        for touched, values in zip(self.touched, self.values, strict=True):
            now, at = slice(begin, begin + len(values)), np.searchsorted(ever, touched)
            force[now, at], heat[now, at] = values[:, :, :3], values[:, :, 3]
            begin += len(values)
        return ever, force, heat
