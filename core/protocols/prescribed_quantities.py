"""Prescribed values of constraints, and their time derivatives from the right."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.integrator import TimeFunction

SHARE = 1e-2
"""Step of finite differences in time, relative to the time step."""
_FIRST = (4.0, -3.0, 4.0 / 3.0, -0.25)
_SECOND = (-77.0 / 6.0, 107.0 / 6.0, -13.0, 61.0 / 12.0, -5.0 / 6.0)


@runtime_checkable
class Differentiable(Protocol):
    """A function of time that returns its first and second derivatives from the right, per s and
    per s^2. h: time step, s, the scale of any finite differences."""

    def derivatives(self, t: float, h: float) -> tuple[float, float]: ...


@dataclass(frozen=True, slots=True)
class Held:
    """Constant function of time."""

    level: float

    def __call__(self, t: float) -> float:
        return self.level

    def derivatives(self, t: float, h: float) -> tuple[float, float]:
        return 0.0, 0.0


@dataclass(frozen=True, slots=True)
class Prescribed:
    """Prescribed value start + function.value(t). Without a `curvature`, the second
    derivative is a finite difference of the function's rate."""

    function: TimeFunction
    start: float = 0.0

    def __call__(self, t: float) -> float:
        return self.start + self.function.value(t)

    def derivatives(self, t: float, h: float) -> tuple[float, float]:
        f = self.function
        bend = f.curvature(t)
        return f.rate(t), _scalar(f.rate, 1, t, h) if bend is None else bend


def time_derivatives(function: Callable[[float], float], t: float, h: float) -> tuple[float, float]:
    """First and second derivatives of `function` from the right at t, s; exact for a
    `Differentiable` function. h: time step, s."""
    if isinstance(function, Differentiable):
        return function.derivatives(t, h)
    return _scalar(function, 1, t, h), _scalar(function, 2, t, h)


def _scalar(function: Callable[[float], float], order: int, t: float, h: float) -> float:
    return float(derivative_from_right(lambda s: np.array(function(s)), order, t, h))


def derivative_from_right(
    function: Callable[[float], FloatArray], order: int, t: float, h: float
) -> FloatArray:
    """Derivative of order 1 or 2 by fourth-order one-sided differences with step SHARE h, since a
    prescribed motion may have a kink at t. Exactly zero for a constant."""
    first, step = function(t), SHARE * h
    weights = _FIRST if order == 1 else _SECOND
    changes = (w * (function(t + k * step) - first) for k, w in enumerate(weights, 1))
    return np.asarray(sum(changes, 0.0 * first) / step**order)
