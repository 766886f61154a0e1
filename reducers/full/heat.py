"""Heat of a step at full order: C T' + K T - q(t) + local terms = 0, for the departure d from the
free motion T0 of the step (core/protocols/integrator.py): T = T0 + d, T' = c1 d.

Displacements do not act on temperatures, so heat is solved first; bodies that conduct to each other
are solved together. Linear heat takes one solution with B = c1 C + K, which is factorized once.
With local terms (radiation, k(T)) the Jacobian is B plus their derivatives; where B is solved with
by iteration, these are left out.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import inf
from typing import Self

import numpy as np
from scipy.sparse import block_array, block_diag, coo_array, csc_array, csr_array

from sparsemor.core import (
    AssembledModel,
    Csr,
    DofLocations,
    Factorized,
    FloatArray,
    IntArray,
    Layout,
    SolveFailed,
    Status,
    StepFormula,
    Term,
    solved_directly,
)
from sparsemor.core.model.factorizations import unconverged_note
from sparsemor.core.protocols.integrator import second_difference
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.separable import HeatBody
from sparsemor.reducers.step.jacobian_factors import Factor, IdentityFactor, superlu
from sparsemor.reducers.step.newton_loop import Linearisation, StepEquations
from sparsemor.reducers.step.thermal_groups import couplings_of, group_name, starts_of
from sparsemor.reducers.step.time_tables import plus_loads

SYMMETRIC = 1e-12
"""Largest difference between a symmetric matrix and its transpose due to rounding, relative to its
largest entry."""
APART = 1.5
"""Distance between the nodes of one body and the next, as a multiple of the body's extent, where
the unknowns of a group are ordered."""
PRICE, UNCHANGED = 6, 50
"""Cost of a new Jacobian in iterations, and where it is the identity."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalAt:
    """A local term with the positions of its rows and columns in the block."""

    term: Term
    rows: IntArray
    columns: IntArray


class FullHeat(StepEquations):
    """Heat of a group of n unknowns at full order, numbered `at` in the model; c1: dT'/dT.

    With local terms and a direct linear solver the rows are as they stand (`plain`), B d - q +
    K T0 + local terms, otherwise times B^-1; `base` (n,) = q - K T0 of a step. B = c1 C + K; the
    free motion T0 is constant, T0' = 0.
    """

    named = ()
    iterations: dict[str, int]

    def __init__(
        self, layout: Layout, at: IntArray, heat: HeatBody, c1: float, factor: Factorized,
        local: Sequence[LocalAt],
    ) -> None:
        self.layout, self.solved, self.at, self.heat, self.c1 = layout, at, at, heat, c1
        self.factor, self.local = factor, local
        self.exact = not (local and factor.iterative)
        self.elements = sum(one.term.elements for one in local)
        self.plain = bool(local) and not factor.iterative
        self.price = PRICE if self.plain else UNCHANGED
        self.B: Csr = csr_array(c1 * heat.capacity + heat.conductivity)

    def working(self, memory: object = None) -> Self:
        return copy(self)

    def begin(self, step: StepFormula, d: FloatArray) -> None:
        heat, self.step, self.free = self.heat, step, step.free[self.at]
        self.iterations, self.failed = {}, None
        self.base = plus_loads(heat.constant - heat.conductivity @ self.free, heat, step.t)

    def solution(self, d: FloatArray) -> FloatArray | None:
        if self.local or self.factor.iterative:  # takes an iteration
            return None
        own, whole = self.factor.solve(self.base), d.copy()
        whole[self.at] = own
        return whole if np.isfinite(own).all() else None

    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        """Residual at the departure d: rows as they stand (`plain`), B d - (base - local terms), or
        d - B^-1 (base - local terms) by the linear solver; base (n,): loads less conduction at the
        free motion T0. slope: no effect, as nothing is kept for the Jacobian."""
        r, own = np.zeros(len(d)), d[self.at]  # other unknowns: zero, they are known
        right = self.base - self._forces(self.free + own, own) if self.local else self.base
        if self.plain:
            r[self.at] = self.B @ own - right
        elif not self.factor.iterative:
            r[self.at] = own - self.factor.solve(right)
        else:
            r[self.at] = own - self._iterated(right, own)
        return r

    def _iterated(self, right: FloatArray, d: FloatArray) -> FloatArray:
        """B^-1 right (n,) by iteration from d, whose tolerance is relative to the right-hand side
        of the temperatures T0 + d themselves; not a number where it does not converge."""
        found = self.factor.outcome(right + self.B @ self.free, self.free + d)
        name = self.heat.thermal
        self.iterations[name] = self.iterations.get(name, 0) + found.iterations
        if found.status.ok:
            return np.asarray(found.x - self.free)
        self.failed = name, found.status, unconverged_note(
            self.factor, found.residual, found.iterations)
        return np.full(len(d), np.nan)

    def _forces(self, T: FloatArray, d: FloatArray) -> FloatArray:
        """Local terms (n,) at temperatures T = T0 + d."""
        step, r = self.step, np.zeros(len(T))
        v = step.free_rate[self.at] + self.c1 * d
        a = np.zeros(len(T)) if step.before is None else second_difference(
            step.before[self.at], T, v, step.h)
        for one in self.local:
            j = one.columns
            r[one.rows] += one.term.residual(T[j], v[j], a[j], step.t)
        return r

    def jacobian(self, at: Linearisation) -> Csr | None:
        """Jacobian of the group's own rows, B plus derivatives of the local terms for dT' = c1 dT
        and dT'' = c2 dT, the last two of at.c; None for the identity, unless the rows are `plain`,
        not times B^-1."""
        if not self.plain:
            return None
        n, J = len(self.at), self.B
        T, v, a = at.x[self.at], at.v[self.at], at.a[self.at]
        for one in self.local:
            j, ones = one.columns, np.ones(len(one.columns))
            slope = coo_array(one.term.jacobian(
                T[j], v[j], a[j], at.t, at.c[2] * ones, at.c[3] * ones))
            J = J + csr_array((slope.data, (one.rows[slope.row], j[slope.col])), shape=(n, n))
        return csc_array(J)

    def contraction(self, point: Linearisation) -> float:
        return inf if self.local else 0.0

    def factorize(self, J: Csr | None) -> Factor:
        if J is None:
            return IdentityFactor()
        made: Factor = superlu(J)
        return made

    def magnitudes(self, J: Csr | None, x: FloatArray) -> FloatArray:
        return np.abs(x) if J is None else super().magnitudes(J, x)


