"""Functions of time: values, rates against differences, and refusals."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sparsemor.core import TimeFunction
from sparsemor.core.protocols.time_function import Held, Prescribed, time_derivatives
from sparsemor.core.testing import check_function
from sparsemor.plugins.functions import (
    Constant,
    Product,
    Pulse,
    Ramp,
    Sine,
    SmoothStep,
    Sum,
    TabulatedFunction,
    parse,
)

ALL: list[TimeFunction] = [
    Constant(level=3.0),
    TabulatedFunction(times=(0.0, 1.0, 3.0), values=(2.0, 4.0, -2.0)),
    TabulatedFunction(times=(0.0, 1.0, 3.0), values=(2.0, 4.0, -2.0), outside="zero"),
    Ramp(start=0.5, end=2.5, initial=1.0, final=-3.0),
    Pulse(start=0.5, duration=1.0, level=7.0),
    Sine(amplitude=2.0, frequency=0.7, phase=0.3, offset=1.0),
    SmoothStep(start=0.5, end=2.5, initial=1.0, final=-3.0),
    Sum(terms=(2.0, {"use": "sine", "amplitude": 1.0, "frequency": 0.5},
               SmoothStep(end=1.5, final=2.0))),
    Product(factors=(Sine(amplitude=2.0, frequency=0.7), SmoothStep(end=1.5, final=2.0), 3.0)),
]


@pytest.mark.parametrize("function", ALL, ids=repr)
def test_laws_with_every_option(function: TimeFunction) -> None:
    check_function(function)


@pytest.mark.parametrize("function", ALL[1:5], ids=repr)
def test_at_a_kink_the_rate_is_the_one_to_the_right(function: TimeFunction) -> None:
    for t in (0.0, 0.5, 1.0, 1.5, 2.5, 3.0):
        if function.value(t + 1e-6) == pytest.approx(function.value(t), abs=1e-4):
            slope = (function.value(t + 1e-6) - function.value(t)) / 1e-6
            assert function.rate(t) == pytest.approx(slope, abs=1e-7)


class RateOnly(TimeFunction):
    """A sine from another package that knows its rate alone."""

    def __init__(self, w: float) -> None:
        self.w = w

    def value(self, t: float) -> float:
        return float(np.sin(self.w * t))

    def rate(self, t: float) -> float:
        return float(self.w * np.cos(self.w * t))


@pytest.mark.parametrize("w", [1e-5, 1.0, 1e5])
def test_derivatives_from_the_right_with_the_step_as_scale(w: float) -> None:
    """Exact where the function knows them, else to what a hundredth of the step resolves."""
    t, h = 0.3 / w, 0.1 / w
    want = w * np.cos(0.3), -(w**2) * np.sin(0.3)
    assert time_derivatives(Prescribed(RateOnly(w), 5.0), t, h) == pytest.approx(want, rel=1e-9)
    assert time_derivatives(RateOnly(w).value, t, h) == pytest.approx(want, rel=1e-7)
    known = Prescribed(Sine(amplitude=1.0, frequency=w / (2 * np.pi)), 5.0)
    assert time_derivatives(known, t, h) == pytest.approx(want, rel=1e-14)
    assert time_derivatives(Held(1e7), t, h) == time_derivatives(lambda s: 1e7, t, h) == (0.0, 0.0)
    corner = TabulatedFunction(times=(0.0, t, 2 * t), values=(0.0, 0.0, 1.0))
    assert time_derivatives(corner.value, t, h) == pytest.approx((1 / t, 0.0), abs=1e-6 / t**2)


@pytest.mark.parametrize(
    ("function", "points"),
    [
        (ALL[1], {-1.0: 2.0, 0.0: 2.0, 0.5: 3.0, 1.0: 4.0, 2.0: 1.0, 3.0: -2.0, 9.0: -2.0}),
        (ALL[2], {-1.0: 0.0, 0.0: 2.0, 3.0: -2.0, 3.1: 0.0}),
        (ALL[3], {0.0: 1.0, 0.5: 1.0, 1.5: -1.0, 2.5: -3.0, 9.0: -3.0}),
        (ALL[4], {0.4: 0.0, 0.5: 7.0, 1.4: 7.0, 1.5: 0.0}),
        (ALL[5], {0.0: 1.0 + 2.0 * np.sin(0.3)}),
    ],
    ids=str,
)
def test_values(function: TimeFunction, points: dict[float, float]) -> None:
    for t, value in points.items():
        assert function.value(t) == pytest.approx(value)


def test_a_number_is_a_constant_function() -> None:
    assert parse(2.5) == Constant(level=2.5)
    assert parse(3).value(1.0) == 3.0
    assert parse(ALL[5]) is ALL[5]


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        (TabulatedFunction, {"times": [0, 1], "values": [1, float("nan")]}, "finite number"),
        (TabulatedFunction, {"times": [0, float("inf")], "values": [1, 2]}, "finite number"),
        (TabulatedFunction, {"times": [0, 1, 1], "values": [1, 2, 3]}, r"2\] = 1 does not come"),
        (TabulatedFunction, {"times": [0, 1, 2], "values": [1, 2]}, "3 times but 2 values"),
        (TabulatedFunction, {"times": [0], "values": [1]}, "at least 2"),
        (Ramp, {"start": 2.0, "end": 1.0, "final": 1.0}, "must come after start = 2 s"),
        (Pulse, {"duration": 0.0, "level": 1.0}, "greater than 0"),
        (Constant, {"level": float("inf")}, "finite number"),
        (Sine, {"amplitude": 1.0, "frequency": 1.0, "fase": 0.0}, "fase"),
    ],
    ids=str,
)
def test_bad_options_are_refused_in_words(kind: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        kind.model_validate(options)
