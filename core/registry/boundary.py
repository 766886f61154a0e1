"""Boundary between core and plugins: methods that name the plugin when something goes wrong in it.

When a class is admitted, as a plugin or as what a plugin has built, each member that its protocol
names gets a checked form: an exception in it, and a value of another type or shape than the
protocol says, or that is not finite, becomes a `PluginError`, one line with the distribution, the
plugin, the method and the place in its file. Arrays are handed over read-only. First-party classes
are treated alike. `naming_plugins` does the same for exceptions from code of a plugin that core
does not call by a protocol, such as the force law of a joint.
"""

import inspect
import operator
import re
import traceback
from abc import ABC
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from copy import copy
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from math import isfinite
from types import CodeType, FunctionType, TracebackType
from typing import Any, get_type_hints

import numpy as np
from scipy.sparse import csr_array
from typing_extensions import is_protocol

from sparsemor.core.errors import InputError, PluginError
from sparsemor.core.protocols.plugin import OWN, PREFIX, Plugin
from sparsemor.core.registry.contracts import CONTRACTS, members
from sparsemor.core.registry.installed import entry_points
from sparsemor.core.registry.value_checks import CHECKS, EVERY_STEP, NAN_ALLOWED
from sparsemor.core.registry.value_types import (
    NOT_FINITE,
    quick_test,
    required_type,
    unfit,
)
from sparsemor.core.status import SolveFailed

_MARK = "_sparsemor_checked"
_IMMUTABLE = frozenset({float, int, bool, str, type(None)})
_ARRAYS = re.compile("ndarray|Array|Any|Csr|Matrix|BlockData")
"""Types of fields, as written, that hold arrays."""
_HUGE = 1e100
"""Magnitude of arguments from which a law may overflow."""
_PLUGIN_FOLDERS = tuple(f"sparsemor.{f}." for f in ("bodies", "reducers", "plugins", "integrators"))


def admit(kind: str, cls: type) -> None:
    """Guards a class of plugins by the contract of its kind."""
    if kind in CONTRACTS:
        guard(CONTRACTS[kind], cls)


def guard(contract: type, cls: type, names: Iterable[str] | None = None) -> None:
    """Puts the checked form of each member of a contract that a class has written into it, once.
    What a member returns by another contract is guarded when it is returned. names: of some
    members."""
    for name, declared in members(contract).items():
        written = inspect.getattr_static(cls, name, None)
        if written is declared or (names is not None and name not in names):
            continue  # a default needs no check
        if isinstance(written, FunctionType) and isinstance(declared, FunctionType):
            if not hasattr(written, _MARK):
                _put(cls, name, _checked(written, contract, declared))
        elif isinstance(written, property) and isinstance(declared, property):
            get = written.fget
            if isinstance(get, FunctionType) and not hasattr(get, _MARK) and declared.fget:
                _put(cls, name, written.getter(_checked(get, contract, declared.fget)))


def _hints_of(function: Any) -> dict[str, Any]:
    try:
        return get_type_hints(function)
    except NameError:  # names for type checkers alone
        return {}


def _is_base(hint: Any) -> bool:
    """True for a contract of objects that plugins build, such as `Body` and `StepSolver`."""
    return isinstance(hint, type) and issubclass(hint, ABC) and not issubclass(hint, Plugin)


def _put(cls: type, name: str, member: object) -> None:
    with suppress(AttributeError, TypeError):  # a class written in C
        setattr(cls, name, member)


