"""Objects of one kind in the options of a scene, with their dotted keys."""

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel

from sparsemor.core.protocols.time_function import TimeFunction

T = TypeVar("T")


def nested(value: object, kind: type[T], key: str = "") -> Iterator[tuple[str, T]]:
    """Dotted key and value of every option in `value` that is a `kind`; key: that of `value`."""
    if isinstance(value, kind):
        yield key, value
    inside: list[tuple[str, object]] = []
    if isinstance(value, BaseModel):
        inside = list(value)
    elif isinstance(value, Mapping):
        inside = [(str(k), v) for k, v in value.items()]
    elif isinstance(value, list | tuple):
        inside = [(str(i), v) for i, v in enumerate(value)]
    for name, inner in inside:
        yield from nested(inner, kind, f"{key}.{name}" if key else name)


def functions_of_time(value: object) -> Iterator[tuple[str, Any]]:
    """Dotted key and function of every option in `value` that is a function of time."""
    for key, plugin in nested(value, BaseModel):
        if isinstance(plugin, TimeFunction):
            yield key, plugin


def changes(old: object, new: object, key: str = "") -> Iterator[str]:
    """Dotted keys of the entries in which two trees of plain data differ."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for name in dict.fromkeys((*old, *new)):
            yield from changes(old.get(name), new.get(name), f"{key}.{name}" if key else str(name))
    elif old != new:
        yield key
