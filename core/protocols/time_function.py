"""Functions of time: their contract, functions whose values are set during a run, controllers, and
time derivatives from the right, such as those of prescribed values of constraints."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.plugin import Plugin

SHARE = 1e-2
"""Step of finite differences in time, relative to the time step."""
_FIRST = (4.0, -3.0, 4.0 / 3.0, -0.25)
_SECOND = (-77.0 / 6.0, 107.0 / 6.0, -13.0, 61.0 / 12.0, -5.0 / 6.0)


class TimeFunction(ABC):
    """Scalar function of time, with its rate, for loads and prescribed motion."""

    @abstractmethod
    def value(self, t: float) -> float:
        """Value at t, s."""

    @abstractmethod
    def rate(self, t: float) -> float:
        """First derivative at t, from the right at a kink."""

    def curvature(self, t: float) -> float | None:
        """Exact second derivative at t, from the right at a kink; None: the initial accelerations
        use finite differences of `rate`, scaled by the time step."""
        return None

    def jumps(self, start: float, end: float) -> Sequence[float] | None:
        """Times from start to end (s) at which the value or the slope jumps, so that steps have the
        exact integral of a load (core/protocols/step_amplitude.py); None for a function that never
        jumps."""
        return None


class Function(Plugin, TimeFunction):
    """Function of time as a plugin."""


class HeldValues:
    """Present values of held functions in a run. reads: number of values that were read."""

    def __init__(self, values: "Iterable[tuple[HeldFunction, float]]" = ()) -> None:
        self.values, self.reads = {f.identity: value for f, value in values}, 0


_NONE = HeldValues()
_HELD: ContextVar[HeldValues] = ContextVar("held", default=_NONE)


def held_values() -> HeldValues:
    """Present values of held functions, a copy."""
    if not _HELD.get().values:
        return _NONE
    found = HeldValues()
    found.values = dict(_HELD.get().values)
    return found


@contextmanager
def holding(held: HeldValues) -> Iterator[None]:
    """Held functions that are evaluated inside have these values."""
    token = _HELD.set(held)
    try:
        yield
    finally:
        _HELD.reset(token)


def held_reads() -> int:
    """Number of values of held functions that were read in this run: what is made of them serves
    one step only."""
    return _HELD.get().reads


class HeldFunction(TimeFunction):
    """Function of time whose values are not known before the run, such as an input: each is that
    during one step and at its end (zero-order hold). A run sets it by `holding`; `start` is the
    value before the first step."""

    start: float = 0.0

    @property
    def identity(self) -> object:
        """Key of its value among those of a run."""
        return id(self)

    def value(self, t: float) -> float:
        held = _HELD.get()
        held.reads += 1  # what is made of the value serves this step only (`held_reads`)
        return held.values.get(self.identity, self.start)

    def rate(self, t: float) -> float:
        return 0.0

    def curvature(self, t: float) -> float:
        return 0.0


class Controller(Function, HeldFunction):
    """Controller as a plugin: a function of time whose value in each step (zero-order hold) is
    computed at its beginning from sensors, at the last accepted state.

    It stands where a function of time does. Two with the same options have the same value, so that
    equal scenes may share what is built of one. What it remembers is kept by the run and part of
    its checkpoints.
    """

    @cached_property
    def identity(self) -> object:
        return repr(self)

    @property
    @abstractmethod
    def sensors(self) -> Sequence[str]:
        """Names of the quantities that it reads: those of probes (`tip.u_y`, `tip.temperature`),
        rigid coordinates and rates (`crank.rigid.angle_rate`), and joint forces
        (`hinge.force_x`)."""

    def sensor_key(self, name: str) -> str:
        """Key of the option that names a sensor, for messages."""
        return next((k for k, v in self if v == name), "sensors")

    def begin(self) -> Sequence[float]:
        """Numbers that it remembers before the first step."""
        return ()

    @abstractmethod
    def update(
        self, t: float, h: float, sensed: FloatArray, memory: tuple[float, ...]
    ) -> tuple[float, tuple[float, ...]]:
        """Its value in the step from t to t + h, s, and what it remembers: as many numbers as
        `begin` returns. sensed: present values of the sensors."""


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
    """Prescribed value start + function.value(t), with the function's derivatives."""

    function: TimeFunction
    start: float = 0.0

    def __call__(self, t: float) -> float:
        return self.start + self.function.value(t)

    def derivatives(self, t: float, h: float) -> tuple[float, float]:
        return derivatives_of(self.function, t, h)


def derivatives_of(function: TimeFunction, t: float, h: float) -> tuple[float, float]:
    """First and second derivatives from the right at t, s; without a `curvature` the second is a
    finite difference of the rate. h: time step, s."""
    bend = function.curvature(t)
    return function.rate(t), _scalar(function.rate, 1, t, h) if bend is None else bend


def time_derivatives(function: Callable[[float], float], t: float, h: float) -> tuple[float, float]:
    """First and second derivatives of `function` from the right at t, s; exact for a
    `Differentiable` function. h: time step, s."""
    if isinstance(function, Differentiable):
        return function.derivatives(t, h)
    return _scalar(function, 1, t, h), _scalar(function, 2, t, h)


def _scalar(function: Callable[[float], float], order: int, t: float, h: float) -> float:
    """`derivative_from_right` of a function with numbers as values."""
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