def _checked(function: FunctionType, protocol: type, protocol_method: Any) -> FunctionType:
    """The function of a plugin with checks of what it raises, takes and returns, by the annotations
    of the method of the protocol.

    A method that every step calls (`EVERY_STEP`) gets a cheaper form, with one check of the value
    alone; core passes it positional arguments, which it does not protect from changes.
    """
    name, hints = function.__name__, _hints_of(protocol_method)
    hint = hints.pop("return", Any)
    check = CHECKS.get((protocol.__name__, name))
    finite = (protocol.__name__, name) not in NAN_ALLOWED
    names = list(inspect.signature(protocol_method).parameters)[1:]
    takes_data = any([h not in (float, int, str) for h in hints.values()])
    returned_protocol = hint if is_protocol(hint) or _is_base(hint) else None
    guarded_types = set[type]()
    step_check = EVERY_STEP.get((protocol.__name__, name))
    fits_quickly = quick_test(hint, finite)
    # type of usual values that need no test but this; of a float `CHECKS` ask that it is finite
    plain = hint if hint is float or hint in _IMMUTABLE and check is None else None
    no_further_checks = returned_protocol is None and check is None

    @wraps(function)
    def call_in_step(self: Any, *given: Any) -> Any:
        try:
            value = function(self, *given)
        except (InputError, SolveFailed):
            raise
        except (Exception, SystemExit) as error:
            raise _raised(error, self, function) from error
        if step_check is not None and (wrong := step_check(value, self)):
            raise _returned(wrong, hint, self, function)
        return value

    @wraps(function)
    def call(self: Any, *given: Any, **named: Any) -> Any:
        """The method, with arrays among its arguments read-only. What it returns must be of the
        type `hint`, finite if so required, and pass `check`; if it is of a contract of its own
        (`returned_protocol`), its class is guarded. takes_data: True if an argument may have
        arrays; fits_quickly: test that accepts usual values, `unfit` decides on all others;
        is_number: a float is wanted, which needs to be finite alone."""
        if takes_data:
            given = _all_read_only(given)
            if named:
                named = dict(zip(named, _all_read_only(named.values()), strict=True))
        try:
            value = function(self, *given, **named)
        except (InputError, SolveFailed):
            raise
        except (Exception, SystemExit) as error:
            raise _raised(error, self, function) from error
        if type(value) is plain and (plain is not float or isfinite(value)):
            return value
        fits = fits_quickly(value)
        if fits and no_further_checks:
            return value
        wrong = "" if fits else unfit(value, hint, finite)
        if not wrong and check is not None:
            wrong = check(value, self, dict(zip(names, given, strict=False), **named))
        # a law of a diverging step may overflow: the status of the step reports that
        if wrong and not (NOT_FINITE in wrong and _overflows(given)):
            raise _returned(wrong, hint, self, function)
        if returned_protocol is not None and type(value) not in guarded_types:
            guard(returned_protocol, type(value))
            guarded_types.add(type(value))
        return value

    made = call if step_check is None else call_in_step
    setattr(made, _MARK, True)
    assert isinstance(made, FunctionType)
    return made


def _overflows(given: tuple[Any, ...]) -> bool:
    """True if an argument is not finite, or so large that a law may overflow: the step diverges."""
    numbers = (v for v in given if isinstance(v, float | np.ndarray))
    return any(not np.all(np.abs(v) < _HUGE) for v in numbers)


# ------------------------------------------------------------------ arrays


def read_only(value: Any) -> Any:
    """The value with arrays that cannot be written to, its own and those of a dataclass; the arrays
    of the caller stay as they are."""
    return _all_read_only((value,))[0]


def _all_read_only(values: Iterable[Any]) -> tuple[Any, ...]:
    """`read_only` of each of the values."""
    found = []
    for value in values:
        if isinstance(value, np.ndarray):
            if value.flags.writeable:
                value = value.view()
                value.setflags(write=False)
        elif type(value) not in _IMMUTABLE:
            value = _parts_read_only(value)
        found.append(value)
    return tuple(found)


def _parts_read_only(value: Any) -> Any:
    """The matrix, or the dataclass that cannot be changed, with read-only arrays; any other value
    as it is."""
    if isinstance(value, csr_array):
        if not value.has_canonical_format:  # scipy would sort the entries in place later
            value = value.copy()
            value.sum_duplicates()
        parts = value.data, value.indices, value.indptr
        views = _all_read_only(parts)
        if all(map(operator.is_, views, parts)):
            return value
        made = csr_array(views, shape=value.shape, copy=False)
        made.has_canonical_format = True
        return made
    if not is_dataclass(type(value)) or not type(value).__dataclass_params__.frozen:
        return value
    names = _array_fields(type(value))  # type: ignore[arg-type]
    held = [getattr(value, name) for name in names]
    made = value
    for name, now, then in zip(names, _all_read_only(held), held, strict=True):
        if now is not then:
            made = copy(value) if made is value else made
            object.__setattr__(made, name, now)
    return made


