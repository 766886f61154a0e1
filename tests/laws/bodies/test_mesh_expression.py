"""Expressions in coordinates: what they compute, and that nothing else gets through."""


import numpy as np
import pytest

from sparsemor.bodies.mesh.coordinate_expressions import evaluate_condition, evaluate_formula
from sparsemor.core.errors import InputError

POINTS = np.array([[0.0, 0.1], [1.0, 0.05]])


@pytest.mark.parametrize(
    "text,values",
    [
        ("293.15 + 500*y", [343.15, 318.15]),
        ("-x**2 + abs(-3)", [3.0, 2.0]),
        ("max(x, y, 0.5) / min(2, 4)", [0.25, 0.5]),
        ("sqrt(4) + sin(0*x) + cos(0) + exp(0) + pi - pi", [4.0, 4.0]),
        ("7", [7.0, 7.0]),
    ],
)
def test_formula(text: str, values: list[float]) -> None:
    np.testing.assert_allclose(evaluate_formula(text, POINTS), values, rtol=1e-15)


@pytest.mark.parametrize(
    "text,values",
    [
        ("y > 0.08 and x < 0.5", [True, False]),
        ("0 < x <= 1 or not y > 0.05", [False, True]),
        ("not (x == 0) and x != 2", [False, True]),
        ("1 < 2", [True, True]),
    ],
)
def test_condition(text: str, values: list[bool]) -> None:
    assert evaluate_condition(text, POINTS).tolist() == values


@pytest.mark.parametrize(
    "text,words",
    [
        ("__import__('os').system('true')", "not allowed"),
        ("open(x)", "there is no function 'open'"),
        ("x.real", "'x.real' is not allowed"),
        ("(lambda: 1)()", "not allowed"),
        ("[i for i in x]", "not allowed"),
        ("'text'", "not allowed"),
        ("True", "not allowed"),
        ("x % 2", "not allowed"),
        ("abs(x, y)", "abs takes one argument, not 2"),
        ("max(x)", "max takes two or more arguments, not 1"),
        ("max(x, *y)", "not allowed"),
        ("x +", "not an expression"),
        ("", "not an expression"),
        ("1" + "0" * 400, "too large"),
        ("-" * 1500 + "x", "too many nested"),
        ("(" * 1500, "not an expression"),
        ("x + " * 1000 + "x", "at most 2000"),
        ("x > 1", "is a condition; give a number"),
        ("(x > 1) + 1", "is a condition where a number is needed"),
        ("1/x", "not a finite number at 1 of 2 points, first at \\(0, 0.1\\)"),
        ("sqrt(-x)", "not a finite number"),
        ("9**9**9**9", "not a finite number"),
        ("z", "a 2-D mesh has x and y only"),
    ],
)
def test_formula_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        evaluate_formula(text, POINTS, "start")
    assert caught.value.faults[0].key == "start"


@pytest.mark.parametrize(
    "text,words",
    [
        ("x", "is a number; give a condition"),
        ("x and y > 1", "is a number where a condition is needed"),
        ("not 3", "is a number where a condition is needed"),
        ("1/x > 3", "not a finite number"),
    ],
)
def test_condition_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        evaluate_condition(text, POINTS)