def full_heat(model: AssembledModel, members: Sequence[HeatBody], c1: float) -> FullHeat:
    """Heat of bodies that conduct to each other, or of one, with unknowns in the order of
    `members`. c1: dT'/dT of a step. Raises SolveFailed where its matrix is singular."""
    number = np.arange(model.layout.size)
    at = np.concatenate([number[model.layout[b.thermal]] for b in members])
    heat = members[0] if len(members) == 1 else _merged(model, members)
    local = []
    for b, here in zip(members, starts_of([len(b.constant) for b in members]), strict=True):
        shift = here.start - model.layout[b.thermal].start
        local += [LocalAt(t, t.rows + shift, t.columns + shift) for t in b.local]
    operator = csr_array(c1 * heat.capacity + heat.conductivity)
    factor = (model.factorize(heat.thermal, operator) if len(members) == 1 else
              _factorized(model, members, operator))
    return FullHeat(model.layout, at, heat, c1, factor, local)


def _merged(model: AssembledModel, members: Sequence[HeatBody]) -> HeatBody:
    """The blocks of a group as one thermal block, couplings included, without local terms."""
    names = {b.thermal: i for i, b in enumerate(members)}
    # matrices of blocks by their numbers in the group, None for zero
    K: list[list[Csr | None]] = [[None] * len(members) for _ in members]
    C: list[list[Csr | None]] = [[None] * len(members) for _ in members]
    for i, b in enumerate(members):
        K[i][i], C[i][i] = b.conductivity, b.capacity
    for c in couplings_of(model, names):
        i, j = names[c.rows], names[c.columns]
        for table, X in ((K, c.A), (C, c.B)):
            now = table[i][j]
            table[i][j] = X if now is None else now + X
    spans = starts_of([len(b.constant) for b in members])
    size = spans[-1].stop
    return HeatBody(
        name="+".join(b.name for b in members), thermal=group_name(members),
        capacity=csr_array(block_array(C, format="csr")),
        conductivity=csr_array(block_array(K, format="csr")),
        constant=np.concatenate([b.constant for b in members]),
        loads=block_diag([csr_array(b.loads) for b in members]).toarray(),
        amplitudes=tuple(f for b in members for f in b.amplitudes), local=(),
        columns=tuple(c for b in members for c in b.columns), integrals=None,
        tables=tuple(_widened(t, here, size) for b, here in zip(members, spans, strict=True)
                     for t in b.tables))


def _widened(load: LoadTable, here: slice, size: int) -> LoadTable:
    """The load with its n rows placed in the rows of the whole group."""
    m = load.columns.tocoo()
    columns = csr_array((m.data, (m.row + here.start, m.col)), shape=(size, m.shape[1]))
    return replace(load, columns=columns)


def _factorized(model: AssembledModel, members: Sequence[HeatBody], A: Csr) -> Factorized:
    """Factorization of the matrix A (n, n) of a group: by the linear solver of the first block
    where it is symmetric, else by SuperLU. Raises SolveFailed where it is singular."""
    name = group_name(members)
    if abs(A - A.T).max() <= SYMMETRIC * abs(A).max():
        return model.factorize(name, A, places=_places(model, members))
    try:
        lu = superlu(A)
    except RuntimeError:
        raise SolveFailed(Status.SINGULAR, 0.0, name, "heat of coupled bodies") from None
    return solved_directly("splu", A, 12 * int(lu.nnz), lu.solve)


def _places(model: AssembledModel, members: Sequence[HeatBody]) -> DofLocations:
    """Positions of the unknowns for ordering, with the bodies placed side by side: each has its own
    axes."""
    parts = [model.places(b.thermal) for b in members]
    moved, begin = [], 0.0  # begin: smallest x of the next body, m
    for p in parts:
        X = p.coordinates.copy()
        extent = float(np.ptp(X[:, 0])) if len(X) else 0.0
        X[:, 0] += begin - X[:, 0].min(initial=0.0)
        begin += APART * extent
        moved.append(X)
    return DofLocations(np.concatenate(moved), np.concatenate([p.component for p in parts]))