@cache
def _array_fields(cls: Any) -> tuple[str, ...]:
    """Fields of a dataclass that hold arrays, matrices or dataclasses with these."""
    return tuple([f.name for f in fields(cls) if _ARRAYS.search(str(f.type))])


# ------------------------------------------------------------------ messages


@contextmanager
def naming_plugins() -> Iterator[None]:
    """Context in which an exception from the code of a plugin becomes a `PluginError`; others pass
    through."""
    try:
        yield
    except (InputError, SolveFailed):
        raise
    except (Exception, SystemExit) as error:
        if found := _fault_of(error):
            raise found from error
        raise


def _fault_of(error: BaseException) -> PluginError | None:
    """Fault of the plugin whose code an exception comes from; None if none has its part in it, and
    for files and streams that our own code cannot read or write."""
    frame = _third_party(error.__traceback__)
    if frame is None and not isinstance(error, OSError):
        frame = next((f for f in reversed(_frames(error.__traceback__))
                      if f.module.startswith(_PLUGIN_FOLDERS)), None)
    return None if frame is None else _fault(
        frame.module, _owner(frame.module), frame.code.co_qualname, _message_of(error), frame.place)


class _Frame:
    """Frame of a traceback."""

    def __init__(self, frame: Any, line: int) -> None:
        self.module = str(frame.f_globals.get("__name__", ""))
        self.code: CodeType = frame.f_code
        self.place = f"{self.code.co_filename}:{line}"


def _frames(trace: TracebackType | None) -> list[_Frame]:
    return [_Frame(frame, line) for frame, line in traceback.walk_tb(trace)]


def _third_party(trace: TracebackType | None) -> _Frame | None:
    """Innermost frame in the code of a distribution of plugins other than our own."""
    known = {_root(e.module) for e in entry_points()} - {OWN}
    return next((f for f in reversed(_frames(trace)) if _root(f.module) in known), None)


def _raised(error: BaseException, plugin: object, function: FunctionType) -> PluginError:
    """Fault of an exception in a method of a plugin, or in the code of another one that it
    calls."""
    if _root(type(plugin).__module__) == OWN and _third_party(error.__traceback__) is not None:
        return _fault_of(error) or PluginError(_message_of(error))
    frames_in_file = [f for f in _frames(error.__traceback__)
           if f.code.co_filename == function.__code__.co_filename]
    return _fault_in(plugin, function, _message_of(error), (
        frames_in_file[-1].place if frames_in_file else _definition(function)))


def _returned(wrong: str, hint: Any, plugin: object, function: FunctionType) -> PluginError:
    return _fault_in(plugin, function, f"returned {wrong}, where {required_type(hint)} is required",
               _definition(function))


def _fault_in(plugin: object, function: FunctionType, message: str, place: str) -> PluginError:
    cls = type(plugin)
    return _fault(cls.__module__, _described(cls), f"{cls.__name__}.{function.__name__}", message,
                  place)


def _fault(module: str, owner: str, method: str, message: str, place: str) -> PluginError:
    made = PluginError(f"{owner}: {method} {message} ({place}); report it to the authors of that "
                       "plugin")
    made.own = _root(module) == OWN
    return made


def _message_of(error: BaseException) -> str:
    first = (str(error).splitlines() or [""])[0]
    return f"raised {type(error).__name__}{': ' if first else ''}{first}"


def _definition(function: FunctionType) -> str:
    return f"{function.__code__.co_filename}:{function.__code__.co_firstlineno}"


def _root(module: str) -> str:
    return module.partition(".")[0]


def _described(cls: type) -> str:
    """Kind, name, distribution and version of a plugin class; for other classes of the package the
    distribution alone."""
    for e in entry_points():
        if e.value.replace(" ", "") == f"{cls.__module__}:{cls.__qualname__}" and e.dist:
            return f"{e.group.removeprefix(PREFIX)} {e.name} of {e.dist.name} {e.dist.version}"
    return _owner(cls.__module__)


def _owner(module: str) -> str:
    return _providers().get(_root(module), f"module {module}, of no installed distribution")


def _providers() -> Mapping[str, str]:
    """Top-level module -> name and version of the distribution whose plugins it holds."""
    # the name of a distribution is parsed from its metadata at each access: once for each module
    found = {_root(e.module): e.dist for e in entry_points() if e.dist}
    return {module: f"{dist.name} {dist.version}" for module, dist in found.items()}
