"""Numbers among the options of plugins: true and false are none."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from pydantic_core import CoreSchema, PydanticKnownError, core_schema


def without_booleans(schema: CoreSchema) -> CoreSchema:
    """The same pydantic schema, in which no number accepts true or false as 1 or 0, at any depth
    except in references to other models, which have their own schema."""
    return cast(CoreSchema, _rewritten(schema))


def _rewritten(part: Any) -> Any:
    if isinstance(part, list):
        return [_rewritten(p) for p in part]
    if isinstance(part, tuple):  # a choice of a union with its label
        return tuple(_rewritten(p) for p in part)
    if not isinstance(part, dict):
        return part
    check = _check_of(part)
    if check is not None:
        return core_schema.no_info_before_validator_function(check, part)
    return {key: value if key in _NOT_SCHEMAS else _rewritten(value)
            for key, value in part.items()}


_NOT_SCHEMAS = frozenset({"default", "expected", "metadata", "serialization", "config", "cls"})
"""Keys of a schema whose values are data of the option, and no schemas."""


def _check_of(part: dict[str, Any]) -> Callable[[Any], Any] | None:
    """Check of the values of a schema without parts, None where it has no number or accepts true
    or false, too."""
    kind, expected = part.get("type"), part.get("expected")
    if kind == "float":
        return _number
    if kind == "int":
        return _integer
    listed = expected if kind == "literal" and isinstance(expected, list) else []
    numbers = any(isinstance(e, int | float) for e in listed)
    return _one_of(listed) if numbers and not any(isinstance(e, bool) for e in listed) else None


def _number(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        raise PydanticKnownError("float_type")
    return value


def _integer(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        raise PydanticKnownError("int_type")
    return value


def _one_of(expected: list[Any]) -> Callable[[Any], Any]:
    *others, last = map(repr, expected)
    words = f"{', '.join(others)} or {last}" if others else last

    def check(value: Any) -> Any:
        if isinstance(value, bool | np.bool_):
            raise PydanticKnownError("literal_error", {"expected": words})
        return value

    return check
