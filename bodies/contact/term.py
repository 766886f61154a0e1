"""Contact of two surfaces in the plane as a local term of the equations."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.contact.doubt import too_deep
from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.numbers import picked
from sparsemor.bodies.contact.pace import Mover
from sparsemor.bodies.contact.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.resultants import HISTORIES, Resultants
from sparsemor.bodies.contact.side import Places, Points, Side
from sparsemor.bodies.contact.surface import plane, tree_of
from sparsemor.bodies.contact.surface_term import SurfaceTerm, every
from sparsemor.bodies.contact.tractions import Interface, Slopes, as_real, nodal
from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray

ENDS = 14
"""Unknowns of a pair besides temperatures: two frames, two displacements at each of four ends."""


@dataclass(frozen=True, slots=True, eq=False)
class _Touch:
    """One evaluation: facets (P,) of the overlaps on both surfaces, and where the points are."""

    points: tuple[Points, Points]
    facets: tuple[IntArray, IntArray]
    overlaps: Overlaps
    pieces: Pieces
    nodes: IntArray  # (P, 4): two of the first, two of the second surface
    T: FloatArray | None


@dataclass(frozen=True, slots=True, eq=False)
class ContactTerm(SurfaceTerm[Side]):
    """In the plane: each piece of an overlap with the 14 unknowns, and 4 temperatures, of its ends.
    """

    RESULTANTS: ClassVar[tuple[str, ...]] = HISTORIES

    @classmethod
    def of(
        cls, sides: tuple[Side, Side], face: Interface, near: Near, deforms: bool, reach: float
    ) -> Self:
        """sides: with places as global numbers."""
        columns = np.unique(np.concatenate([s.columns.all() for s in sides]))
        first, second = (replace(s, columns=s.columns.found_in(columns),
                                 rows=s.rows.found_in(columns)) for s in sides)
        return cls(columns, columns, (first, second), face, near, deforms, reach, every(sides))

    # ------------------------------------------------------------------ evaluation

    def _touch(self, x: FloatArray, v: FloatArray, t: float) -> _Touch:
        a, b = (s.points(x, v, t) for s in self.sides)
        first, second = (s.surface for s in self.sides)
        if self.deforms:
            middles, tree = a.z[first.facets].mean(axis=1), tree_of(b.z, second.facets)
        else:  # in the second body's axes its tree never changes
            middles = ((a.z - b.R) * np.conj(b.e))[first.facets].mean(axis=1)
            tree = second.tree
        f, g = self._pairs(plane(middles), tree)
        i, j = first.facets[f], second.facets[g]
        pairs = Pairs(np.concatenate([a.z[i], b.z[j]], axis=1),
                      np.concatenate([a.rate[i], b.rate[j]], axis=1), second.turns[g])
        o, kept = Overlaps.of(pairs)
        f, g = f[kept], g[kept]
        pieces = Pieces.cut(o, self.face.normal, self.face.friction)
        nodes = np.concatenate([first.facets[f], second.facets[g]], axis=1)
        T = None
        if self.face.conductance > 0:
            T = np.concatenate([a.T[nodes[:, :2]], b.T[nodes[:, 2:]]], axis=1)
        return _Touch((a, b), (f, g), o, pieces, nodes, T)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        if not (np.isfinite(x).all() and np.isfinite(v).all()):  # no tree can be searched there
            return np.full(len(self.rows), np.nan)
        now = self._touch(x, v, t)
        force, heat, _ = nodal(now.overlaps, now.pieces, self.face, now.T)
        nodes = now.nodes[now.pieces.of]
        B = _motions(now.points, nodes)
        local = np.concatenate([(as_real(force)[:, None, :] @ B)[:, 0], heat], axis=1)
        rows = self._local(nodes, "rows")
        kept = rows >= 0
        return -np.bincount(rows[kept], local[kept], minlength=len(self.rows)).astype(np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        now = self._touch(x, v, t)
        force, _, samples = nodal(now.overlaps, now.pieces, self.face, now.T)
        bent = np.ones((len(now.facets[1]), 2), bool) if self.deforms else (
            self.sides[1].surface.bent[now.facets[1]])
        slopes = Slopes.of(now.overlaps, now.pieces, samples, self.face, now.T, bent)
        nodes = now.nodes[now.pieces.of]
        columns, rows = self._local(nodes, "columns"), self._local(nodes, "rows")
        B = _motions(now.points, nodes)
        rate = B * picked(c1, columns[:, :ENDS])[:, None, :] + _drift(now.points, nodes)
        inner = slopes.z @ B + slopes.rate @ rate
        local = np.zeros((len(nodes), ENDS + 4, ENDS + 4))
        local[:, :ENDS, :ENDS] = B.transpose(0, 2, 1) @ inner[:, :8]
        local[:, :ENDS, :ENDS] += _curvature(now.points, nodes, force)
        local[:, ENDS:, :ENDS] = inner[:, 8:]
        local[:, ENDS:, ENDS:] = slopes.T[:, 8:]
        i, j = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
        kept = (i >= 0) & (j >= 0)
        return csr_array((-local[kept], (i[kept], j[kept])),
                         shape=(len(self.rows), len(self.columns)))

    def _local(self, nodes: IntArray, which: str) -> IntArray:
        """(N, 18) places of a piece's unknowns: both frames, displacements, temperatures."""
        a, b = (getattr(s, which) for s in self.sides)
        n = len(nodes)
        frames = np.broadcast_to(np.concatenate([a.frame, b.frame]), (n, 6))
        i, j = nodes[:, :2], nodes[:, 2:]
        u = np.concatenate([a.u[i].reshape(n, 4), b.u[j].reshape(n, 4)], axis=1)
        return np.concatenate([frames, u, a.T[i], b.T[j]], axis=1)

    def _too_deep(self, x: FloatArray, v: FloatArray, t: float, h: float) -> float:
        a, b = (s.points(x, v, t) for s in self.sides)
        first, second = (s.surface for s in self.sides)
        return too_deep(first, second, a, b, h, self.reach, self.near)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        now, summed = self._touch(x, v, t), Resultants(1)
        summed.add(np.zeros(len(now.pieces.of), np.int64), now.overlaps, now.pieces, self.face)
        return {name: float(value[0]) for name, value in summed.found().items()}

    # ------------------------------------------------------------------ reduction

    def restrict(self, keep: IntArray) -> Self:
        rows = tuple(s.rows.kept(keep, len(self.rows)) for s in self.sides)
        whole = any((r.frame >= 0).any() for r in rows)
        active = [a if whole else a & _touched(s, r)
                  for a, s, r in zip(self.active, self.sides, rows, strict=True)]
        reads = [self._read(0, active), self._read(1, active)]
        used = np.unique(np.concatenate(reads)) if active[0].any() or active[1].any() else (
            np.zeros(0, np.int64))
        sides = [replace(s, rows=r, columns=s.columns.found_in(used))
                 for s, r in zip(self.sides, rows, strict=True)]
        return replace(self, rows=self.rows[keep], columns=self.columns[used],
                       sides=(sides[0], sides[1]), active=(active[0], active[1]))

    def _read(self, which: int, active: list[BoolArray]) -> IntArray:
        """Columns of one side: of its active facets, of all where a facet of the other is."""
        side = self.sides[which]
        if self.deforms or active[1 - which].any():  # deformed facets are looked for among all
            return side.columns.all()
        facets = side.surface.facets[active[which]]
        nodes = np.unique(facets)
        at = side.columns
        return replace(at, u=at.u[nodes], T=at.T[nodes]).all()

    @property
    def movers(self) -> tuple[Mover, Mover]:
        first, second = (Mover(plane(s.surface.X), s.surface.facets, s.columns.frame, s.columns.u)
                         for s in self.sides)
        return first, second

    def points(self, x: FloatArray, t: float) -> tuple[FloatArray, FloatArray] | None:
        first, second = (plane(s.points(x, 0.0 * x, t).z) for s in self.sides)
        return (first, second) if np.isfinite(first).all() and np.isfinite(second).all() else None

    def among(self, first: IntArray, second: IntArray) -> tuple[Self, IntArray, IntArray]:
        sides = [s.some(chosen) for s, chosen in zip(self.sides, (first, second), strict=True)]
        columns, rows = (np.unique(np.concatenate(found)) for found in (
            [s.columns.all() for s in sides], [s.rows.all() for s in sides]))
        a, b = (replace(s, columns=s.columns.found_in(columns), rows=s.rows.found_in(rows))
                for s in sides)
        active = self.active[0][first], self.active[1][second]
        return replace(self, rows=self.rows[rows], columns=self.columns[columns], sides=(a, b),
                       active=active), columns, rows


