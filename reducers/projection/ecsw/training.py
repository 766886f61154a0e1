"""Training of ECSW: sparse non-negative weights of the elements of one block.

The weights w >= 0 of E elements shall reproduce, at the training snapshots projected on the basis,
the projected forces of all elements with weight 1: G w = G 1, with a row of G for each atom (basis
vector) and snapshot (Farhat, Avery, Chapman, Cortial 2014, doi 10.1002/nme.4668, Eq. 15-19).
Element forces are linear in the unknowns here, so the snapshots are first replaced by a few
combinations with the same Gram matrix (a QR factorisation, exact), and where that leaves many rows
these by random combinations (`WeightEquations.combined`). Rows are scaled by their physical effect:
elastic forces by the displacement they cause through K, heat by the rate of temperature it causes
through C. Without that scaling stiff atoms dominate the training, and the elastic error was ten
times larger with as many elements.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sparsemor.core import Dictionary, FloatArray, IntArray, Term
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.protocols.separable import ElasticIntegrals, HeatIntegrals, Integrals
from sparsemor.reducers.projection.ecsw.nnls import Weights, nonnegative
from sparsemor.reducers.projection.ecsw.training_matrix import (
    BLOCK,
    EquationRows,
    Part,
    WeightEquations,
)

MET = 1.001
"""Residual up to which tau counts as attained, as a multiple of tau."""
COMBINATIONS, MOST = 1000, 4000
"""Number of random combinations of equations at first, and at most; twice as many are used where
they determine too many weights."""
PER_WEIGHT = 4
"""Combinations needed for each weight that is not zero."""
ATTEMPTS = 6
"""Largest number of times that the tolerance of the combinations is lowered, since they are met
better than the equations themselves."""
MOST_ENTRIES = 16_000_000
"""Largest number of entries of G that are kept: 128 MB."""
CANDIDATES = 20_000
"""Largest number of elements among which weights are searched."""


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """Training coefficients of one block: c (k, M) at the snapshot times t (M,), s."""

    dictionary: Dictionary
    c: FloatArray
    t: FloatArray

    @classmethod
    def fit(cls, dictionary: Dictionary, snapshots: FloatArray, t: FloatArray) -> "Trained":
        """Least-squares coefficients of snapshots (n, M) in the dictionary's atoms."""
        inverse = np.linalg.pinv(dictionary.atoms)
        c = [inverse @ (part - dictionary.offset[:, None]) for _, part in column_chunks(snapshots)]
        return cls(dictionary, np.asarray(np.concatenate(c, axis=1), dtype=np.float64), t)

    @property
    def with_offset(self) -> FloatArray:
        """Atoms and offset of the dictionary side by side, (n, k + 1); multiplies `homogeneous`."""
        return np.column_stack([self.dictionary.atoms, self.dictionary.offset])

    @property
    def homogeneous(self) -> FloatArray:
        """Coefficients with an appended row of ones, (k + 1, M)."""
        return np.vstack([self.c, np.ones(len(self.t))])

    def states(self, unknowns: IntArray, chosen: IntArray) -> tuple[FloatArray, FloatArray]:
        """Values and rates (n, M') of some unknowns of the block at the chosen snapshots."""
        d = self.dictionary
        atoms = d.atoms[unknowns]
        x = d.offset[unknowns, None] + atoms @ self.c[:, chosen]
        return np.asarray(x), np.asarray(atoms @ self.rates_at()[:, chosen])

    def rates(self) -> FloatArray:
        """Difference quotients (k, M') of consecutive snapshots whose times increase."""
        dt = np.diff(self.t)
        on = dt > 0.0
        return np.asarray(np.diff(self.c, axis=1)[:, on] / dt[on])

    def rates_at(self) -> FloatArray:
        """Backward difference quotient (k, M) at each snapshot; forward at the start, and at an
        additional snapshot taken there. Zero for a single time."""
        ends = np.flatnonzero(np.diff(self.t) > 0.0) + 1
        found = np.zeros_like(self.c)
        if len(ends):
            quotients = self.rates()
            found[:] = quotients[:, :1]
            found[:, ends] = quotients
        return found


