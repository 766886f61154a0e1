"""Equations of a floating frame as a function on arrays, which can be compiled."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.body_frame import Frame
from sparsemor.core.protocols.separable import Amplitude

FrameFunction: TypeAlias = Callable[
    [IntArray, FloatArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float,
     FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], None]
"""`Frame.evaluate` on arrays:

    function(kinds, numbers, starts, gains, y, v, a, c1, c2, s, forms, sigma, tau, border,
             coefficients)

with the arrays of `FrameArrays`, the present values `gains` (i,) of its amplitudes, the inputs of
`Frame.evaluate` and the arrays of `FrameWork`, which it fills.
"""


@dataclass(frozen=True, slots=True, eq=False)
class FrameArrays:
    """A frame as a function of numbers.

    kinds (i,), numbers (i, j), starts (i, 3): of each contribution its kind, constants, and first
    functional, coordinate of another body, and multiplier; amplitudes (i,): None for those without.
    function: uses numbers and arrays only, so that numba can compile it; calls: the functions that
    it calls, each after those that it calls itself.
    """

    kinds: IntArray
    numbers: FloatArray
    starts: IntArray
    amplitudes: tuple[Amplitude | None, ...]
    function: FrameFunction
    calls: tuple[Callable[..., object], ...]


@runtime_checkable
class HasArrays(Frame, Protocol):
    """A frame whose equations are also a function on arrays; steps of models with other frames are
    not compiled."""

    def arrays(self) -> FrameArrays | None:
        """The function with its numbers, None where a contribution has none."""
        ...
