"""Scalar functions of time, for load amplitudes and prescribed motion.

Where a function has a kink or a jump, `rate` and `curvature`, its first and second derivative, are
those from the right, without the jump; `jumps` says at which times that is
(core/protocols/step_amplitude.py). Values have the unit of the quantity that the function scales or
prescribes; times are in s, and equal if they differ by a few units of the last place.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from sparsemor.core import Function, Slot, TimeFunction
from sparsemor.core.protocols.integrator import same_time


def parse(amplitude: float | TimeFunction) -> TimeFunction:
    """Function of time for an amplitude: a number becomes the constant function."""
    return Constant(level=amplitude) if isinstance(amplitude, int | float) else amplitude


def _between(times: Iterable[float], start: float, end: float) -> list[float]:
    return [t for t in times if start <= t <= end]


class PiecewiseLinear(Function):
    """Piecewise linear function of time: its second derivative is zero; the first is zero unless a
    subclass defines it."""

    def rate(self, t: float) -> float:
        return 0.0

    def curvature(self, t: float) -> float:
        return 0.0


class Constant(PiecewiseLinear):
    """Constant function: the same value at all times."""

    level: float
    """Value of the function."""

    def value(self, t: float) -> float:
        return self.level


class TabulatedFunction(PiecewiseLinear):
    """Piecewise linear interpolation of tabulated values."""

    times: tuple[float, ...] = Field(min_length=2)
    """Strictly increasing times, s."""
    values: tuple[float, ...] = Field(min_length=2)
    """Values at these times."""
    outside: Literal["hold", "zero"] = "hold"
    """Value before the first and after the last time: `hold` the nearest one, or `zero`."""

    @model_validator(mode="after")
    def _matching(self) -> Self:
        """Checks that there is a value for each time and that times increase."""
        if len(self.times) != len(self.values):
            raise ValueError(
                f"{len(self.times)} times but {len(self.values)} values: give one value a time"
            )
        for i, (t0, t1) in enumerate(zip(self.times, self.times[1:], strict=False)):
            if t1 <= t0:
                raise ValueError(
                    f"times must increase: times[{i + 1}] = {t1:g} does not come after "
                    f"times[{i}] = {t0:g}; write a jump as two close times"
                )
        return self

    def jumps(self, start: float, end: float) -> list[float]:
        """Times of the table between start and end, s."""
        return list(self.times[bisect_left(self.times, start):bisect_right(self.times, end)])

    def value(self, t: float) -> float:
        first, last = self.times[0], self.times[-1]
        if t < first - same_time(first) or t > last + same_time(last):
            if self.outside == "zero":
                return 0.0
            return self.values[0] if t < self.times[0] else self.values[-1]
        i = min(max(bisect_right(self.times, t), 1), len(self.times) - 1) - 1
        return self.values[i] + self._slope(i) * (t - self.times[i])

    def rate(self, t: float) -> float:
        if t < self.times[0] or t >= self.times[-1]:
            return 0.0
        return self._slope(bisect_right(self.times, t) - 1)

    def _slope(self, i: int) -> float:
        return (self.values[i + 1] - self.values[i]) / (self.times[i + 1] - self.times[i])


class Change(Function):
    """Change from one value to another in an interval, constant before and after."""

    start: float = 0.0
    """Start of the change, s."""
    end: float
    """End of the change, s."""
    initial: float = 0.0
    """Value up to `start`."""
    final: float
    """Value from `end` on."""

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if self.end <= self.start:
            raise ValueError(f"end = {self.end:g} s must come after start = {self.start:g} s")
        return self

    def jumps(self, start: float, end: float) -> list[float]:
        """Start and end of the change, if between start and end, s."""
        return _between((self.start, self.end), start, end)

    def _share(self, t: float) -> float:
        return min(1.0, max(0.0, (t - self.start) / (self.end - self.start)))


class Ramp(Change, PiecewiseLinear):
    """Linear ramp: from one value to another along a straight line, constant before and after."""

    def value(self, t: float) -> float:
        share = self._share(t)
        return (1.0 - share) * self.initial + share * self.final

    def rate(self, t: float) -> float:
        if not self.start <= t < self.end:
            return 0.0
        return (self.final - self.initial) / (self.end - self.start)


class Pulse(PiecewiseLinear):
    """Rectangular pulse: a value from `start` until `duration` later (end excluded), else zero."""

    start: float = 0.0
    """Start time, s."""
    duration: float = Field(gt=0.0)
    """Duration, s."""
    level: float
    """Value during the pulse."""

    def jumps(self, start: float, end: float) -> list[float]:
        """Start and end of the pulse, if between start and end, s."""
        return _between((self.start, self.start + self.duration), start, end)

    def value(self, t: float) -> float:
        end = self.start + self.duration
        begun = t >= self.start - same_time(self.start)
        return self.level if begun and t < end - same_time(end) else 0.0


class Sine(Function):
    """Harmonic function: offset + amplitude sin(2 pi frequency t + phase)."""

    amplitude: float
    """Amplitude: largest deviation from the offset."""
    frequency: float = Field(ge=0.0)
    """Frequency, Hz."""
    phase: float = 0.0
    """Phase, rad."""
    offset: float = 0.0
    """Mean value."""

    def value(self, t: float) -> float:
        return self.offset + self.amplitude * math.sin(self._angle(t))

    def rate(self, t: float) -> float:
        return 2.0 * math.pi * self.frequency * self.amplitude * math.cos(self._angle(t))

    def curvature(self, t: float) -> float:
        return -((2.0 * math.pi * self.frequency) ** 2) * self.amplitude * math.sin(self._angle(t))

    def _angle(self, t: float) -> float:
        return 2.0 * math.pi * self.frequency * t + self.phase


class SmoothStep(Change):
    """Smooth step between two constant values, with continuous first and second derivative: initial
    + (final - initial) (10 s^3 - 15 s^4 + 6 s^5), s from 0 at `start` to 1 at `end`."""

    def value(self, t: float) -> float:
        s = self._share(t)
        return self.initial + (self.final - self.initial) * s**3 * (10.0 + s * (6.0 * s - 15.0))

    def rate(self, t: float) -> float:
        s, T = self._share(t), self.end - self.start
        return (self.final - self.initial) * 30.0 * (s * (1.0 - s)) ** 2 / T

    def curvature(self, t: float) -> float:
        s, T = self._share(t), self.end - self.start
        return (self.final - self.initial) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / T**2


def _function(value: Any) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return Constant(level=value) if number else value


Part = Annotated[
    TimeFunction, Slot("function"),
    BeforeValidator(_function, json_schema_input_type=float | Annotated[Any, Slot("function")])]
"""A number or a function of time."""


def _jumps(parts: Iterable[TimeFunction], start: float, end: float) -> list[float] | None:
    """Times at which one of several functions jumps; None if none of them ever does."""
    found = [j for j in (f.jumps(start, end) for f in parts) if j is not None]
    return sorted({t for times in found for t in times}) if found else None


class Sum(Function):
    """Sum of functions of time."""

    terms: tuple[Part, ...] = Field(min_length=1)
    """The summands: numbers and functions."""

    def jumps(self, start: float, end: float) -> list[float] | None:
        """Times between start and end, s, at which one of the terms jumps."""
        return _jumps(self.terms, start, end)

    def value(self, t: float) -> float:
        return sum(f.value(t) for f in self.terms)

    def rate(self, t: float) -> float:
        return sum(f.rate(t) for f in self.terms)

    def curvature(self, t: float) -> float | None:
        found = [f.curvature(t) for f in self.terms]
        return None if None in found else sum(c for c in found if c is not None)


class Product(Function):
    """Product of functions of time, such as a sine that a smooth step switches on."""

    factors: tuple[Part, ...] = Field(min_length=1)
    """The factors: numbers and functions."""

    def jumps(self, start: float, end: float) -> list[float] | None:
        """Times between start and end, s, at which one of the factors jumps."""
        return _jumps(self.factors, start, end)

    def value(self, t: float) -> float:
        return self._jet(t)[0]

    def rate(self, t: float) -> float:
        return self._jet(t)[1]

    def curvature(self, t: float) -> float | None:
        return self._jet(t)[2]

    def _jet(self, t: float) -> tuple[float, float, float | None]:
        """Value, and first and second derivative, None where a factor has none."""
        p, p1, p2 = 1.0, 0.0, 0.0
        exact = True
        for f in self.factors:
            q, q1, q2 = f.value(t), f.rate(t), f.curvature(t)
            exact = exact and q2 is not None
            p, p1, p2 = p * q, p1 * q + p * q1, p2 * q + 2.0 * p1 * q1 + p * (q2 or 0.0)
        return p, p1, p2 if exact else None