def _touched(side: Side, rows: Places) -> BoolArray:
    hot = (rows.u >= 0).any(axis=1) | (rows.T >= 0)
    return np.asarray(hot[side.surface.facets].any(axis=1))


def _spread(z: Any) -> FloatArray:
    """Complex (N, 4, j) as real (N, 8, j): real and imaginary part of each end."""
    return np.stack([z.real, z.imag], axis=2).reshape(len(z), 8, z.shape[2])


def _motions(points: tuple[Points, Points], nodes: IntArray) -> FloatArray:
    """(N, 8, 14): how the four ends move with each unknown of the pair."""
    B = np.zeros((len(nodes), 4, ENDS), complex)
    for side, (p, ends) in enumerate(zip(points, (slice(0, 2), slice(2, 4)), strict=True)):
        B[:, ends, 3 * side], B[:, ends, 3 * side + 1] = 1.0, 1j
        B[:, ends, 3 * side + 2] = 1j * p.r[nodes[:, ends]]
        for k in range(ends.start, ends.stop):
            B[:, k, 6 + 2 * k], B[:, k, 7 + 2 * k] = p.e, 1j * p.e
    return _spread(B)


def _drift(points: tuple[Points, Points], nodes: IntArray) -> FloatArray:
    """(N, 8, 14): how the ends' velocities change with the unknowns, their rates held."""
    B = np.zeros((len(nodes), 4, ENDS), complex)
    for side, (p, ends) in enumerate(zip(points, (slice(0, 2), slice(2, 4)), strict=True)):
        B[:, ends, 3 * side + 2] = 1j * p.slide[nodes[:, ends]]
        for k in range(ends.start, ends.stop):
            B[:, k, 6 + 2 * k] = 1j * p.spin * p.e
            B[:, k, 7 + 2 * k] = -p.spin * p.e
    return _spread(B)


def _curvature(points: tuple[Points, Points], nodes: IntArray, force: Any) -> FloatArray:
    """(N, 14, 14): what constant forces (N, 4) at the ends add because the frames turn."""
    C = np.zeros((len(nodes), ENDS, ENDS))
    for side, (p, ends) in enumerate(zip(points, (slice(0, 2), slice(2, 4)), strict=True)):
        f, turn = force[:, ends], 3 * side + 2
        C[:, turn, turn] = -(f.conj() * p.r[nodes[:, ends]]).real.sum(axis=1)
        for k in range(ends.start, ends.stop):
            g = 1j * p.e * force[:, k].conj()
            C[:, turn, 6 + 2 * k] = C[:, 6 + 2 * k, turn] = g.real
            C[:, turn, 7 + 2 * k] = C[:, 7 + 2 * k, turn] = (1j * g).real
    return C
