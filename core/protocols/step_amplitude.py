"""Amplitudes of loads over the steps of a run, and the times at which functions of time jump.

An integrator evaluates a load once in a step, at its end. Summed up over the steps this is a
quadrature of the load in time, which misses a jump by up to a whole step. A function of time
therefore declares its jumps (`TimeFunction.jumps`). With the mean m_n of f over step n, the load of
that step is then

    g_n = (1 + theta) m_n - theta m_(n-1),      m_0 = f(0).

theta is the delay of the integrator: a constant force that begins to act gives h (n - theta) times
its acceleration after n steps, so that theta is 0 for implicit Euler and 1/2 for every method of
second order. The h g_n add up to the exact integral; for BDF2 g_n is its own rate of that integral,
which is therefore exact at the end of every step. Where f is smooth g_n is f at the end of the step
to second order (first order for theta = 0).
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, is_dataclass, replace
from types import MethodType
from typing import Any, TypeVar

import numpy as np

from sparsemor.core.protocols.integrator import Integrator, differences, same_time
from sparsemor.core.protocols.separable import Amplitude
from sparsemor.core.protocols.time_function import TimeFunction, derivatives_of

_POINTS, _WEIGHTS = (a.tolist() for a in np.polynomial.legendre.leggauss(3))
_STEPS = 200
T = TypeVar("T")


def before(function: TimeFunction, t: float, jumps: Sequence[float]) -> float:
    """Limit of the function from the left at t, s, where one of the jumps may be."""
    near = same_time(t)
    if not any(abs(s - t) <= near for s in jumps):
        return function.value(t)
    s = t - 4.0 * near
    return function.value(s) + (t - s) * function.rate(s)


def after(function: TimeFunction, t: float) -> float:
    """Limit of the function from the right at t, s."""
    s = t + 4.0 * same_time(t)
    return function.value(s) - (s - t) * function.rate(s)


def delay(integrator: Integrator) -> float:
    """theta of an integrator, from its rule for unknowns of first order: after n steps from rest
    with rate 1, x = h (n - theta)."""
    rule = integrator.rules(1.0).first
    z, last = np.zeros(len(rule.new)), 0.0
    for _ in range(_STEPS):
        last, z = float(z[0]), rule.new + rule.old @ z
    # the mean of two steps: an undamped root of the rule is -1
    return round(_STEPS - 0.5 - 0.5 * (last + float(z[0])), 9)


def _mean(function: TimeFunction, start: float, end: float, jumps: Sequence[float]) -> float:
    """Mean value between start and end, s, by Gauss points between the jumps."""
    near = same_time(end)
    edges = [start, *(s for s in jumps if start + near < s < end - near), end]
    return sum(
        0.5 * (b - a) * sum(w * function.value(0.5 * (a + b) + 0.5 * (b - a) * x)
                            for x, w in zip(_POINTS, _WEIGHTS, strict=True))
        for a, b in zip(edges, edges[1:], strict=False)) / (end - start)


@dataclass(frozen=True, slots=True)
class Substep:
    """Step of size h, s. begins: True where its history is made, after a jump of the loads or
    steps of another size; after: None, or the loads are those so many s after its end, in the limit
    from the right."""

    h: float
    begins: bool = False
    after: float | None = None


_NO_STEP = Substep(0.0)
_SUBSTEP: ContextVar[Substep | None] = ContextVar("substep", default=None)


@contextmanager
def substep(of: Substep) -> Iterator[None]:
    """Loads that are evaluated inside are those of this step."""
    token = _SUBSTEP.set(of)
    try:
        yield
    finally:
        _SUBSTEP.reset(token)


def present_step() -> Substep:
    """The step that is being solved; of size 0 where none is, as at the start of a run."""
    return _SUBSTEP.get() or _NO_STEP


@dataclass(frozen=True, slots=True)
class Stepping:
    """Steps of a run: size h, s, delay theta of its integrator, and number of earlier values in its
    rate of first-order unknowns (`differences`)."""

    h: float
    theta: float
    differences: int = 0

    @classmethod
    def of(cls, integrator: Integrator, h: float) -> "Stepping":
        return cls(h, delay(integrator), differences(integrator))

    def prescribed(self, function: TimeFunction) -> "StepFunction":
        """A prescribed value with its rate by the integrator's formula."""
        return StepFunction(function, self.h, self.differences)

    def over(self, amplitude: T) -> T | Amplitude:
        """Amplitude of a load over these steps: of the values of a function of time, and of those
        inside of an object such as a law or an item of a frame, whose fields of the class
        `Stepping` become these steps; anything else as it is."""
        if isinstance(amplitude, MethodType):  # amplitudes are the methods `value` of functions
            f, name = amplitude.__self__, amplitude.__name__
            return StepAmplitude(f, self.h, self.theta) if (
                name == "value" and isinstance(f, TimeFunction)) else amplitude
        if isinstance(amplitude, StepAmplitude | type) or not is_dataclass(amplitude):
            return amplitude
        data: Any = amplitude
        values = {f.name: getattr(data, f.name) for f in fields(data) if f.init}
        over = {name: self if isinstance(value, Stepping) else self.over(value)
                for name, value in values.items()
                if isinstance(value, MethodType | Stepping)
                or (callable(value) and is_dataclass(value))}
        changed = {name: value for name, value in over.items() if value is not values[name]}
        changed_data: T = replace(data, **changed) if changed else amplitude
        return changed_data


