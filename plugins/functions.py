"""Scalar functions of time, for load amplitudes and prescribed motion.

Where a function has a kink or a jump, `rate` and `curvature`, its first and second derivative, are
those from the right, without the jump. Values have the unit of the quantity that the function
scales or prescribes; times are in s.
"""

import math
from bisect import bisect_right
from typing import Literal, Self

from pydantic import Field, model_validator

from sparsemor.core import Plugin, TimeFunction


def parse(amplitude: float | TimeFunction) -> TimeFunction:
    """Function of time for an amplitude: a number becomes the constant function."""
    return Constant(level=amplitude) if isinstance(amplitude, int | float) else amplitude


class PiecewiseLinear(Plugin):
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


class Table(PiecewiseLinear):
    """Piecewise linear interpolation of tabulated values."""

    times: tuple[float, ...] = Field(min_length=2)
    """Strictly increasing times, s."""
    values: tuple[float, ...] = Field(min_length=2)
    """Values at these times."""
    outside: Literal["hold", "zero"] = "hold"
    """Value before the first and after the last time: `hold` the nearest one, or `zero`."""

    @model_validator(mode="after")
    def _matching(self) -> Self:
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

    def value(self, t: float) -> float:
        if t < self.times[0] or t > self.times[-1]:
            if self.outside == "zero":
                return 0.0
            return self.values[0] if t < self.times[0] else self.values[-1]
        i = min(bisect_right(self.times, t), len(self.times) - 1) - 1
        return self.values[i] + self._slope(i) * (t - self.times[i])

    def rate(self, t: float) -> float:
        if t < self.times[0] or t >= self.times[-1]:
            return 0.0
        return self._slope(bisect_right(self.times, t) - 1)

    def _slope(self, i: int) -> float:
        return (self.values[i + 1] - self.values[i]) / (self.times[i + 1] - self.times[i])


class Ramp(PiecewiseLinear):
    """Linear ramp: from one value to another along a straight line, constant before and after."""

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

    def value(self, t: float) -> float:
        share = min(1.0, max(0.0, (t - self.start) / (self.end - self.start)))
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

    def value(self, t: float) -> float:
        return self.level if self.start <= t < self.start + self.duration else 0.0


class Sine(Plugin):
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
