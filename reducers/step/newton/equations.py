"""The equations of a whole step that Newton's method solves."""

from collections.abc import Sequence
from typing import Any, Protocol

from sparsemor.core import FloatArray, Layout


class Equations(Protocol):
    """One model's equations: n rows for the n unknowns of `layout`.

    price: of a new factor, in iterations with the old one; 0: a new one in each iteration.
    """

    @property
    def layout(self) -> Layout: ...
    @property
    def price(self) -> int: ...
    @property
    def named(self) -> Sequence[tuple[str, frozenset[str]]]:
        """Couplings of blocks: name in the scene, and the blocks."""
        ...

    def with_work(self) -> "Equations":
        """The same equations with working arrays of their own, for one run or one thread."""
        ...

    def given(self, t: float) -> FloatArray:
        """(n,) the part of the residual that depends on the time (s) alone."""
        ...

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, given: FloatArray
    ) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        """(n, n), dense or csc; c1, c2 (n,) a unknown."""
        ...

    def factorize(self, J: Any) -> Any:
        """Something with `solve(r)`. Raises RuntimeError when J is singular."""
        ...