@dataclass(frozen=True, slots=True)
class StepAmplitude:
    """Amplitude of a load in the step n that ends at a time: g_n = (1 + theta) m_n - theta m_(n-1),
    with the means m of the function over steps, where that declares jumps, and its value at the end
    otherwise. h: step, s; theta: delay of the integrator."""

    function: TimeFunction
    h: float
    theta: float

    def __call__(self, t: float) -> float:
        """Mean of the function over the step, where it jumps in it; with the delay theta corrected
        by the mean of the step before: (1 + theta) mean - theta past. The step is the one that is
        being solved (`substep`), else of size h; its `after`: time, s, after its end at which the
        loads are wanted, from the right; `begins`: the mean before it is that of a straight line
        with the slope after its start.
        """
        f, own = self.function, _SUBSTEP.get()
        if own is not None and own.after is not None:
            return after(f, t + own.after)
        if type(f).jumps is TimeFunction.jumps:  # it never does
            return f.value(t)
        near = same_time(t)
        h = min(self.h if own is None else own.h, t)
        start = t - h if t - h > near else 0.0
        earlier = max(start - h, 0.0) if self.theta else start
        jumps = f.jumps(earlier - near, t + near) if h > near else None
        if jumps is None or (self.theta and not len(jumps)):
            return f.value(t)
        mean = _mean(f, start, t, jumps)
        if not self.theta:
            return mean
        if start == 0.0:
            past = f.value(0.0)
        elif own is not None and own.begins:
            past = after(f, start) - 0.5 * h * f.rate(start + 4.0 * same_time(start))
        else:
            past = _mean(f, earlier, start, jumps)
        return (1.0 + self.theta) * mean - self.theta * past

    def derivatives(self, t: float, h: float) -> tuple[float, float]:
        """Derivatives of the function from the right (`Differentiable`)."""
        return derivatives_of(self.function, t, h)


@dataclass(frozen=True, slots=True)
class StepFunction(TimeFunction):
    """Prescribed value of an unknown of first order, with the rate that the integrator's formula
    gives it: differences of values, so that heat which neighbours take up is that of the change,
    however fast. h: step, s; earlier: number of earlier values in the formula."""

    function: TimeFunction
    h: float
    earlier: int

    def value(self, t: float) -> float:
        return self.function.value(t)

    def rate(self, t: float) -> float:
        """(f - f_0)/h or (3 f - 4 f_0 + f_1)/(2 h), f_0 and f_1 one and two steps before, with f_1
        = f_0 - h f_0' where the formula begins; f' at the start of a run and of another formula.
        The step is the one that is being solved (`substep`), else of size h."""
        f, own = self.function, _SUBSTEP.get()
        h, begins = (self.h, False) if own is None else (own.h, own.begins)
        if own is not None and own.after is not None:
            return f.rate(t + own.after)
        if not self.earlier or t <= same_time(t) or h <= same_time(t):
            return f.rate(t)
        start = t - h if t - h > same_time(t) else 0.0
        change = f.value(t) - f.value(start)
        if self.earlier == 1:
            return change / h
        past = h * f.rate(start) if begins or start == 0.0 else f.value(start) - f.value(start - h)
        return (1.5 * change - 0.5 * past) / h

    def jumps(self, start: float, end: float) -> Sequence[float] | None:
        return self.function.jumps(start, end)
