"""Contract of sparse recovery: sparse least-squares problems, and solvers of these.

The support is the set of active atoms (trial vectors with nonzero coefficients). A solver treats
two kinds of problems. `solve`: a nonlinear residual of several groups of columns, such as the rows
of all bodies and joints of a step (Liang et al. 2026, Eq. 25). `prepare`: a linear residual of one
group with a constant matrix, such as the sampled rows of one body while the other unknowns of the
step are held; its factors are computed once, and each step selects a support for another residual.
By default `prepare` selects what `solve` selects for the linear problem.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Protocol

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True)
class Group:
    """Columns `start:stop` of a sparse problem. budget: largest number of active columns; None:
    always active, not penalised."""

    name: str
    start: int
    stop: int
    budget: int | None


class SparseProblem(Protocol):
    """Sparse least-squares problem: coefficients c (k,) with few nonzero entries per group that
    minimise the 2-norm of residual(c) (m,), whose Jacobian is (m, k). A group is a range of
    coefficients with its own largest number of nonzero ones.

    Rows are scaled so that they are comparable. needs: names from `PROBLEM_FEATURES`. jacobian: the
    same array object for two c only if the Jacobian is the same, because solvers then keep its
    column lengths; it is never changed in place.
    """

    @property
    def needs(self) -> frozenset[str]: ...
    @property
    def groups(self) -> tuple[Group, ...]: ...
    def residual(self, c: FloatArray) -> FloatArray: ...
    def jacobian(self, c: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class SparseStart:
    """First guess c (k,) and the support (k,), True for columns active in the previous step."""

    c: FloatArray
    support: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class SparseOutcome:
    """Solution of a sparse problem: c (k,) is zero outside `support` (k,) in every group with a
    budget."""

    c: FloatArray
    support: BoolArray
    status: Status
    iterations: int
    residual_norm: float


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """Support (k,) on which a sparse solver ends for a linear problem, and its status; after a
    failure the support from which it started."""

    support: BoolArray
    status: Status = Status.DONE


class Columns(Protocol):
    """Constant columns A (m, k) of a linear problem, of unit length or zero, with least squares min
    |A x - b| on subsets of them.

    The factors of recent subsets are kept and shared by the solver and the reducer; they do not
    depend on the order of the calls, so that several threads may use them. A subset is a mask (k,);
    linearly dependent columns, to the accuracy that a step needs, are reported by None.
    """

    @property
    def A(self) -> FloatArray: ...
    def independent(self, subset: BoolArray) -> bool:
        """True if the columns of the subset are linearly independent."""
        ...
    def solution(self, subset: BoolArray, b: FloatArray) -> FloatArray | None:
        """Least-squares solution x (k,), zero outside the subset."""
        ...
    def squared_residual(self, subset: BoolArray, b: FloatArray) -> float | None:
        """|A x - b|^2 of the least-squares solution x."""
        ...


class Recovery(Protocol):
    """Selection of supports for linear problems min |r + J d| with one constant matrix J.

    It contains constant arrays and may be used by several threads at once: equal arguments give
    equal supports.
    """

    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        """Support (k,), within the budget, on which the solver ends when started from coefficients
        c (k,) with the residual r (m,), the least-squares solution on `support`. In the first step
        of a run `support` exceeds the budget: all columns that the rows distinguish."""
        ...


PROBLEM_FEATURES = {
    "nonlinear": "a residual that is not linear in the coefficients",
    "unpenalised": "columns that are always active (groups without a budget)",
    "overdetermined": "more rows than columns (least squares)",
    "underdetermined": "fewer rows than columns",
}
"""Feature of a sparse problem -> its meaning in words."""


class SparseSolver(Plugin):
    """Solver of sparse least-squares problems, warm-started from the support of an earlier step."""

    @property
    def capabilities(self) -> frozenset[str]:
        """Features of the problems that it accepts, names from `PROBLEM_FEATURES`."""
        return frozenset(PROBLEM_FEATURES)

    @abstractmethod
    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        """Coefficients c (k,), their support and a status. Raises InputError for a problem with a
        feature that it does not accept."""

    def prepare(self, columns: Columns, budget: int) -> Recovery:
        """Recovery for a constant matrix J (m, k) = columns.A. budget: largest number of active
        columns; a column of zeros cannot be active. Raises InputError for a shape that it does not
        accept."""
        refused = solver_refusal("this problem", self, shape_features(columns.A))
        if refused:
            raise InputError(refused)
        return _SolvedRecovery(self, columns.A, budget)


def shape_features(J: FloatArray) -> frozenset[str]:
    """Features of a linear problem that follow from the shape of its matrix J (m, k)."""
    m, k = J.shape
    return frozenset({"overdetermined"} if m > k else {"underdetermined"} if m < k else ())


@dataclass(frozen=True, slots=True, eq=False)
class _LinearProblem:
    """Linear problem of one group: |J c - b|, with at most `budget` active columns."""

    J: FloatArray
    b: FloatArray
    budget: int

    @property
    def needs(self) -> frozenset[str]:
        return shape_features(self.J)

    @property
    def groups(self) -> tuple[Group, ...]:
        return (Group("", 0, self.J.shape[1], self.budget),)

    def residual(self, c: FloatArray) -> FloatArray:
        return self.J @ c - self.b

    def jacobian(self, c: FloatArray) -> FloatArray:
        return self.J


@dataclass(frozen=True, slots=True, eq=False)
class _SolvedRecovery:
    """Recovery by the nonlinear solve of a sparse solver, for constant columns J (m, k). budget:
    largest number of active columns. From the residual r (m,) at coefficients c (k,), it solves
    min |J c' - (J c - r)|."""

    solver: SparseSolver
    J: FloatArray
    budget: int

    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        found = self.solver.solve(
            _LinearProblem(self.J, self.J @ c - r, self.budget), SparseStart(c, support))
        return Selection(found.support if found.status.ok else support, found.status)


def missing(solver: SparseSolver, needs: frozenset[str]) -> tuple[str, ...]:
    """Features among `needs` that a solver does not accept."""
    return tuple(sorted(needs - solver.capabilities))


def solver_refusal(name: str, solver: SparseSolver, needs: frozenset[str]) -> str:
    """Reason why `solver` cannot solve a problem called `name`, "" if it can."""
    lacking = missing(solver, needs)
    if not lacking:
        return ""
    what = "; ".join(f"{c}: {PROBLEM_FEATURES.get(c, 'unknown')}" for c in lacking)
    return f"{type(solver).__name__} cannot solve {name}, which needs {what}"