def elastic_equations(
    integrals: ElasticIntegrals, u: Trained, heat: Trained | None, flexibility: FloatArray
) -> WeightEquations:
    """Training matrix G (m, E) of an elastic block: static displacements due to the stiffness and
    thermal forces of each element, relative to |c|.

    u, heat: training states of displacements and temperatures (None: no thermal forces);
    flexibility (k, k): inverse of the projected stiffness. Both forces are trained separately, not
    only their sum: the sum is small and would also be reproduced by weights that give a body
    neither stiffness nor expansion.
    """
    count, size = integrals.stiffness.count, float(np.linalg.norm(u.c))
    if size == 0.0:
        return WeightEquations(count, (), ())
    left = u.dictionary.atoms @ flexibility.T / size  # left^T f = flexibility (atoms^T f) / |c|
    prescribed = _values_at(integrals.amplitudes, u.t)
    # thermal forces: those of prescribed temperatures, and those of the unknown ones
    thermal, factors = [(integrals.given, np.eye(len(prescribed)))], [prescribed]
    if integrals.coupling is not None and heat is not None:
        thermal.append((integrals.coupling, heat.with_offset))
        factors.append(heat.homogeneous)
    # `Shares`: left, integrals with their matrices, factors, reference magnitude
    return _equations(count, [
        (left, [(integrals.stiffness, u.with_offset)], u.homogeneous, None),
        (left, thermal, np.concatenate(factors), None)])


def heat_equations(integrals: HeatIntegrals, T: Trained, C_inverse: FloatArray) -> WeightEquations:
    """Training matrix G (m, E) of a thermal block: rates of temperature due to conduction and to
    stored heat of each element, each relative to its sum over all elements. T: training states;
    C_inverse (k, k): inverse of the projected capacity. T.with_offset (n, k + 1) times
    T.homogeneous (k + 1, M) are the temperatures."""
    left = T.dictionary.atoms @ C_inverse.T  # left^T q = C_inverse (atoms^T q)
    prescribed = _values_at(integrals.amplitudes, T.t)
    # flow, change: size of what conduction and rates are differences of, before these cancel (of
    # rates by the longest time between snapshots); below its round-off there is nothing to learn
    top = np.abs(T.with_offset) @ np.abs(T.homogeneous).max(axis=1)
    K = abs(integrals.conductivity.weighted(np.ones(integrals.conductivity.count)))
    flow = float(np.linalg.norm(np.abs(left).T @ (K @ top)))
    change = float(np.linalg.norm(np.abs(T.c).max(axis=1))) / float(np.abs(np.diff(T.t)).max())
    # conductivity T - given [1; amplitudes(t)], given: effect of prescribed temperatures
    conduction = [(integrals.conductivity, T.with_offset),
                  (integrals.given, -np.eye(len(prescribed)))]
    return _equations(integrals.capacity.count, [
        (left, conduction, np.concatenate([T.homogeneous, prescribed]), flow),
        (left, [(integrals.capacity, T.dictionary.atoms)], T.rates(), change)])


