"""Newton's method on supports: the loop of all sparse solvers, and linear recovery in it."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from sparsemor.core import (
    PROBLEM_FEATURES,
    BoolArray,
    FloatArray,
    Group,
    InputError,
    Plugin,
    SparseOutcome,
    SparseProblem,
    SparseStart,
    Status,
    solver_refusal,
)
from sparsemor.plugins.sparse_solvers.iterates import (
    Visits,
    always_active,
    ended,
    small_step,
    within_budget,
)
from sparsemor.plugins.sparse_solvers.least_squares_on_support import (
    Fit,
    Linearised,
    fit,
    independent,
    pruned,
)
from sparsemor.plugins.sparse_solvers.penalised import Penalised


@dataclass(frozen=True, slots=True, eq=False)
class Recovered:
    """x (k,) of a `Penalised` problem, or why there is none. Zero: not active."""

    x: FloatArray
    status: Status = Status.DONE


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """The active columns that one linearisation led to."""

    linear: Linearised
    active: BoolArray
    status: Status

    def holds_for(self, other: Linearised) -> bool:
        """Is the other the same linear problem? Then there is nothing to recover again."""
        mine, its = self.linear, other
        if not np.array_equal(mine.J, its.J):
            return False
        a, b = mine.J @ mine.z - mine.r, its.J @ its.z - its.r
        return float(np.linalg.norm(a - b)) <= 1e-12 * float(np.linalg.norm(a))


Choose = Callable[[Linearised, BoolArray, bool], Fit | Status]
"""Least squares on the support of the next iterate, from the linearisation at the present one, its
support, and whether another support may be chosen; or the status of a failure."""


class SupportNewton(Plugin):
    """Newton's method whose every step may change the support.

    It ends when neither the support nor c changes. A support that comes back after it was left is a
    cycle: from then on plain Gauss-Newton on the best support met.
    """

    rtol: float = Field(default=1e-8, gt=0.0, lt=1.0)
    """Largest step of each group, relative to the group (both scaled by column norms), that
    ends the iteration."""
    max_iterations: int = Field(default=100, ge=1)
    """Linearisations before the solve is given up as not converged: on a support that leaves much
    of the residual Gauss-Newton contracts slowly."""
    rank_rtol: float = Field(default=1e-12, gt=0.0, lt=1.0)
    """Reciprocal condition number at which active columns count as dependent."""

    counts_start: ClassVar[bool] = True
    """Whether the support of the start takes part in cycles."""

    @abstractmethod
    def chooser(self, groups: Sequence[Group], support: BoolArray) -> Choose:
        """The choice of supports during one solve that starts on `support`."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        """c (k,) and its support. A failure returns the last iterate that was finite."""
        with np.errstate(all="ignore"):  # overflow is a status here, not a warning
            return self._iterate(problem, *within_budget(problem, start))

    def _iterate(self, problem: SparseProblem, c: FloatArray, support: BoolArray) -> SparseOutcome:
        groups, visits, explore = problem.groups, Visits(), True
        choose = self.chooser(groups, support)
        good = SparseOutcome(c, support, Status.NOT_FINITE, 0, float("inf"))
        for iteration in range(1, self.max_iterations + 1):
            r = problem.residual(c)
            linear = Linearised.at(c, r, problem.jacobian(c))
            if not linear.finite:
                return replace(good, status=Status.NOT_FINITE, iterations=iteration)
            good = SparseOutcome(c, support, Status.DONE, iteration, float(np.linalg.norm(r)))
            if explore and (self.counts_start or iteration > 1) and visits.note(good):
                explore, good = False, visits.best()
                c, support = good.c, good.support
                continue
            found = choose(linear, support, explore)
            if isinstance(found, Status):
                return replace(good, status=found, iterations=iteration)
            settled = np.array_equal(found.active, support) and small_step(
                linear, found, groups, self.rtol)
            c, support = linear.unscaled(found.z), found.active
            if settled:
                return ended(problem, c, good, Status.DONE, iteration)
        last = ended(problem, c, good, Status.NOT_CONVERGED, self.max_iterations)
        if last.status is Status.NOT_FINITE:
            return last
        visits.note(replace(last, support=support))
        return replace(visits.best(), status=last.status, iterations=last.iterations)


class LinearRecovery(SupportNewton):
    """Newton's method whose every step recovers a support again, on the linearised problem.

    1 linearise, columns scaled to unit length; 2 rotate the unpenalised columns out; 3 recover
    sparse coefficients (`recover`, the only thing that differs between these solvers); 4 keep the
    `budget` largest of each group; 5 least squares on them and the unpenalised columns
    (debiasing); repeat. The start gives the point of the first linearisation; its support does not
    bias the recovery.
    """

    counts_start: ClassVar[bool] = False

    @property
    def capabilities(self) -> frozenset[str]:
        """Names of `core.protocols.sparse_solver`."""
        return frozenset(PROBLEM_FEATURES)

    @abstractmethod
    def recover(self, problem: Penalised) -> Recovered:
        """Sparse x with A x = b; more active columns than the budgets allow are pruned later.

        A has a column that is not zero, b is not zero.
        """

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        """As in `SupportNewton`. InputError when the problem needs what this solver has not."""
        refused = solver_refusal("this problem", self, problem.needs)
        if refused:
            raise InputError(refused)
        return super().solve(problem, start)

    def chooser(self, groups: Sequence[Group], support: BoolArray) -> Choose:
        found: Support | None = None

        def choose(linear: Linearised, support: BoolArray, explore: bool) -> Fit | Status:
            nonlocal found
            if explore and (found is None or not found.holds_for(linear)):
                found = self._support(linear, groups)
            if explore and found is not None:
                if not found.status.ok:
                    return found.status
                support = found.active
            return fit(linear, support, self.rank_rtol) or Status.RANK_DEFICIENT

        return choose

    def _support(self, linear: Linearised, groups: Sequence[Group]) -> Support:
        """Steps 2 to 4. Columns that depend on others are left out, not solved blindly."""
        free = always_active(groups, linear.z.size)
        if fit(linear, free, self.rank_rtol) is None:
            return Support(linear, free, Status.RANK_DEFICIENT)
        rest = Penalised.of(linear, groups)
        active = free.copy()
        if not (rest.A.any() and rest.b.any()):
            return Support(linear, active, Status.DONE)
        found = self.recover(rest)
        if not found.status.ok:
            return Support(linear, free, found.status)
        kept = pruned(found.x, found.x != 0.0, rest.groups)
        active[rest.columns[kept]] = True
        if kept.any():
            active = independent(linear, free, active, self.rank_rtol)
        return Support(linear, active, Status.DONE)
