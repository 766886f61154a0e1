"""Check of values against annotations: fields of objects made of data, and what plugins return."""

import sys
import types
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from functools import cache
from math import isfinite
from numbers import Integral, Real
from typing import Any, Literal, Self, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from typing_extensions import TypeAliasType, get_protocol_members, is_protocol

_NAMED: Any = (TypeAliasType,)
if sys.version_info >= (3, 12):
    _NAMED += (typing.TypeAliasType,)
NOT_FINITE = "values that are not finite"
_FLOAT = np.dtype(np.float64)
_BY_CLASS = frozenset({int, bool, str, types.NoneType})
"""Types all of whose instances are usual values."""
_WITH_NUMBERS = (float, np.floating, np.ndarray, Mapping, list, tuple)
"""Types whose instances may hold numbers that are not finite."""
_KINDS = {np.float64: "f", np.int64: "iu", np.bool_: "b"}


def unfit_field(value: Any) -> str:
    """Name, type and value of the first field of a dataclass that is not of its type, "" if all
    are."""
    for name, hint, _ in _hints(type(value)):  # type: ignore[arg-type]
        held = getattr(value, name)
        if not fits(held, hint):
            return f"{type(value).__name__}.{name} is {shown_type(held)}"
    return ""


@cache
def _hints(cls: type[Any]) -> tuple[tuple[str, Any, Callable[[object], bool]], ...]:
    """Name, type and test of usual values of each field of a dataclass."""
    hints = get_type_hints(cls)
    return tuple((f.name, h := hints[f.name], quick_test(h)) for f in fields(cls) if f.init)


