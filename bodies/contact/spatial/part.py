"""A built contact of bodies in space: its loads and histories along a known motion."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.part import ContactPart, Motion, steps
from sparsemor.bodies.contact.spatial.meetings import Meeting, meetings
from sparsemor.bodies.contact.spatial.path import Path, seen
from sparsemor.bodies.contact.spatial.pieces import pressure
from sparsemor.bodies.contact.spatial.resultants import HISTORIES, resultants
from sparsemor.bodies.contact.spatial.side import Side
from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.bodies.contact.spatial.term import SpatialContactTerm
from sparsemor.bodies.contact.spatial.tractions import nodal
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.stage import SurfaceLoads


@dataclass(frozen=True, slots=True, eq=False)
class SpatialContact(ContactPart[Surface]):
    """In space: see `ContactPart`."""

    def _term(
        self, layout: Layout, motion: Motion, face: Interface, *, moves: bool, deforms: bool,
        conducts: bool,
    ) -> SpatialContactTerm:
        first, second = (
            Side.of(s, layout, moves=moves, deforms=deforms, conducts=conducts,
                    motion=motion.get(s.body.name)) for s in (self.first, self.second))
        return SpatialContactTerm.of((first, second), face, self.near, deforms, self.reach)

    def _pressed(self, motion: Motion) -> bool:
        return any(map(self._presses, self._meetings(motion)))

    def _presses(self, m: Meeting) -> bool:
        return bool((pressure(m.overlaps, m.pieces.of, m.pieces.polygons.places,
                              self.face.normal) > 0).any())

    def _points(self, motion: Motion) -> Callable[[slice], tuple[FloatArray, FloatArray]]:
        one, other = Path(self.first, motion), Path(self.second, motion)
        return lambda now: (seen(one, other, self.first.X, now)[0][0], self.second.X)

    # ------------------------------------------------------------------ along a known motion

    def imported(self, motion: Motion) -> Mapping[str, SurfaceLoads]:
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

    def _in_first(self, force: FloatArray, motion: Motion) -> FloatArray:
        """(T, j, 3) in the first body's axes of forces in the second's."""
        A, B = (Path(s, motion).A for s in (self.first, self.second))
        return np.asarray(force @ (B.transpose(0, 2, 1) @ A))

    def history(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Over the times (T,) of the motion: see `resultants`."""
        found = {name: np.zeros(steps(motion)) for name in HISTORIES}
        for m in self._meetings(motion):
            loads = nodal(m.overlaps, m.pieces, self.face, None)
            now = resultants(m.times, m.time, m.overlaps, m.pieces, loads, self.face.normal)
            for name, values in now.items():
                found[name][m.begin : m.stop] = values
        return found

    def _meetings(self, motion: Motion) -> Iterator[Meeting]:
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
