"""Projected terms that are polynomials of third degree in the reduced unknowns, by their
coefficients: no element is visited in a step.

A displacement gradient G = sum_i z_i H_i with z = (1, x, f(t)) makes the force of Green-Lagrange
strains a polynomial of third degree (bodies/terms/nonlinear_strains.py). With C the elastic
constants, L the gradients of a row of the test basis and A : B the double contraction,

    r = sum_ij z_i z_j [C m_ij : L + C e_i : (H_j^T L)] + sum_ijk z_i z_j z_k C m_ij : (H_k^T L)
        - sum_ak T_a z_k beta H_k : L,          e_i = sym H_i,  m_ij = sym(H_i^T H_j) / 2

integrated over the body, with temperatures T - T_ref = sum_a z_a T_a. Products z_i z_j z_k with the
same factors are one monomial (Barbic & James 2005, doi 10.1145/1073204.1073300).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.bodies.fem.pointwise_law import GreenLagrange
from sparsemor.bodies.terms.point_term import PointTerm
from sparsemor.core import FloatArray, IntArray, ReducedTerm, TimeFunction
from sparsemor.core.protocols.term import LawArrays, PointArrays

MOST = 30
"""Largest number of displacement atoms: 30 have 5425 monomials, 1.3 MB and some 10 s to compute for
20 000 quadratic tetrahedra; all three grow with their third to fourth power."""
_CHUNK = 2**22
"""Numbers at points that are held at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialTerm(ReducedTerm):
    """Projected term: residual sum_m by_monomial[m] z_i z_j z_k with z = (1, x, f(t)).

    factors (3, m): numbers i <= j <= k in z of each monomial, 0 for the 1; by_monomial (m, l): its
    coefficient in each of l rows. size: number k of unknowns x; functions: f, of time.
    """

    factors: IntArray
    by_monomial: FloatArray
    size: int
    functions: tuple[TimeFunction, ...] = ()
    source: str = ""

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        i, j, k = self._values(x, t)
        return np.asarray((i * j * k).dot(self.by_monomial))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        """(l, k): by the product rule, coefficients times the two other factors of each monomial.
        """
        i, j, k = self._values(x, t)
        m = len(self.by_monomial)
        slopes = csr_array(  # of the monomials by z
            (np.stack([j * k, i * k, i * j], axis=1).ravel(), self.factors.T.ravel(),
             np.arange(0, 3 * m + 1, 3)), shape=(m, 1 + self.size + len(self.functions)))
        return np.ascontiguousarray((slopes.T @ self.by_monomial)[1 : 1 + self.size].T)

    def _values(self, x: FloatArray, t: float) -> FloatArray:
        """(3, m) values of the factors z of each monomial."""
        z = np.concatenate([[1.0], x, [f.value(t) for f in self.functions]])
        return np.asarray(z[self.factors])

    def arrays(self) -> PointArrays:
        """The term as a law at one point, whose variables are the n unknowns and `more` functions
        of time, each with the identity as P, or effect, and each row with a test of its own.
        factors (3, m): numbers in z = (1, unknowns, functions) of each of m monomials, by_monomial
        (m, rows): its coefficients; pairs: (row, variable) of derivatives, row by row."""
        (m, rows), n, more = self.by_monomial.shape, self.size, len(self.functions)
        pairs = [(i, j) for i in range(rows) for j in range(n + more)]
        law = LawArrays(
            np.concatenate([[m], self.factors.T.ravel(), self.by_monomial.ravel()]), (),
            np.array(pairs, dtype=np.int64).reshape(-1, 2), polynomial)
        effects = np.zeros((n + more, more))
        effects[n:] = np.eye(more)
        f = self.functions
        reads = np.array([(j, 1, 0) for j in range(n + more)], dtype=np.int64).reshape(-1, 3)
        return PointArrays(
            law=law, weights=np.ones((1, 1)), coordinates=np.zeros((1, 1)), P=np.eye(n + more, n),
            offset=np.zeros(n + more), effects=effects, values=tuple(g.value for g in f),
            rates=tuple(g.rate for g in f), bends=tuple(nothing for _ in f), reads=reads,
            tests=tuple(np.eye(rows)[:, [i]] for i in range(rows)))


def nothing(t: float) -> float:
    """Second difference of a function where none is read."""
    return 0.0