def fits(value: object, hint: Any, exact: bool = True) -> bool:
    """True if a value is of a type as annotations name it; what a callable takes and returns is not
    looked at. exact: integers are no entries of arrays of floats, and lists are no tuples or
    arrays."""
    hint = _resolved(hint)
    if hint is Any or hint is Self or isinstance(hint, TypeVar):
        return True
    if hint is float or hint is int:
        number = Real if hint is float else Integral
        # value[()]: the number in an array without axes
        plain = value[()] if not exact and isinstance(value, np.ndarray) else value
        return isinstance(plain, number) and not isinstance(plain, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    of, inner = get_origin(hint), get_args(hint)
    if of in (Union, types.UnionType):
        return any([fits(value, h, exact) for h in inner])
    if of is Literal:
        return any(value is h or value == h and type(value) is type(h) for h in inner)
    if of is np.ndarray:
        return _is_array(value, _KINDS.get(get_args(inner[1])[0], ""), exact)
    if of is tuple and inner[-1:] != (...,):
        kind = tuple if exact else tuple | list
        return isinstance(value, kind) and len(value) == len(inner) and all(
            [fits(v, h, exact) for v, h in zip(value, inner, strict=True)])
    if of is not None and issubclass(of, Mapping):
        return isinstance(value, Mapping) and all(
            fits(k, inner[0], exact) and fits(v, inner[1], exact) for k, v in value.items())
    if of is not None and issubclass(of, Callable):  # type: ignore[arg-type]
        return callable(value)
    if of is not None and issubclass(of, Collection):
        kind = of if exact or not issubclass(of, Sequence) else tuple | list
        return isinstance(value, kind) and all([fits(v, inner[0], exact) for v in value])
    if hint is None or hint is types.NoneType:
        return value is None
    hint = of or hint
    if is_protocol(hint):
        return _has_members(type(value), hint) or all(  # type: ignore[arg-type]
            [hasattr(value, name) for name in get_protocol_members(hint)])
    return isinstance(value, hint)


@cache
def _resolved(hint: Any) -> Any:
    """Type that a named one (`type X = ..`, NumPy's NDArray) stands for."""
    of = get_origin(hint)
    if isinstance(of, _NAMED):
        return _resolved(of.__value__[get_args(hint)])
    return _resolved(hint.__value__) if isinstance(hint, _NAMED) else hint


def _is_array(value: object, kinds: str, exact: bool) -> bool:
    if exact:
        return isinstance(value, np.ndarray) and (not kinds or value.dtype.kind in kinds)
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return False
    return array.dtype.kind in (kinds if kinds != "f" else "fiu") or (
        not array.size and value is not None)


def unfit(value: object, hint: Any, finite: bool = True) -> str:
    """Description of what a plugin returned if it is not of the type that an annotation names, or
    not finite; "" if it is."""
    if not fits(value, hint, exact=False):
        return shown_type(value)
    return NOT_FINITE if finite and not _is_finite(value) else ""


@cache
def quick_test(hint: Any, finite: bool = True) -> Callable[[Any], bool]:
    """Quick test that accepts the usual values of an annotation, such as arrays of finite floats;
    `unfit` decides on all others."""
    hint = _resolved(hint)
    if hint is float:
        return lambda v: type(v) is float and (isfinite(v) or not finite)
    if hint in _BY_CLASS:
        return lambda v: type(v) is hint
    if is_protocol(hint):
        return lambda v: _has_members(type(v), hint)  # type: ignore[arg-type]
    # a class whose instances hold no numbers that would have to be finite
    if isinstance(hint, type) and not issubclass(hint, _WITH_NUMBERS):
        return lambda v: isinstance(v, hint)
    of, inner = get_origin(hint), get_args(hint)
    if of is Literal:
        return lambda v: type(v) is str and v in inner
    if of is np.ndarray and get_args(inner[1])[0] is np.float64:
        # squares of large numbers are not finite, either: `unfit` decides on these
        return lambda v: type(v) is np.ndarray and v.dtype == _FLOAT and (
            not finite or isfinite(np.vdot(v, v)))
    if of in (Union, types.UnionType):
        plain = _BY_CLASS & {*inner}
        tests = [quick_test(h, finite) for h in inner if h not in plain]
        return lambda v: type(v) in plain or any([test(v) for test in tests])
    tests = [quick_test(h, finite) for h in inner] if of is tuple else []
    if of is tuple and inner[-1:] != (...,):
        return lambda v: type(v) is tuple and len(v) == len(tests) and all(
            [test(part) for test, part in zip(tests, v, strict=True)])
    if of in (tuple, Sequence) and inner[0] in _BY_CLASS:
        return lambda v: type(v) in (tuple, list) and {*map(type, v)} <= {inner[0]}
    return lambda v: False


@cache
def _has_members(cls: type[Any], protocol: type[Any]) -> bool:
    """True if a class has all members of a protocol; a member may also be an attribute of an
    object alone."""
    return all([hasattr(cls, name) for name in get_protocol_members(protocol)])


def unfit_arrays(value: Any) -> str:
    """Description of the first field of a dataclass that is not of its type or not finite."""
    for name, hint, fits_quickly in _hints(type(value)):  # type: ignore[arg-type]
        content = getattr(value, name)
        if not fits_quickly(content) and (wrong := unfit(content, hint)):
            return f"a {type(value).__name__} whose {name} is {wrong}"
    return ""


def _is_finite(value: object) -> bool:
    """False if a number, or an array that holds numbers, alone or in a sequence or mapping, is not
    finite."""
    if isinstance(value, float | np.floating | np.ndarray):
        array = np.asarray(value)
        return array.dtype.kind not in "fc" or bool(np.isfinite(array).all())
    if isinstance(value, Mapping):
        return all(map(_is_finite, value.values()))
    return not isinstance(value, list | tuple) or all(map(_is_finite, value))


def shown_type(value: object) -> str:
    """A value in a few words."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} of shape {value.shape}"
    if isinstance(value, tuple | list) and len(value) < 5:
        return f"({', '.join(map(shown_type, value))})"
    plain = value is None or isinstance(value, bool | int | float | complex | str | Enum)
    return repr(value)[:40] if plain else _with_article(type(value).__name__)


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'AEIO' else 'a'} {name}"


def required_type(hint: Any) -> str:
    """A type in words."""
    hint = _resolved(hint)
    of, inner = get_origin(hint), get_args(hint)
    if of is np.ndarray:
        kind = {"f": "finite numbers", "iu": "integers", "b": "truth values"}.get(
            _KINDS.get(get_args(inner[1])[0], ""), "values")
        return f"an array of {kind}"
    if hint is float or hint is int:
        return "a finite number" if hint is float else "an integer"
    if of in (Union, types.UnionType):
        return " or ".join(map(required_type, inner))
    if of is Literal:
        return " or ".join(map(repr, inner))
    if of is tuple and inner[-1:] != (...,):
        return f"({', '.join(map(required_type, inner))})"
    if inner and of is not None and issubclass(of, Collection):
        return f"a {of.__name__.lower()} of {' and '.join(map(required_type, inner[:2]))}".replace(
            " and ...", "")
    if hint is None or hint is types.NoneType or hint is bool:
        return "True or False" if hint is bool else "None"
    return _with_article(getattr(of or hint, "__name__", str(hint)))