def local_equations(
    term: Term, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray
) -> WeightEquations:
    """Training matrix G (m, F) of a local term such as radiation or k(T): left (k, m) times the
    contribution of each element at states x (n, M) and rates v (n, M), at times t (M,), s.

    G is evaluated for a few elements at a time, once if it has at most `MOST_ENTRIES` entries. It
    is identified in the cache by its sum G 1 and its products with two other vectors.
    """
    count, rows = term.elements, len(left) * len(t)

    def evaluated(part: Part) -> FloatArray:
        """Rows (E', k M) of the elements `part`: the transpose of their columns of G."""
        shares = term.contributions(left, x, v, t, np.arange(count)[part])
        return shares.reshape(len(shares), -1)

    whole = evaluated(slice(0, count)) if rows * count <= MOST_ENTRIES else None

    def make(part: Part) -> FloatArray:
        """Columns (k M, E') of G for the elements `part`."""
        return (evaluated(part) if whole is None else whole[part]).T

    # sums: G 1 and G times two random vectors; size: sum |G|, below whose round-off G 1 counts as
    # zero; sizes: norms of the columns
    probes = np.random.default_rng(0).standard_normal((count, 2))
    sums, size, sizes = np.zeros((rows, 3)), 0.0, np.zeros((1, count))
    for first in range(0, count, step := max(BLOCK // max(rows, 1), 1)):
        part = slice(first, first + step)
        G = make(part)
        sums[:, 0] += G.sum(axis=1)
        sums[:, 1:] += G @ probes[part]
        size += float(np.abs(G).sum())
        sizes[0, part] = np.linalg.norm(G, axis=0)
    parts = (EquationRows(rows, make, size),) if rows else ()
    return WeightEquations(count, parts, (sums, size), sums[:, 0].copy(), sizes)


def _values_at(amplitudes: Sequence[Callable[[float], float]], t: FloatArray) -> FloatArray:
    """A row of ones and the prescribed functions of time at t, (1 + j, M)."""
    values = [[f(float(s)) for s in t] for f in amplitudes]
    return np.array([np.ones(len(t)), *values])


Shares = tuple[FloatArray, Sequence[tuple[Integrals, FloatArray]], FloatArray, float | None]
"""Factors of some rows of G: left (n, k); element integrals with the matrices they are multiplied
by, side by side (m, z); the factors of these columns at the snapshots (z, M); and the reference
magnitude of the sums (`EquationRows.against`)."""


def _equations(count: int, shares: Sequence[Shares]) -> WeightEquations:
    """Training equations of `count` elements. Each share (left, pairs, factors, against) gives rows
    left^T (element force) at all M snapshots, the force being the sum over `pairs` of integral @
    matrix, side by side, times `factors` (z, M)."""
    parts, content = [], list[object]()
    for left, pairs, factors, against in shares:
        # r <= z combinations of snapshots, by R of a QR factorization, in place of M columns: the
        # least squares are the same
        combinations = np.asarray(np.linalg.qr(factors.T, mode="r")).T
        parts.append(EquationRows(
            left.shape[1] * combinations.shape[1],
            partial(_entries, left, pairs, combinations), against))
        content += [left, combinations, against]
        content += [a for g, right in pairs for a in (g.rows, g.columns, g.values, right)]
    return WeightEquations(count, tuple(parts), tuple(content))


def _entries(
    left: FloatArray, pairs: Sequence[tuple[Integrals, FloatArray]], combinations: FloatArray,
    part: Part,
) -> FloatArray:
    """Entries (k r, E') of G for some elements."""
    tensor = np.concatenate([g.part(part).projected(left, right) for g, right in pairs], axis=2)
    return np.ascontiguousarray((tensor @ combinations).reshape(len(tensor), -1).T)


def train(equations: WeightEquations, tau: float, most_candidates: int = CANDIDATES) -> Weights:
    """Sparse weights w (E,) >= 0 with |G w - G 1| <= tau; all 1 where G has no rows.

    Of more than `most_candidates` elements as many, drawn at random by their share in the forces,
    may get a nonzero weight: drawn alike, they would miss those of a thin heated layer.

    Where G has many rows, weights are computed from random combinations of these and verified with
    all of them. While the residual of all equations exceeds tau, the active set is continued to a
    smaller residual of the combinations, and with more combinations where the weights are too many
    for these.
    """
    G = equations.scaled() if equations.parts else equations
    if not G.parts:
        return Weights(np.ones(G.count), 0.0)
    # total: G 1; among: elements that may have a weight; w: their last weights, where to go on
    total, among, combinations = G.total(), candidates(G, most_candidates), COMBINATIONS
    best, w = Weights(np.ones(G.count), np.inf), np.zeros(len(among))
    while True:
        reduced = G.combined(among, combinations)
        # fewer weights than combinations / PER_WEIGHT: more would fit the combinations alone
        last = reduced.exact or combinations >= MOST
        most = len(among) if last else combinations // PER_WEIGHT
        goal = tau
        for _ in range(ATTEMPTS):
            w, achieved = nonnegative(reduced.A, reduced.b, goal, most, w)
            whole = np.zeros(G.count)
            whole[among] = w
            residual = float(np.linalg.norm(G.applied(whole) - total))
            if residual < best.residual:
                best = Weights(whole, residual)
            if best.residual <= MET * tau:  # tau but for rounding
                return best
            if reduced.exact or achieved > goal:
                break
            # the combinations understate the residual by about this factor: ask for less of them
            goal *= 0.95 * tau / residual
        if last:
            return best
        combinations *= 2


def candidates(G: WeightEquations, most: int) -> IntArray:
    """Sorted numbers of the elements that may get a nonzero weight; the same in every call."""
    if G.count <= most:
        return np.arange(G.count)
    shares = G.shares()
    if np.count_nonzero(shares) <= most:
        return np.flatnonzero(shares)
    return np.sort(np.random.default_rng(0).choice(G.count, most, replace=False, p=shares))
