"""Interfaces of sparse recovery: the sparse least-squares problem of a time step, its solvers, and
inexpensive tests (screening) of whether the support would change.

The support is the set of active atoms (trial vectors with nonzero coefficients). A step that starts
from the support of the previous step solves on it first; a solver with screening then tests whether
it would exchange atoms, other solvers run in full in every step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from sparsemor.core.arrays import BoolArray, FloatArray
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
    """Sparse least-squares problem: coefficients c with few nonzero entries per group that minimise
    the 2-norm of residual(c).

    Rows are scaled so that they are comparable. needs: names from `PROBLEM_FEATURES`.
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


class SparseSolver(Protocol):
    """Solver of sparse least-squares problems, warm-started from the support of an earlier step."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome: ...


PROBLEM_FEATURES = {
    "nonlinear": "a residual that is not linear in the coefficients",
    "unpenalised": "columns that are always active (groups without a budget)",
    "overdetermined": "more rows than columns (least squares)",
    "underdetermined": "fewer rows than columns",
}
"""Feature of a sparse problem -> its meaning in words."""


@runtime_checkable
class LimitsProblems(Protocol):
    """A sparse solver that accepts only problems with certain features of `PROBLEM_FEATURES`."""

    @property
    def capabilities(self) -> frozenset[str]:
        """Names of the accepted features."""
        ...


def missing(solver: SparseSolver, needs: frozenset[str]) -> tuple[str, ...]:
    """Features among `needs` that a solver does not accept; a solver without limits accepts all."""
    return tuple(sorted(needs - solver.capabilities)) if isinstance(solver, LimitsProblems) else ()


def solver_refusal(name: str, solver: SparseSolver, needs: frozenset[str]) -> str:
    """Reason why `solver` cannot solve a problem called `name`, "" if it can."""
    lacking = missing(solver, needs)
    if not lacking:
        return ""
    what = "; ".join(f"{c}: {PROBLEM_FEATURES.get(c, 'unknown')}" for c in lacking)
    return f"{type(solver).__name__} cannot solve {name}, which needs {what}"


class GramError(NamedTuple):
    """Round-off error bounds of a Gram matrix: relative error of magnitudes that are compared, and
    error of d.gram d relative to d.d."""

    sizes: float
    gram: float


class Quadratic(NamedTuple):
    """Quadratic model of a linear least-squares problem: |residual(c + d)|^2 = |residual(c)|^2 + 2
    slope.d + d.gram d, at the solution c of a step.

    gram (k, k): Gram matrix in Fortran order, of which only the upper triangle is read; slope, c
    (k,), c zero off the support. All refer to columns of about unit length; lengths (k,): factors
    that restore the columns of the original problem, in which coefficients are compared. gram and
    lengths remain the same objects as long as they do not change.

    error: error bounds of gram and slope. exact(): the same model with almost no error at higher
    cost; None if it is already exact. left(): |residual(c)|^2, and the squared norm of the
    eliminated unknowns times their column lengths, against which round-off is judged.
    """

    gram: FloatArray
    slope: FloatArray
    c: FloatArray
    lengths: FloatArray
    error: GramError
    exact: "Callable[[], Quadratic] | None"
    left: Callable[[], tuple[float, float]]


class Reason(Protocol):
    """Certificate that a support remains optimal while gram is constant, as linear functions of
    slope and c: values (m,) = slope @ at.slope + c @ at.c, with these two (m, k)."""

    @property
    def slope(self) -> FloatArray: ...
    @property
    def c(self) -> FloatArray: ...
    @property
    def parts(self) -> tuple[slice, ...]:
        """Slices of `values` with a common meaning."""
        ...

    def holds(self, values: FloatArray, relative: float, absolute: Sequence[float]) -> bool:
        """True if the support certainly remains. relative: relative error of magnitudes; absolute:
        absolute error of each of the `parts`."""
        ...


class Screen(Protocol):
    """Screening of one sparse solver for a linear residual: support changes decided from the Gram
    matrix."""

    def stays(self, at: Quadratic, support: BoolArray) -> bool:
        """True if an inexpensive test proves that the solver would end on the support from which it
        starts.

        Applies also to several independent problems, each a group with its own rows.
        """
        ...

    def settle(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """Support (k,) on which the solver would end, started from c on `support`; the same object
        if it does not change. None if an intermediate decision is within the error bounds, so that
        the solver must be run."""
        ...

    def reason(self, at: Quadratic, support: BoolArray) -> Reason | None:
        """Certificate for a support that has just been retained; None if there is none of this
        form."""
        ...

    def unlike(self, old: Quadratic, new: Quadratic, support: BoolArray) -> GramError:
        """Bound on the error in the selection criteria when `old` replaces `new` at the same c."""
        ...


@runtime_checkable
class ScreensSupport(Protocol):
    """A sparse solver with an inexpensive test of whether it would exchange atoms (columns)."""

    def screen(self, groups: Sequence[Group], seen: BoolArray, rows: int) -> Screen:
        """Screening for problems with these groups, all of which have budgets. seen (k,): True for
        nonzero columns; rows: number of rows of the problem for these columns."""
        ...
