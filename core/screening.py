"""Asking a sparse solver cheaply whether it would exchange atoms (optional part of a solver).

A step that carries a support solves on it first and then asks. A solver without `screen` is
simply run in full in every step.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols import Group


class Tolerance(NamedTuple):
    """Relative error of what decides: of sizes that are compared, and of norms that are left."""

    sizes: float
    norms: float


class Screen(Protocol):
    """The exchanges of one solver on residual(c + d) = r + J d with a J that stays."""

    def stays(
        self, r: FloatArray, c: FloatArray, support: BoolArray, sizes: float
    ) -> bool:
        """Is it sure, and cheap to see, that the solver would end on the support it starts from?

        sizes: as in Tolerance. Also for several problems side by side, each a group with rows of
        its own.
        """
        ...

    def settle(
        self, r: FloatArray, c: FloatArray, support: BoolArray, beside: float,
        tolerance: Tolerance,
    ) -> BoolArray | None:
        """The support (k,) on which the solver would end, started from c (k,) on `support`.

        r (m,) is the residual at c. beside: norm of the unknowns that were eliminated, each times
        the length of its column; rounding is judged against them, too. None when a decision on
        the way is closer than `tolerance`: run the solver.
        """
        ...

    def unlike(
        self, other: "Screen", r: FloatArray, c: FloatArray, support: BoolArray
    ) -> Tolerance:
        """How far the quantities that decide here are from those of another screen for the same
        groups: what a J that has grown old gets wrong."""
        ...


@runtime_checkable
class Screening(Protocol):
    """What a sparse solver may have besides `solve`."""

    def screen(
        self, J: FloatArray, norms: FloatArray, groups: Sequence[Group], rows: int
    ) -> Screen:
        """J (m, k): columns of `groups`, which all have budgets. norms (k,): lengths of the same
        columns in the problem that `solve` would see, which has `rows` rows for them."""
        ...
