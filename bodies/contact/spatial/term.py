"""Contact of two surfaces in space as a local term of the equations."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.spatial.cells import reached
from sparsemor.bodies.contact.spatial.doubt import too_deep
from sparsemor.bodies.contact.spatial.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.spatial.placing import Placing, Sizes, dofs
from sparsemor.bodies.contact.spatial.planes import Planes
from sparsemor.bodies.contact.spatial.side import Side
from sparsemor.bodies.contact.spatial.slopes import Slopes
from sparsemor.bodies.contact.spatial.surface import radii_of, tree_of
from sparsemor.bodies.contact.spatial.tractions import Loads, nodal
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.bodies.local import CompressedLocal
from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray
from sparsemor.core.protocols import Trial


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
class SpatialContactTerm:
    """Rows: minus the generalized forces, and minus the heat, of what acts between two surfaces.

    reads, writes (local + n1 + n2,): where the local unknowns (placing.py) and then the
    temperatures are among the columns and rows, -1: nowhere. deforms, reach, active: as in the
    plane (contact/term.py).
    """

    rows: IntArray
    columns: IntArray
    sides: tuple[Side, Side]
    reads: IntArray
    writes: IntArray
    face: Interface
    near: Near
    deforms: bool
    reach: float
    active: tuple[BoolArray, BoolArray]
    source: str = ""

    @classmethod
    def of(
        cls, sides: tuple[Side, Side], face: Interface, near: Near, deforms: bool, reach: float
    ) -> Self:
        """Of all unknowns that the sides have."""
        one, two = sides
        numbers = np.concatenate([one.frame, two.frame, one.u, two.u, one.T, two.T])
        columns = np.unique(numbers[numbers >= 0])
        at = np.where(numbers >= 0, np.searchsorted(columns, numbers), -1)
        every = [np.ones(len(s.surface.facets), bool) for s in sides]
        return cls(columns, columns, sides, at, at, face, near, deforms, reach,
                   (every[0], every[1]))

    @property
    def elements(self) -> int:
        """Facets of the first surface that are evaluated, each against those near it."""
        first, second = (int(a.sum()) for a in self.active)
        return min(len(self.active[0]), first + second)

    # ------------------------------------------------------------------ evaluation

    def _place(self, x: FloatArray, v: FloatArray, t: float) -> Placing | None:
        """None for a state that overflowed: no tree can be searched there."""
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return None
        local = self.reads[: Sizes.of(*self.sides).whole]
        here = Placing(self.sides, _picked(x, local), _picked(v, local), t)
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
        f, g = self.near.pairs(middles, tree)
        if not (self.active[0].all() or self.active[1].all()):
            wanted = self.active[0][f] | self.active[1][g]
            f, g = f[wanted], g[wanted]
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
        known = _picked(x, self.reads[Sizes.of(*self.sides).whole :])
        n = len(self.sides[0].T)
        return np.concatenate([self.sides[0].temperature(known[:n], t),
                               self.sides[1].temperature(known[n:], t)])

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
        moved = by_z @ place.places + by_rate @ place.rates(_picked(c1, self.reads[:local]))
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

    def doubt(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Why the state at the end of a step of about h (s) is not to be trusted; "" if it is."""
        first, second = (s.surface for s in self.sides)
        here = self._place(x, v, t)
        depth = 0.0 if here is None else too_deep(first, second, here, h, self.reach, self.near)
        if depth == 0.0:
            return ""
        return (f"contact {self.source}: a point of {first.body.name} went {depth:.2g} m below the "
                f"surface of {second.body.name}, more than half the smallest facet "
                f"({self.reach:.2g} m): the step is too long for this contact, or its foundation "
                "too soft")

    # ------------------------------------------------------------------ reduction

    def restrict(self, keep: IntArray) -> "SpatialContactTerm":
        """Only facets that touch the kept rows, and what those and their partners read."""
        new = np.full(len(self.rows) + 1, -1)
        new[keep] = np.arange(len(keep))
        new[-1] = -1
        writes = new[self.writes]
        n = Sizes.of(*self.sides)
        active = self.active
        if not (writes[: n.frames] >= 0).any():
            first, second = (a & hot[s.surface.facets].any(axis=1) for a, s, hot in zip(
                self.active, self.sides, _hot(writes, n), strict=True))
            active = (first, second)
        read = self._read(active) & (self.reads >= 0)
        used = np.unique(self.reads[read])
        at = np.full(len(self.columns) + 1, -1)
        at[used] = np.arange(len(used))
        at[-1] = -1
        return replace(self, rows=self.rows[keep], columns=self.columns[used], writes=writes,
                       reads=at[self.reads], active=active)

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

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal:
        return CompressedLocal.of(self, trial, left)


def _picked(x: FloatArray, at: IntArray) -> FloatArray:
    """x at places `at`, 0 where a place is -1: nowhere."""
    return np.where(at >= 0, x[at], 0.0) if len(x) else np.zeros(at.shape)


def _hot(writes: IntArray, n: Sizes) -> tuple[BoolArray, BoolArray]:
    """(n1,), (n2,): points of which a row is written."""
    _, _, u1, u2 = n.split((writes[: n.whole] >= 0).astype(np.float64))
    T = writes[n.whole :] >= 0
    return u1.any(axis=1) | T[: n.n1], u2.any(axis=1) | T[n.n1 :]


def _assembled(
    local: FloatArray, rows: IntArray, columns: IntArray, shape: tuple[int, int]
) -> Csr:
    i, j = np.broadcast_arrays(rows[:, :, None], columns[:, None])
    made: Any = csr_array((local.ravel(), (i.ravel(), j.ravel())), shape=shape)
    return csr_array(made)
