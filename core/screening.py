"""Asking a sparse solver cheaply whether it would exchange atoms (optional part of a solver).

A step that carries a support solves on it first and then asks. A solver without `screen` is
simply run in full in every step.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols import Group


class Error(NamedTuple):
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
    error: Error
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
        handed back itself if it stays. None when a decision on the way is closer than the error:
        run the solver."""
        ...

    def reason(self, at: Quadratic, support: BoolArray) -> Reason | None:
        """Why the support has just stayed; None where that cannot be said so."""
        ...

    def unlike(self, old: Quadratic, new: Quadratic, support: BoolArray) -> Error:
        """What `old` gets wrong of what decides, at the same c."""
        ...


@runtime_checkable
class Screening(Protocol):
    """What a sparse solver may have besides `solve`."""

    def screen(self, groups: Sequence[Group], seen: BoolArray, rows: int) -> Screen:
        """For problems with these groups, which all have budgets. seen (k,): columns that are not
        zero; rows: those that the problem of `solve` has for these columns."""
        ...
