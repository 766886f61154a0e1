"""Residual and Jacobian of a projected term in one call."""

from collections.abc import Callable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import Linearizes, ReducedTerm

Linearized = Callable[
    [FloatArray, FloatArray, FloatArray, float, FloatArray, FloatArray],
    tuple[FloatArray, FloatArray]]
"""Function of x, v, a, t, c1, c2 that returns the residual (l,) and the Jacobian (l, k)."""


def linearization(term: ReducedTerm) -> Linearized:
    """Residual and Jacobian of a reduced term as one function."""
    if isinstance(term, Linearizes):
        return term.linearized

    def both(
        x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        return term.residual(x, v, a, t), term.jacobian(x, v, a, t, c1, c2)

    return both
