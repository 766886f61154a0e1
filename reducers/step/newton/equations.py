"""The equations of a whole step that Newton's method solves."""

from collections.abc import Sequence
from typing import Protocol, Self

from sparsemor.core import FloatArray, FrameWork, IntArray, Layout, ReducedTerm, Term
from sparsemor.reducers.step.newton.memory import Factor, Matrix, NewtonMemory
from sparsemor.reducers.step.rejection import Checked


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

    @property
    def terms(self) -> Sequence[tuple[Term | ReducedTerm, IntArray]]:
        """Terms that are evaluated in each iteration, each with its columns."""
        ...

    @property
    def checks(self) -> Sequence[Checked]:
        """Those of them that check steps."""
        ...

    def buffers(self) -> Sequence[FrameWork]:
        """Working arrays for one run or one thread."""
        ...

    def of_run(self, memory: NewtonMemory) -> Self:
        """The same equations with the working arrays, and the terms' copies, of one run."""
        ...

    def prescribed(self, t: float) -> FloatArray:
        """(n,) the part of the residual that depends on the time (s) alone."""
        ...

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, prescribed: FloatArray
    ) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix:
        """(n, n), dense or csc; c1, c2 (n,) a unknown."""
        ...

    def factorize(self, J: Matrix) -> Factor:
        """Raises RuntimeError when J is singular."""
        ...