def polynomial(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """`PolynomialTerm` at one point, which numba compiles (`LawFunction`); numbers: count m of
    monomials, 3 factors of each, then coefficients of each in all rows. z (n, 1) holds the factors
    from number 1 on, factor 0 is 1; y (rows, 1), slopes (rows n or 0, 1): (row, variable), row by
    row, both zero at first; gains, x: not used."""
    m, rows, n = int(numbers[0]), y.shape[0], z.shape[0]
    coefficient = 1 + 3 * m
    for monomial in range(m):
        at = 1 + 3 * monomial
        i, j, k = int(numbers[at]), int(numbers[at + 1]), int(numbers[at + 2])
        a = z[i - 1, 0] if i else 1.0
        b = z[j - 1, 0] if j else 1.0
        c = z[k - 1, 0] if k else 1.0
        product = a * b * c
        for row in range(rows):
            y[row, 0] += numbers[coefficient + row] * product
        if len(slopes):
            for row in range(rows):
                of = row * n - 1  # factor i is variable i - 1
                if i:
                    slopes[of + i, 0] += numbers[coefficient + row] * (b * c)
                if j:
                    slopes[of + j, 0] += numbers[coefficient + row] * (a * c)
                if k:
                    slopes[of + k, 0] += numbers[coefficient + row] * (a * b)
        coefficient += rows


def polynomial_of(points: PointTerm, of: GreenLagrange) -> ReducedTerm:
    """The projected stress of Green-Lagrange strains less the linear one as a polynomial, or
    `points`, the same at points, where that costs less in a step.

    Equations: module docstring. n: number of factors z_i that move the body, `u` their numbers in
    z; `hot`: those of factors that change temperatures; coefficients of z_i z_j (second, mixed),
    z_i z_j z_k (third) and T_a z_k (heated) in each of `rows` rows.
    """
    law, d, reference = of
    first = int(reference is not None)
    gradients = [points.spans[i][0] for i, _ in points.reads[first:]]
    moved = any(points.offset[at].any() for at in gradients)
    used = np.flatnonzero(np.any([points.P[at].any(axis=0) for at in gradients], axis=0))
    # numbers in z = (1, x, f) of the factors of displacements, and of temperatures
    u: IntArray = np.concatenate([np.zeros(int(moved), np.int64), 1 + used])
    n, rows = len(u), len(points.tests[0])
    # T (R, hot): shapes T_a of T - T_ref; curved: given at each point, else once an element
    hot, T, curved = np.zeros(0, np.int64), np.zeros((0, 0)), False
    if reference is not None:
        at = points.spans[points.reads[0][0]][0]
        T = np.column_stack([points.offset[at] - reference, points.P[at],
                             *(column[at] for column, _ in points.parts)])
        hot, curved = np.flatnonzero(T.any(axis=0)), len(T) == points.weights.size
        T = T[:, hot]
    monomials = n * (n + 1) // 2 + n * (n + 1) * (n + 2) // 6 + n * len(hot)
    # products of a step; the law itself costs as much as 60 a point
    at_points = points.P.size + sum(L.size for L in points.tests) + 60 * points.weights.size
    if len(used) > MOST or monomials * (rows + 3) > at_points:
        return points
    pairs = np.triu_indices(n)
    second, third = np.zeros((len(pairs[0]), rows)), np.zeros((len(pairs[0]), rows, n))
    mixed, heated = np.zeros((n, rows, n)), np.zeros((len(hot), rows, n))
    E, Q = points.weights.shape
    width = d * (d + 1) // 2 * Q * (len(pairs[0]) + (rows + 1) * (n + 1))  # numbers an element
    step = max(1, _CHUNK // max(width, 1))
    for begin in range(0, E, step):
        cells = slice(begin, begin + step)
        H = np.stack([_at_points(points, points.P[at][:, used], points.offset[at], moved, cells)
                       for at in gradients])  # (d d, M, n)
        L = np.stack([_tests(points, A, cells) for A in points.tests])  # (d d, M, rows)
        H, L = (A.reshape(d, d, *A.shape[1:]) for A in (H, L))
        # M points; axes q: point, r: row, n: factor; seen = H_n^T L_r, squares = m_ij
        seen = np.einsum("kiqn,kjqr->ijqrn", H, L, optimize=True)
        test, strain = _voigt(L, d), _voigt(H, d)
        both = _voigt(seen, d).reshape(len(strain), -1, rows * n)
        squares = np.einsum("kiqn,kjqn->ijqn", H[..., pairs[0]], H[..., pairs[1]])
        squares[..., pairs[0] == pairs[1]] *= 0.5
        stress = _flat(_elastic(_voigt(squares, d), law, d))
        third += (stress.T @ _flat(both)).reshape(third.shape)
        second += stress.T @ _flat(test)
        mixed += (_flat(_elastic(strain, law, d)).T @ _flat(both)).reshape(mixed.shape)
        if len(hot):
            rise = _spread(T, curved, Q, cells)
            trace = np.einsum("iiqrn->qrn", seen).reshape(len(rise), rows * n)
            heated -= law.beta * (rise.T @ trace).reshape(heated.shape)
    return _collected(
        [((0, u[pairs[0]], u[pairs[1]]), second),
         ((0, u[:, None], u[None, :]), mixed.transpose(0, 2, 1)),
         ((u[pairs[0]][:, None], u[pairs[1]][:, None], u[None, :]), third.transpose(0, 2, 1)),
         ((0, hot[:, None], u[None, :]), heated.transpose(0, 2, 1))],
        points.P.shape[1], tuple(f for _, f in points.parts), rows, points.source)


def _collected(
    parts: Sequence[tuple[tuple[IntArray | int, ...], FloatArray]], size: int,
    functions: tuple[TimeFunction, ...], rows: int, source: str
) -> PolynomialTerm:
    """Term of all products: their factors and coefficients (..., rows), added up by monomials.
    size: number of reduced unknowns, so that z = (1, unknowns, functions(t)) has `base` entries.

    parts: numbers in z of the three factors of each product, as arrays that broadcast to the shape
    (...), and its coefficients. Factors in ascending order are the digits of one code a monomial.
    """
    base = 1 + size + len(functions)
    codes, values = [], []
    for numbers, coefficients in parts:
        i, j, k = np.sort(np.stack([
            np.broadcast_to(n, coefficients.shape[:-1]).ravel() for n in numbers]), axis=0)
        codes.append((i * base + j) * base + k)
        values.append(coefficients.reshape(len(i), rows))
    found, place = np.unique(np.concatenate(codes), return_inverse=True)
    by_monomial = np.zeros((len(found), rows))
    np.add.at(by_monomial, place.ravel(), np.concatenate(values))
    factors = np.stack([found // base**2, found // base % base, found % base])
    return PolynomialTerm(
        np.ascontiguousarray(factors), by_monomial, size, functions=functions, source=source)


def _at_points(
    points: PointTerm, P: FloatArray, offset: FloatArray, moved: bool, cells: slice
) -> FloatArray:
    """Values (M, n) at the points of some elements of a variable with projection P (R, k) and
    offset (R,), which is the first column if `moved`."""
    whole = np.column_stack([offset, P]) if moved else P
    return _spread(whole, len(P) == points.weights.size, points.weights.shape[1], cells)


def _spread(values: FloatArray, wide: bool, Q: int, cells: slice) -> FloatArray:
    """Rows of some elements of Q points, given at each point if `wide`, else once an element."""
    return values[cells.start * Q : cells.stop * Q] if wide else np.repeat(values[cells], Q, axis=0)


def _tests(points: PointTerm, A: FloatArray, cells: slice) -> FloatArray:
    """Test functions (M, rows) at the points of some elements, with their weights."""
    wide = A.shape[1] == points.weights.size
    found = _spread(A.T, wide, points.weights.shape[1], cells)
    return found if wide else found * points.weights[cells].reshape(-1, 1)


def _voigt(A: FloatArray, d: int) -> FloatArray:
    """Symmetric part of tensors (d, d, ...) as vectors (s, ...), whose dot products are double
    contractions: normal components, then shear times sqrt(2)."""
    normal = [A[i, i] for i in range(d)]
    return np.stack([*normal, *((A[i, j] + A[j, i]) / np.sqrt(2.0)
                                for i in range(d) for j in range(i + 1, d))])


def _elastic(strain: FloatArray, law: Law, d: int) -> FloatArray:
    """Stress lam tr(e) I + 2 mu e of strains (s, ...) as vectors."""
    stress = 2.0 * law.mu * strain
    stress[:d] += law.lam * strain[:d].sum(axis=0)
    return stress


def _flat(A: FloatArray) -> FloatArray:
    """(s M, n) from (s, M, n)."""
    return A.reshape(A.shape[0] * A.shape[1], A.shape[2])
