"""Check of the fields of a dataclass against their types, for objects that are made of data."""

import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields
from enum import Enum
from functools import cache
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from typing_extensions import is_protocol

from sparsemor.core.registry.contracts import absent_members

_KINDS = {np.float64: "f", np.int64: "iu", np.bool_: "b"}


def unfit_field(value: Any) -> str:
    """Name, type and value of the first field of a dataclass that is not of its type, "" if all
    are."""
    for name, hint in _hints(type(value)):  # type: ignore[arg-type]
        held = getattr(value, name)
        if not fits(held, hint):
            return f"{type(value).__name__}.{name} is {_shown(held)}"
    return ""


@cache
def _hints(cls: type[Any]) -> tuple[tuple[str, Any], ...]:
    hints = get_type_hints(cls)
    return tuple((f.name, hints[f.name]) for f in fields(cls) if f.init)


def fits(value: object, hint: Any) -> bool:
    """True if a value is of a type as annotations of fields name it; what a callable takes and
    returns is not looked at."""
    if hint is Any or isinstance(hint, TypeVar):
        return True
    if hint is float:
        return isinstance(value, float | int) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int | np.integer) and not isinstance(value, bool)
    of, inner = get_origin(hint), get_args(hint)
    if of in (Union, types.UnionType):
        return any(fits(value, h) for h in inner)
    if of is Literal:
        return any(value is h or value == h and type(value) is type(h) for h in inner)
    if of is np.ndarray:
        kinds = _KINDS.get(get_args(inner[1])[0], "")
        return isinstance(value, np.ndarray) and (not kinds or value.dtype.kind in kinds)
    if of is tuple and inner[-1:] != (...,):
        return isinstance(value, tuple) and len(value) == len(inner) and all(
            fits(v, h) for v, h in zip(value, inner, strict=True))
    if of is not None and issubclass(of, Mapping):
        return isinstance(value, Mapping) and all(
            fits(k, inner[0]) and fits(v, inner[1]) for k, v in value.items())
    if of is Callable or of is not None and issubclass(of, Callable):  # type: ignore[arg-type]
        return callable(value)
    if of is not None and issubclass(of, Collection):
        return isinstance(value, of) and all(fits(v, inner[0]) for v in value)
    if hint is None or hint is types.NoneType:
        return value is None
    if is_protocol(hint):
        return not absent_members(hint, value)
    return isinstance(value, of or hint)


def _shown(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}"
    plain = value is None or isinstance(value, bool | int | float | str | Enum)
    return repr(value)[:40] if plain else f"a {type(value).__name__}"
