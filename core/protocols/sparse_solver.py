"""Sparse recovery: the problem, its solvers, and their optional screening of supports.

A step that carries a support solves on it first. A solver that screens supports then tests cheaply
whether it would exchange atoms; another one is run in full in every step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True)
class Group:
    """Columns `start:stop` of a sparse problem. budget None: always active, not penalised."""

    name: str
    start: int
    stop: int
    budget: int | None


class SparseProblem(Protocol):
    """Find c with few active entries per group so that residual(c) is least in the 2-norm.

    Rows come scaled: they may be compared and summed. `needs`: names in `PROBLEM_FEATURES`.
    """

    @property
    def needs(self) -> frozenset[str]: ...
    @property
    def groups(self) -> tuple[Group, ...]: ...
    def residual(self, c: FloatArray) -> FloatArray: ...
    def jacobian(self, c: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class SparseStart:
    """First guess c (k,) and the support (k,) bool that earlier steps left active."""

    c: FloatArray
    support: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class SparseOutcome:
    """c (k,) is zero outside `support` in every budgeted group."""

    c: FloatArray
    support: BoolArray
    status: Status
    iterations: int
    residual_norm: float


class SparseSolver(Protocol):
    """Search for few active columns, started from a support that earlier steps left."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome: ...


PROBLEM_FEATURES = {
    "nonlinear": "a residual that is not linear in the coefficients",
    "unpenalised": "columns that are always active (groups without a budget)",
    "overdetermined": "more rows than columns (least squares)",
    "underdetermined": "fewer rows than columns",
}
"""Feature of a sparse problem -> its meaning."""


@runtime_checkable
class LimitsProblems(Protocol):
    """A sparse solver that takes only problems with some of the `PROBLEM_FEATURES`."""

    @property
    def capabilities(self) -> frozenset[str]:
        """Names of the features that it can take."""
        ...


def missing(solver: SparseSolver, needs: frozenset[str]) -> tuple[str, ...]:
    """The features among `needs` that a solver does not take; one without limits takes all."""
    return tuple(sorted(needs - solver.capabilities)) if isinstance(solver, LimitsProblems) else ()


def solver_refusal(name: str, solver: SparseSolver, needs: frozenset[str]) -> str:
    """Why `solver` cannot take a problem called `name`; "" when it can."""
    lacking = missing(solver, needs)
    if not lacking:
        return ""
    what = "; ".join(f"{c}: {PROBLEM_FEATURES.get(c, 'unknown')}" for c in lacking)
    return f"{type(solver).__name__} cannot solve {name}, which needs {what}"


class GramError(NamedTuple):
    """Relative error of sizes that are compared, and error of d.gram d over d.d."""

    sizes: float
    gram: float


class Quadratic(NamedTuple):
    """|residual(c + d)|^2 = |residual(c)|^2 + 2 slope.d + d.gram d, at the solution c of a step.

    gram (k, k): in Fortran order, only its upper triangle is read. slope, c (k,), c zero off the
    support. All for columns of about unit length; lengths (k,): by what they have to be multiplied
    to have those in the problem that `solve` would see, which are what coefficients are weighed
    with. gram and lengths are the same objects for as long as nothing changes in them.

    error: of gram and slope. exact(): the same with hardly any, at a price; None where this is
    it already. left(): |residual(c)|^2, and the squared norm of the unknowns that were
    eliminated, each times the length of its column: rounding is judged against them, too.
    """

    gram: FloatArray
    slope: FloatArray
    c: FloatArray
    lengths: FloatArray
    error: GramError
    exact: "Callable[[], Quadratic] | None"
    left: Callable[[], tuple[float, float]]


class Reason(Protocol):
    """Why a support stays as long as gram is the same, from linear functions of slope and c:
    values = slope @ at.slope + c @ at.c, with these two (m, k)."""

    @property
    def slope(self) -> FloatArray: ...
    @property
    def c(self) -> FloatArray: ...
    @property
    def parts(self) -> tuple[slice, ...]:
        """Values of one kind each."""
        ...

    def holds(self, values: FloatArray, relative: float, absolute: Sequence[float]) -> bool:
        """Does the support stay, for sure? relative: error of sizes; absolute: of each part."""
        ...


class Screen(Protocol):
    """The exchanges of one solver where the residual is linear, answered from its Gram matrix."""

    def stays(self, at: Quadratic, support: BoolArray) -> bool:
        """Is it sure, and cheap to see, that the solver would end on the support it starts from?

        Also for several problems side by side, each a group with rows of its own.
        """
        ...

    def settle(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """The support (k,) on which the solver would end, started from c on `support`, which is
        returned itself if it stays. None when an intermediate decision is closer than the
        error: run the solver."""
        ...

    def reason(self, at: Quadratic, support: BoolArray) -> Reason | None:
        """Why the support has just stayed; None where that cannot be said so."""
        ...

    def unlike(self, old: Quadratic, new: Quadratic, support: BoolArray) -> GramError:
        """Bound on the error in the selection criteria when `old` replaces `new` at the same c."""
        ...


@runtime_checkable
class ScreensSupport(Protocol):
    """A sparse solver that tests cheaply whether it would exchange atoms."""

    def screen(self, groups: Sequence[Group], seen: BoolArray, rows: int) -> Screen:
        """For problems with these groups, which all have budgets. seen (k,): columns that are not
        zero; rows: those that the problem of `solve` has for these columns."""
        ...
