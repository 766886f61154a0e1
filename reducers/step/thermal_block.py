"""Thermal block of one body inside a step: C T' + K T - Q(t) + local terms = 0, solved for the
increment d from a prediction: T = T0 + d, T' = T0' + c1 d.

The coupling to displacements is one-way (T loads u), so heat is solved first. Without local terms
the block is linear and takes one solve. Local terms (radiation, k(T)) are iterated: at full order
with the factorized constant part, or by Newton's method where that contracts poorly; reduced by
Newton's method with a Jacobian that is kept over several steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from sparsemor.core import FloatArray, IntArray, ReducedTerm, Status
from sparsemor.reducers.linalg.active_columns import ActiveColumns, are_few
from sparsemor.reducers.linalg.modal_coordinates import compact, dense, times
from sparsemor.reducers.step.convergence_test import Tolerances, estimated_error
from sparsemor.reducers.step.projected_operators import ProjectedHeat
from sparsemor.reducers.step.time_tables import ChosenLoads, LoadsInTime, TimeTable, tabulated

TINY = 1e-300
"""Lower bound of a temperature that divides, K."""
RENEWED = 0.03
"""Ratio of the first two changes of a step from which the next step has a new Jacobian."""
SLOW = 0.1
"""Ratio of consecutive changes from which the iteration goes on with a new Jacobian."""

UNDAMPED = 8
"""Number of Newton iterations after which a step that does not lower the residual is shortened."""
SHORTEST = 2.0**-20
"""Least length of such a step, relative to Newton's."""
START_ITERATIONS = 5
"""Largest number of Newton iterations for consistent initial rates, which capacities enter
linearly."""


class HeatJacobian(NamedTuple):
    """Jacobian of a reduced thermal block at temperatures T with rates T' and second differences
    T'' at t, s. at (3 k + 1,): [T, T', T'', t]; of: the block; factors: LU factors, row exchanges
    and LAPACK's status, None where they are to be computed from `at`."""

    at: FloatArray
    of: "CompressedHeat | None" = None
    factors: tuple[FloatArray, IntArray, int] | None = None


class HeatOutcome(NamedTuple):
    """Result of a thermal solve. d: increments of the (active) unknowns from their prediction;
    linear: iterations of an iterative linear solver; detail: message of a failure; remaining:
    estimated error relative to the largest temperature, 0 for a linear problem; jacobian: the one
    to keep for the next step, None for a new one."""

    d: FloatArray
    status: Status
    iterations: int
    linear: int = 0
    detail: str = ""
    remaining: float = 0.0
    jacobian: HeatJacobian | None = None


def shortened(
    residual: Callable[[FloatArray], FloatArray], d: FloatArray, new: FloatArray
) -> FloatArray:
    """Unknowns (n,) after the Newton step from d to `new`, halved until the norm of the residual
    falls by a tenth of what its length promises: where the capacity jumps, as at the ends of a
    melting range, whole steps may alternate for ever, while the residual falls by less and less."""
    size, share = np.linalg.norm(residual(d)), 1.0
    while share > SHORTEST and np.linalg.norm(
            residual(d + share * (new - d))) >= (1.0 - 0.1 * share) * size:
        share *= 0.5
    return np.asarray(d + share * (new - d))


