"""Contact of two surfaces in space as a local term of the equations."""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.numbers import found_in, picked, renumbered
from sparsemor.bodies.contact.pace import Mover
from sparsemor.bodies.contact.spatial.cells import reached
from sparsemor.bodies.contact.spatial.doubt import too_deep
from sparsemor.bodies.contact.spatial.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.spatial.placing import Placing, dofs
from sparsemor.bodies.contact.spatial.planes import Planes
from sparsemor.bodies.contact.spatial.resultants import HISTORIES, resultants
from sparsemor.bodies.contact.spatial.side import Side
from sparsemor.bodies.contact.spatial.slopes import Slopes
from sparsemor.bodies.contact.spatial.surface import radii_of, tree_of
from sparsemor.bodies.contact.spatial.tractions import Loads, nodal
from sparsemor.bodies.contact.spatial.unknowns import Sizes
from sparsemor.bodies.contact.surface_term import SurfaceTerm, every
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class _Touch:
    """One evaluation: where the points are, overlaps of facets number second (P,) with nodes
    (P, 6), numbered through both surfaces, temperatures (n1 + n2,), K, at them (P, 6)."""

    place: Placing
    second: IntArray
    nodes: IntArray
    overlaps: Overlaps
    pieces: Pieces
    loads: Loads
    T: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class SpatialContactTerm(SurfaceTerm[Side]):
    """In space: forces at all points of both surfaces, then those of the unknowns.

    reads, writes (local + n1 + n2,): where the local unknowns (unknowns.py) and then the
    temperatures are among the columns and rows, -1: nowhere.
    """

    RESULTANTS: ClassVar[tuple[str, ...]] = HISTORIES

    reads: IntArray = field(kw_only=True)
    writes: IntArray = field(kw_only=True)

    @classmethod
    def of(
        cls, sides: tuple[Side, Side], face: Interface, near: Near, deforms: bool, reach: float
    ) -> Self:
        """Of all unknowns that the sides have."""
        one, two = sides
        numbers = np.concatenate([one.frame, two.frame, one.u, two.u, one.T, two.T])
        columns = np.unique(numbers[numbers >= 0])
        at = found_in(numbers, columns)
        return cls(columns, columns, sides, face, near, deforms, reach, every(sides), reads=at,
                   writes=at)

    # ------------------------------------------------------------------ evaluation

    def _place(self, x: FloatArray, v: FloatArray, t: float) -> Placing | None:
        """None for a state that overflowed: no tree can be searched there."""
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return None
        local = self.reads[: Sizes.of(*self.sides).whole]
        here = Placing(self.sides, picked(x, local), picked(v, local), t)
        return here if here.finite else None

    def _touch(self, x: FloatArray, v: FloatArray, t: float) -> _Touch | None:
        here = self._place(x, v, t)
        if here is None:
            return None
        first, second = (s.surface for s in self.sides)
        moves = self.deforms and len(self.sides[1].u) > 0
        tree = tree_of(here.b, second.facets) if moves else second.tree
        corners = here.a[first.facets]
        middles = corners.mean(axis=1)
        f, g = self._pairs(middles, tree)
        all_planes = Planes.of(here.b[second.facets]) if moves else second.planes
        some = reached(middles[f], radii_of(corners)[f], all_planes, second.cells, g)
        f, g = f[some], g[some]
        i, j, planes = first.facets[f], second.facets[g], all_planes.some(g)
        o, kept = Overlaps.of(Pairs(here.a[i], here.va[i], planes, second.cells.some(g),
                                    here.vb[j] if moves else None))
        f, g = f[kept], g[kept]
        nodes = np.concatenate([first.facets[f], len(first.nodes) + second.facets[g]], axis=1)
        pieces = Pieces.cut(o, self.face.normal)
        T = self._temperatures(x, t)[nodes] if self.face.conductance > 0 else None
        return _Touch(here, g, nodes, o, pieces, nodal(o, pieces, self.face, T), T)

    def _temperatures(self, x: FloatArray, t: float) -> FloatArray:
        known = picked(x, self.reads[Sizes.of(*self.sides).whole :])
        first, second = self.sides
        n = len(first.T)
        return np.concatenate([first.held.filled(known[:n], t), second.held.filled(known[n:], t)])

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        if not self.elements:
            return np.zeros(len(self.rows))
        now = self._touch(x, v, t)
        if now is None:
            return np.full(len(self.rows), np.nan)
        force, heat = self._at_points(now)
        local = np.concatenate([now.place.rows(force), heat])
        kept = self.writes >= 0
        return -np.bincount(self.writes[kept], local[kept], minlength=len(self.rows)).astype(
            np.float64)

    def _at_points(self, now: _Touch) -> tuple[FloatArray, FloatArray]:
        """Forces (n1 + n2, 3) in the second body's axes and heat (n1 + n2,)."""
        n = now.place.sizes.n1 + now.place.sizes.n2
        nodes = now.nodes[now.pieces.overlap]
        at = nodes.ravel()
        force = np.array([np.bincount(at, c, n) for c in now.loads.force.reshape(-1, 3).T]).T
        return force.astype(np.float64), np.bincount(at, now.loads.heat.ravel(), n).astype(
            np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        shape = len(self.rows), len(self.columns)
        if not self.elements:
            return csr_array(shape)
        now = self._touch(x, v, t)
        if now is None:
            return csr_array(np.full(shape, np.nan))
        if not len(now.nodes):
            return csr_array(shape)
        by_z, by_rate, by_T = self._slopes(now)
        place, n = now.place, now.place.sizes
        points, local = 3 * (n.n1 + n.n2), n.whole
        moved = by_z @ place.places + by_rate @ place.rates(picked(c1, self.reads[:local]))
        force, _ = self._at_points(now)
        parts = ((place.places.T @ moved[:points] + place.rows_by(force), 0, 0),
                 (moved[points:], local, 0), (by_T, local, local))
        values, rows, columns = [], [], []
        for part, down, right in parts:
            c = csr_array(part).tocoo()
            values.append(c.data)
            rows.append(self.writes[c.row + down])
            columns.append(self.reads[c.col + right])
        i, j, data = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
        kept = (i >= 0) & (j >= 0)
        return csr_array((-data[kept], (i[kept], j[kept])), shape=shape)

    def _slopes(self, now: _Touch) -> tuple[Csr, Csr, Csr]:
        """Forces, then heats, of the points (4 n) by their places and velocities (3 n), and heats
        by temperatures (n)."""
        warms = bool((self.writes[now.place.sizes.whole :] >= 0).any())
        found = Slopes.of(now.overlaps, now.pieces, self.face, now.loads, now.T, self.deforms,
                          warms)
        n = now.place.sizes.n1 + now.place.sizes.n2
        columns = dofs(now.nodes)[:, : found.z.shape[2]]
        rows = np.concatenate([columns, 3 * n + now.nodes], axis=1)
        shape = (4 * n, 3 * n)
        return (_assembled(found.z, rows, columns, shape),
                _assembled(found.rate, rows, columns, shape),
                _assembled(found.T, now.nodes, now.nodes, (n, n)))

    def _too_deep(self, x: FloatArray, v: FloatArray, t: float, h: float) -> float:
        first, second = (s.surface for s in self.sides)
        here = self._place(x, v, t)
        return 0.0 if here is None else too_deep(first, second, here, h, self.reach, self.near)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        now = self._touch(x, v, t)
        assert now is not None
        found = resultants(1, np.zeros(len(now.nodes), np.int64), now.overlaps, now.pieces,
                           now.loads, self.face.normal)
        return {name: float(value[0]) for name, value in found.items()}

    # ------------------------------------------------------------------ reduction

    def restrict(self, keep: IntArray) -> Self:
        writes = renumbered(self.writes, keep, len(self.rows))
        n = Sizes.of(*self.sides)
        active = self.active
        if not (writes[: n.frames] >= 0).any():
            first, second = (a & hot[s.surface.facets].any(axis=1) for a, s, hot in zip(
                self.active, self.sides, n.touched(writes), strict=True))
            active = (first, second)
        read = self._read(active) & (self.reads >= 0)
        used = np.unique(self.reads[read])
        return replace(self, rows=self.rows[keep], columns=self.columns[used], writes=writes,
                       reads=renumbered(self.reads, used, len(self.columns)), active=active)

    def _read(self, active: tuple[BoolArray, BoolArray]) -> BoolArray:
        """Which local unknowns and temperatures active facets and their partners read."""
        n = Sizes.of(*self.sides)
        if not (active[0].any() or active[1].any()):
            return np.zeros(len(self.reads), bool)
        read = np.ones(len(self.reads), bool)
        start = n.whole
        for side, mine, other in ((0, *active), (1, *active[::-1])):
            surface = self.sides[side].surface
            count = len(surface.nodes)
            if not other.any():  # else its partners may be anywhere
                near = np.zeros(count, bool)
                near[surface.facets[mine]] = True
                read[start : start + count] = near
            start += count
        return read

    @property
    def movers(self) -> tuple[Mover, Mover]:
        n = Sizes.of(*self.sides)
        ends = np.cumsum([0, n.f1, n.f2, n.u1, n.u2])
        places = [self.reads[i:j] for i, j in pairwise(ends)]
        first, second = (
            Mover(s.surface.X, s.surface.facets, frame,
                  u.reshape(-1, 3) if len(u) else np.full(s.surface.X.shape, -1))
            for s, frame, u in zip(self.sides, places[:2], places[2:], strict=True))
        return first, second

    def points(self, x: FloatArray, t: float) -> tuple[FloatArray, FloatArray] | None:
        here = self._place(x, 0.0 * x, t)
        return None if here is None else (here.a, here.b)

    def among(self, first: IntArray, second: IntArray) -> tuple[Self, IntArray, IntArray]:
        n = Sizes.of(*self.sides)
        (one, used1), (two, used2) = (s.some(chosen) for s, chosen in zip(
            self.sides, (first, second), strict=True))
        mine = n.places(used1, used2)
        reads, writes = self.reads[mine], self.writes[mine]
        columns, rows = np.unique(reads[reads >= 0]), np.unique(writes[writes >= 0])
        made = replace(
            self, rows=self.rows[rows], columns=self.columns[columns], sides=(one, two),
            reads=found_in(reads, columns), writes=found_in(writes, rows),
            active=(self.active[0][first], self.active[1][second]))
        return made, columns, rows


def _assembled(
    local: FloatArray, rows: IntArray, columns: IntArray, shape: tuple[int, int]
) -> Csr:
    i, j = np.broadcast_arrays(rows[:, :, None], columns[:, None])
    made: Any = csr_array((local.ravel(), (i.ravel(), j.ravel())), shape=shape)
    return csr_array(made)
