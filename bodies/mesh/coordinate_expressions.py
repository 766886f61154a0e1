"""Arithmetic expressions and conditions in the coordinates x, y, z, as written in scene files."""

from collections.abc import Callable
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import AfterValidator

from sparsemor.core import BoolArray, FloatArray, InputError
from sparsemor.core.scene.expressions import Expression

COORDINATES = ("x", "y", "z")


def evaluate_formula(text: str, points: FloatArray, key: str = "") -> FloatArray:
    """Values (N,) of a numeric expression at points (N, d), m."""
    return np.array(_values(_number(text, key), points), dtype=np.float64)


def evaluate_condition(text: str, points: FloatArray, key: str = "") -> BoolArray:
    """Truth values (N,) of a condition at points (N, d), m.

    Both sides of `and` and `or` are computed everywhere: `x != 0 and 1/x > 2` is an error where x =
    0, because a comparison with a number that is not finite has no meaning.
    """
    return np.array(_values(_condition(text, key), points), dtype=np.bool_)


def _number(text: str, key: str = "") -> Expression:
    return Expression.parse(text, "number", (*COORDINATES, "pi"), key=key)


def _condition(text: str, key: str = "") -> Expression:
    return Expression.parse(text, "condition", (*COORDINATES, "pi"), key=key)


def _check(parse: Callable[[str], Expression]) -> Callable[[str], str]:
    return lambda text: parse(text).text


FormulaText: TypeAlias = Annotated[str, AfterValidator(_check(_number))]
"""Type of an option: text of a numeric expression in x, y, z, checked when the scene is read."""
ConditionText: TypeAlias = Annotated[str, AfterValidator(_check(_condition))]
"""Type of an option: text of a condition in x, y, z, checked when the scene is read."""


def _values(expression: Expression, points: FloatArray) -> Any:
    """Values (N,) of an expression in the coordinates x, y, z at points (N, d), m. Raises
    InputError for a coordinate that the mesh does not have, or where a number is not finite
    (`finite`, a check for the evaluation)."""
    count, d = points.shape
    for name in expression.names:
        if name in COORDINATES[d:]:
            raise InputError(f"'{name}' in '{expression.text}': a {d}-D mesh has "
                             f"{' and '.join(COORDINATES[:d])} only", expression.key)

    def finite(values: Any) -> Any:
        bad = np.flatnonzero(~np.isfinite(np.broadcast_to(values, count)))
        if bad.size:
            where = ", ".join(f"{c:.6g}" for c in points[bad[0]])
            raise InputError(
                f"'{expression.text}' is not a finite number at {bad.size} of {count} points, "
                f"first at ({where})", expression.key)
        return values

    coordinates = dict(zip(COORDINATES, points.T, strict=False))
    return np.broadcast_to(expression.value({**coordinates, "pi": np.pi}, finite), count)
