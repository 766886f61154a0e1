"""Protocol of the equations of a whole step, solved by Newton's method."""

from collections.abc import Sequence
from typing import Protocol, Self

from sparsemor.core import FloatArray, FrameWork, IntArray, Layout, ReducedTerm, Term
from sparsemor.reducers.step.newton.memory import Factor, Matrix, NewtonMemory
from sparsemor.reducers.step.rejection import Checked


class Equations(Protocol):
    """Equations of one model: n residuals for the n unknowns of `layout`.

    price: cost of a new factorization in iterations with the old one; 0: a new one in each
    iteration.
    """

    @property
    def layout(self) -> Layout: ...
    @property
    def price(self) -> int: ...
    @property
    def named(self) -> Sequence[tuple[str, frozenset[str]]]:
        """Terms that couple blocks: name in the scene, and the coupled blocks."""
        ...

    @property
    def terms(self) -> Sequence[tuple[Term | ReducedTerm, IntArray]]:
        """Terms that are evaluated in each iteration, each with the numbers of its unknowns."""
        ...

    @property
    def checks(self) -> Sequence[Checked]:
        """Terms that can reject a converged step, each with the numbers of its unknowns."""
        ...

    def buffers(self) -> Sequence[FrameWork]:
        """Working arrays for one run or one thread."""
        ...

    def of_run(self, memory: NewtonMemory) -> Self:
        """These equations with the working arrays and local copies of terms of one run."""
        ...

    def prescribed(self, t: float) -> FloatArray:
        """The part (n,) of the residual that depends on the time (s) alone."""
        ...

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, prescribed: FloatArray
    ) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix:
        """Jacobian (n, n), dense or csc, for dv = c1 dx and da = c2 dx; c1, c2 (n,)."""
        ...

    def factorize(self, J: Matrix) -> Factor:
        """Factorization of a Jacobian. Raises RuntimeError when it is singular."""
        ...
