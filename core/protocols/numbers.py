"""Numbers among the options of plugins: true and false are none."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from pydantic_core import CoreSchema, PydanticKnownError, core_schema


def without_booleans(schema: CoreSchema) -> CoreSchema:
    """The same pydantic schema, in which no number accepts true or false as 1 or 0, at any depth
    except in references to other models, which have their own schema."""
    root: list[Any] = [schema]
    waiting: list[tuple[Any, Any]] = [(root, 0)]
    choices: list[tuple[Any, Any]] = []  # of a union with their labels: tuples
    while waiting:
        holder, key = waiting.pop()
        part = holder[key]
        if isinstance(part, list | tuple):
            holder[key] = parts = list(part)
            for i, p in enumerate(parts):
                if isinstance(p, _CONTAINERS):
                    waiting.append((parts, i))
            if isinstance(part, tuple):
                choices.append((holder, key))
        elif part.get("type") in _NUMBERS and (check := _check_of(part)) is not None:
            holder[key] = core_schema.no_info_before_validator_function(check, part)
        else:
            holder[key] = copy = dict(part)
            for k, v in copy.items():
                if k not in _NOT_SCHEMAS and isinstance(v, _CONTAINERS):
                    waiting.append((copy, k))
    for holder, key in reversed(choices):  # inner ones before those that contain them
        holder[key] = tuple(holder[key])
    return cast(CoreSchema, root[0])


_CONTAINERS = (dict, list, tuple)
_NUMBERS = frozenset({"float", "int", "literal"})
"""Types of schemas that may accept numbers."""
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
    types = set(map(type, listed))
    return _one_of(listed) if types & {int, float} and bool not in types else None


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