class HeatBlock(Protocol):
    """Temperatures of a block, or of several that are coupled, in a step. active: numbers of the
    active atoms, None for all."""

    @property
    def active(self) -> IntArray | None: ...
    @property
    def elements(self) -> int:
        """Number of elements that one evaluation of its local terms visits."""
        ...

    def solve(
        self, T: FloatArray, rate: FloatArray, bend: FloatArray, t: float, c2: float,
        kept: HeatJacobian | None = None,
    ) -> HeatOutcome:
        """Increments of the temperatures from a prediction T (k,) with its rate and its second
        difference `bend`, which grows by c2 d (`StepFormula`), at t, s; kept: the Jacobian that the
        step before left."""
        ...
    def start_rates(self, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Rates at the unknowns x that satisfy the equations of the block at t, s; v: a guess."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class CompressedHeat:
    """Reduced thermal block with s of k active atoms (`active`, None: all). Without local terms the
    increment is by_rate T' + by_value T + prescribed(t), with T the prediction and T' its rate.

    by_rate, by_value: (s, k), or a diagonal (modal_coordinates.py); prescribed: tabulated function
    of time of the `loads`, moving heat sources and constant terms; by_active_columns: by_rate and
    by_value where few atoms are active.
    """

    by_rate: FloatArray
    by_value: FloatArray
    prescribed: TimeTable
    active: IntArray | None
    local: tuple[ReducedTerm, ...]
    c1: float
    loads: LoadsInTime
    tolerances: Tolerances
    identity: FloatArray = field(init=False)
    by_active_columns: tuple[ActiveColumns, ActiveColumns] | None = field(init=False)

    def __post_init__(self) -> None:
        some = (ActiveColumns(dense(self.by_rate)), ActiveColumns(dense(self.by_value))) if are_few(
            self.active, self.by_rate.shape[-1]) else None
        object.__setattr__(self, "by_active_columns", some)
        object.__setattr__(self, "identity", np.eye(len(self.by_rate) if self.local else 0))

    @property
    def elements(self) -> int:
        return sum(term.elements for term in self.local)

    @classmethod
    def from_operators(
        cls, b: ProjectedHeat, left: FloatArray, support: IntArray | None, c1: float,
        tolerances: Tolerances, local: Sequence[ReducedTerm] = (),
    ) -> "CompressedHeat":
        """Reduced block from the projected operators b (m rows); left (s, m): left inverse of the
        projected B = c1 C + K on the active atoms `support` (None: all), left @ B_S = 1; local
        terms include the factor `left` already. `compact` stores a diagonal matrix as its
        diagonal."""
        loads = LoadsInTime(  # tables are projected for all times if `left` stays in the whole run
            left @ b.constant, left @ b.loads, tuple(b.amplitudes),
            tabulated(b.tables, left, support is None))
        # a support that may change with the next step does not pay for all times
        times = b.tables[0].times if b.tables and support is None else np.zeros(0)
        return cls(
            compact(-left @ b.capacity), compact(-left @ b.conductivity),
            loads.table(times), support, tuple(local), c1, loads, tolerances)

    @classmethod
    def of_orthonormal(
        cls, b: ProjectedHeat, support: IntArray, c1: float, tolerances: Tolerances
    ) -> "CompressedHeat":
        """Reduced block without local terms where the tested B is the unit matrix: rows and columns
        of the support (s,)."""
        loads = LoadsInTime(b.constant[support], b.loads[support], tuple(b.amplitudes),
                            tuple(ChosenLoads(table, support) for table in b.tables))
        return cls(-b.capacity[support], -b.conductivity[support], loads.table(np.zeros(0)),
                   support, (), c1, loads, tolerances)

    def start_rates(self, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Rates (k,) that satisfy the equations at the unknowns x, by Newton's method from the
        guess v; v itself where only some atoms are active, or if the method fails.

        Projected rates of the full-order start would not satisfy the reduced equations: heat that
        enters through a surface changes the temperatures of its nodes alone at first.
        """
        if self.active is not None or not len(x):
            return v
        # all rows are times the left inverse: by_rate = -C, by_value = -K
        capacity, zero, one, rates = -dense(self.by_rate), np.zeros(len(x)), np.ones(len(x)), v
        known = times(self.by_value, x) + self.prescribed.at(t)
        for _ in range(START_ITERATIONS):
            r, J = capacity @ rates - known, capacity
            for term in self.local:  # their derivative by rates alone: that with c1 = 1 less c1 = 0
                r = r + term.residual(x, rates, zero, t)
                J = J + term.jacobian(x, rates, zero, t, one, zero) - term.jacobian(
                    x, rates, zero, t, zero, zero)
            change = np.linalg.lstsq(J, r, rcond=None)[0]
            rates = rates - change
            if np.abs(change).max() <= 1e-12 * np.abs(rates).max():
                break
        return rates if np.isfinite(rates).all() else v

    def solve(
        self, T: FloatArray, rate: FloatArray, bend: FloatArray, t: float, c2: float,
        kept: HeatJacobian | None = None,
    ) -> HeatOutcome:
        """Increment (s,) of the active temperatures of a step from the prediction T (k,) with its
        rate and second difference `bend`: of linear blocks by_rate T' + by_value T + prescribed(t),
        else by iteration of the local terms. kept: Jacobian of an earlier step; by_active_columns:
        by_rate and by_value where few atoms are active, whose columns alone are multiplied."""
        if self.by_active_columns is None:
            base = times(self.by_rate, rate)
            base += times(self.by_value, T)
        else:
            base = self.by_active_columns[0].times(rate)
            base += self.by_active_columns[1].times(T)
        base += self.prescribed.at(t)
        if not self.local or not len(base):  # linear, or without active atoms
            return HeatOutcome(base, Status.DONE, 1)
        if self.active is not None:  # others may be active in the next step
            return self._iterate(base, T, rate, bend, t, c2, None)._replace(jacobian=None)
        return self._iterate(
            base, T, rate, bend, t, c2, None if kept is None else self.restored(kept))

    def restored(self, kept: HeatJacobian) -> HeatJacobian:
        """A kept Jacobian of this block with its factors, computed again after a restart."""
        if kept.of is self and kept.factors is not None:
            return kept
        at = kept.at
        T, rate, bend = at[:-1].reshape(3, -1)
        return self._linearized(T, rate, bend, float(at[-1]), at)[1]

    def _linearized(
        self, T: FloatArray, rate: FloatArray, bend: FloatArray, t: float,
        at: FloatArray | None = None,
    ) -> tuple[FloatArray, HeatJacobian]:
        """Local terms (s,) at T with its rate and second difference `bend`, (k,) each, and the
        factorized Jacobian there, 1 + their derivative for dT' = c1 dT, (s, s); at: [T, T', T'',
        t], if it is known as one array."""
        n, r, J = len(T), np.zeros(len(self.by_rate)), self.identity
        zero, c1 = np.zeros(n), np.full(n, self.c1)
        for term in self.local:
            added, slope = term.linearized(T, rate, bend, t, c1, zero)
            r = r + added
            J = J + (slope if self.active is None else slope[:, self.active])
        at = np.concatenate((T, rate, bend, (t,))) if at is None else at
        return r, HeatJacobian(at, self, dgetrf(J))

    def _residual(
        self, base: FloatArray, d: FloatArray, T: FloatArray, rate: FloatArray, bend: FloatArray,
        t: float, c2: float,
    ) -> FloatArray:
        """Residual (s,) at the increments d from a prediction."""
        full, r = np.zeros(len(T)), d - base
        full[slice(None) if self.active is None else self.active] = d
        for term in self.local:
            r = r + term.residual(T + full, rate + self.c1 * full, bend + c2 * full, t)
        return r

    def _iterate(
        self, base: FloatArray, T: FloatArray, rate: FloatArray, bend: FloatArray, t: float,
        c2: float, jacobian: HeatJacobian | None,
    ) -> HeatOutcome:
        """Increment d (s,) of d = base - (local terms), by Newton's method with a kept Jacobian
        (None: a new one), damped after `UNDAMPED` iterations. T, rate, bend (k,): the prediction;
        base (s,): increment without local terms.

        full (k,): d for all atoms; before: size of the previous change with the same Jacobian;
        first: ratio of the first two changes."""
        n, d = len(T), np.zeros(len(base))
        full, before, first = np.zeros(n), np.inf, 0.0
        for i in range(1, self.tolerances.max_iterations + 1):
            full = d if self.active is None else full
            if self.active is not None:
                full[self.active] = d
            now, rates, r = T + full, rate + self.c1 * full, d - base
            bends = bend + c2 * full
            if jacobian is None:
                added, jacobian = self._linearized(now, rates, bends, t)
                r += added
            else:
                for term in self.local:
                    r += term.residual(now, rates, bends, t)
            assert jacobian.factors is not None
            lu, pivots, info = jacobian.factors
            step = dgetrs(lu, pivots, r)[0]
            change, size = float(abs(step).max()), float(abs(now).max())
            if not change < np.inf or info > 0:
                finite = np.isfinite(r).all() and np.isfinite(lu).all()
                return HeatOutcome(d, Status.SINGULAR if finite else Status.NOT_FINITE, i)
            if i > UNDAMPED:
                step = d - shortened(
                    lambda e: self._residual(base, e, T, rate, bend, t, c2), d, d - step)
                change = float(abs(step).max())
            d = d - step
            error = estimated_error(change, before)
            first = change / before if i == 2 else first
            if error <= self.tolerances.remaining * size:
                return HeatOutcome(d, Status.DONE, i, remaining=error / max(size, TINY),
                                   jacobian=jacobian if first <= RENEWED else None)
            if change > SLOW * before:  # a new Jacobian, whose changes say nothing with old ones
                jacobian, before = None, np.inf
            else:
                before = change
        return HeatOutcome(d, Status.NOT_CONVERGED, self.tolerances.max_iterations)
