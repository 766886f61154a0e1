"""Newton's method with changing supports: base classes of the sparse solvers."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from sparsemor.core import (
    PROBLEM_FEATURES,
    BoolArray,
    Columns,
    FloatArray,
    Group,
    InputError,
    Recovery,
    Selection,
    SparseOutcome,
    SparseProblem,
    SparseSolver,
    SparseStart,
    Status,
)
from sparsemor.core.linalg.dense import orthonormal
from sparsemor.core.protocols.sparse_solver import solver_refusal
from sparsemor.plugins.sparse_solvers.penalised import Penalised, PreparedColumns
from sparsemor.plugins.sparse_solvers.supports import (
    EPS,
    Fit,
    Linearised,
    Visits,
    always_active,
    ended,
    fit,
    independent,
    largest,
    pruned,
    small_step,
    within_budget,
)


@dataclass(frozen=True, slots=True, eq=False)
class Recovered:
    """Sparse solution x (k,) of a `Penalised` problem, or the status of a failure. Columns with x =
    0 are not active."""

    x: FloatArray
    status: Status = Status.DONE


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """Active columns found for one linearisation, and the status of the search."""

    linear: Linearised
    active: BoolArray
    status: Status

    def holds_for(self, other: Linearised) -> bool:
        """True if another linearisation is the same linear problem, so that its support is the
        same."""
        mine, its = self.linear, other
        if not np.array_equal(mine.J, its.J):
            return False
        # right-hand sides of min |J x - b|: of the residual r at scaled coefficients z
        a, b = mine.J @ mine.z - mine.r, its.J @ its.z - its.r
        return float(np.linalg.norm(a - b)) <= 1e-12 * float(np.linalg.norm(a))


Choose = Callable[[Linearised, BoolArray, bool], Fit | Status]
"""Function of the linearisation at the present iterate, its support, and whether the support may
change; returns the least-squares fit on the support of the next iterate, or the status of a
failure."""


class SupportNewton(SparseSolver):
    """Newton's method in which every step may change the support (set of active columns).

    It ends when neither the support nor the coefficients change. A support that returns after it
    was left is a cycle: from then on, plain Gauss-Newton on the best support found.
    """

    rtol: float = Field(default=1e-8, gt=0.0, lt=1.0)
    """Convergence tolerance: step of each group relative to the group's norm (both scaled by column
    norms)."""
    max_iterations: int = Field(default=100, ge=1)
    """Largest number of linearisations; then the solve ends as not converged. On a support that
    leaves a large residual, Gauss-Newton contracts slowly."""
    rank_rtol: float = Field(default=1e-12, gt=0.0, lt=1.0)
    """Reciprocal condition number at which active columns count as dependent."""

    counts_start: ClassVar[bool] = True
    """True if the initial support takes part in the detection of cycles."""

    @abstractmethod
    def chooser(self, groups: Sequence[Group], support: BoolArray) -> Choose:
        """Function that selects the support of the next iterate, for one solve that starts on
        `support`."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        """Coefficients c (k,), their support and a status. After a failure, the last finite
        iterate."""
        with np.errstate(all="ignore"):  # overflow is a status here, not a warning
            return self._iterate(problem, *within_budget(problem, start))

    def _iterate(self, problem: SparseProblem, c: FloatArray, support: BoolArray) -> SparseOutcome:
        """Newton's method in which each linearisation may change the support; when a support
        returns, the best one is kept and solved.

        explore: True while the support may change; good: the last iterate with a finite residual;
        choose: fit on the support of the next iterate (`chooser`); counts_start: True if a return
        to the initial support counts, too.
        """
        groups, visits, explore = problem.groups, Visits(), True
        choose = self.chooser(groups, support)
        good = SparseOutcome(c, support, Status.NOT_FINITE, 0, float("inf"))
        linear, last_J = None, None
        for iteration in range(1, self.max_iterations + 1):
            r, J = problem.residual(c), problem.jacobian(c)
            if linear is None or J is not last_J:
                linear, last_J = Linearised.at(c, r, J), J
            else:
                linear = linear.moved(c, r)
            if not linear.finite:
                return replace(good, status=Status.NOT_FINITE, iterations=iteration)
            good = SparseOutcome(c, support, Status.DONE, iteration, float(np.linalg.norm(r)))
            if explore and (self.counts_start or iteration > 1) and visits.note(good):
                explore, good = False, visits.best()
                c, support = good.c, good.support
                continue
            next_fit = choose(linear, support, explore)
            if isinstance(next_fit, Status):
                return replace(good, status=next_fit, iterations=iteration)
            converged = np.array_equal(next_fit.active, support) and small_step(
                linear, next_fit, groups, self.rtol)
            c, support = linear.unscaled(next_fit.z), next_fit.active
            if converged:
                return ended(problem, c, good, Status.DONE, iteration)
        last = ended(problem, c, good, Status.NOT_CONVERGED, self.max_iterations)
        if last.status is Status.NOT_FINITE:
            return last
        visits.note(replace(last, support=support))
        return replace(visits.best(), status=last.status, iterations=last.iterations)


class LinearRecovery(SupportNewton):
    """Newton's method in which every step recovers the support again, from the linearised problem.

    1 linearise, columns scaled to unit length; 2 eliminate the unpenalised columns by an orthogonal
    transformation; 3 recover sparse coefficients (`recover`, defined by each subclass); 4 keep the
    `budget` largest of each group; 5 least squares on them and the unpenalised columns (debiasing);
    repeat. The initial iterate is the point of the first linearisation; its support does not bias
    the recovery.
    """

    counts_start: ClassVar[bool] = False

    @property
    def capabilities(self) -> frozenset[str]:
        """Supported features of problems, keys of
        `core.protocols.sparse_solver.PROBLEM_FEATURES`."""
        return frozenset(PROBLEM_FEATURES)

    @property
    def keeps_largest(self) -> bool:
        """True if the solution for orthonormal columns is that of the `budget` largest
        coefficients A^T b, the best support."""
        return False

    @abstractmethod
    def recover(self, problem: Penalised) -> Recovered:
        """Sparse coefficients x (k,) with A x = b; more active columns than budgeted are pruned
        later.

        A has a nonzero column, and b is not zero.
        """

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        """Solution as in `SupportNewton`. Raises InputError when the problem has a feature that
        this solver does not support."""
        refused = solver_refusal("this problem", self, problem.needs)
        if refused:
            raise InputError(refused)
        return super().solve(problem, start)

    def prepare(self, columns: Columns, budget: int) -> Recovery:
        """Recovery from constant columns. Raises InputError for a shape that this solver does not
        support."""
        J = columns.A
        m, k = J.shape
        shape = {"overdetermined"} if m > k else {"underdetermined"} if m < k else set[str]()
        refused = solver_refusal("this problem", self, frozenset(shape))
        if refused:
            raise InputError(refused)
        direct = self.keeps_largest and orthonormal(J)  # the best support without a solve
        return PreparedRecovery(
            self, J, PreparedColumns.from_matrix(J, budget), budget if direct else None)

    def chooser(self, groups: Sequence[Group], support: BoolArray) -> Choose:
        """Choice of the support of each linearisation: recovered again only where the linear
        problem has changed, whatever the initial `support` is."""
        found: Support | None = None

        def choose(linear: Linearised, support: BoolArray, explore: bool) -> Fit | Status:
            nonlocal found
            if explore and (found is None or not found.holds_for(linear)):
                found = self._support(linear, groups)
            if explore and found is not None:
                if not found.status.ok:
                    return found.status
                support = found.active
            # without `explore` the support of the iterate stays
            return fit(linear, support, self.rank_rtol) or Status.RANK_DEFICIENT

        return choose

    def _support(self, linear: Linearised, groups: Sequence[Group]) -> Support:
        """Support after steps 2 to 4: unpenalised columns (always active) eliminated, sparse
        coefficients of the rest recovered and pruned to the budgets. Columns that depend linearly
        on others are left out."""
        free = always_active(groups, linear.z.size)
        if fit(linear, free, self.rank_rtol) is None:
            return Support(linear, free, Status.RANK_DEFICIENT)
        rest = Penalised.from_linearised(linear, groups)
        active = free.copy()
        if not (rest.A.any() and rest.b.any()):
            return Support(linear, active, Status.DONE)
        found = self.recover(rest)
        if not found.status.ok:
            return Support(linear, free, found.status)
        kept = pruned(found.x, found.x != 0.0, rest.groups)
        active[rest.columns[kept]] = True
        if kept.any():
            active = independent(linear.J, free, active, self.rank_rtol)
        return Support(linear, active, Status.DONE)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedRecovery:
    """Recovery by a solver that starts from no support: sparse x with J x = J c - r, for constant
    columns J (m, k). largest: number of active columns where they are those of the largest
    coefficients, since columns are orthonormal."""

    solver: LinearRecovery
    J: FloatArray
    columns: PreparedColumns
    largest: int | None

    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        """Support of the largest recovered coefficients, without linearly dependent columns. r
        (m,): residual at the coefficients c (k,); `support` is returned after a failure only.
        self.largest: number of atoms where J is orthonormal, so that the largest |J^T b| are the
        best support; None: the solver recovers it."""
        b = self.J.dot(c) - r
        size = float(np.sqrt(b.dot(b)))
        if not size < np.inf:
            return Selection(support, Status.NOT_FINITE)
        if self.largest is not None:
            x = np.abs(b.dot(self.J))
            return Selection(largest(np.where(x > 100.0 * EPS * size, x, 0.0), self.largest))
        problem = self.columns.with_right(b)
        left = float(np.sqrt(problem.b.dot(problem.b)))  # part of b that columns can represent
        if left <= 100.0 * EPS * size:
            return Selection(np.zeros_like(support))
        found = self.solver.recover(problem)
        if not found.status.ok:
            return Selection(support, found.status)
        kept = pruned(found.x, found.x != 0.0, problem.groups)
        if not problem.subsets.independent(kept):
            kept = independent(problem.A, np.zeros_like(kept), kept, self.solver.rank_rtol)
        return Selection(kept)
