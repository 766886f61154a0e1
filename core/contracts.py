"""Contracts of plugin kinds: members and signatures that a class must have before it is used.

A plugin class is checked when it is chosen, against the protocol of its kind: each member must be
there, a method must be callable as the protocol calls it, and a property must be a value. What a
method returns is checked where it is first used (`core.returned`).
"""

import difflib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from typing_extensions import get_protocol_members

from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import (
    Basis,
    BodyPlugin,
    ConnectorPlugin,
    FrictionLaw,
    Integrator,
    LinearSolver,
    MeshPlugin,
    NormalLaw,
    Preconditioner,
    Reducer,
    Sampler,
    SparseSolver,
    TimeFunction,
)

_ABSENT = object()
CLOSE = 0.8
"""Likeness (difflib ratio) from which a name counts as a misspelling of a member's."""


@dataclass(frozen=True, slots=True)
class Contract:
    """Protocol of a kind, and the names of optional abilities that core or reducers look for."""

    protocol: type
    optional: tuple[str, ...] = ()


_CONNECTOR = Contract(ConnectorPlugin, ("acts_on",))
CONTRACTS: Mapping[str, Contract] = {
    "basis": Contract(Basis, ("count", "most_atoms", "unfit")),
    "body": Contract(BodyPlugin, ("expected", "fields")),
    "contact": _CONNECTOR,
    "friction_law": Contract(FrictionLaw),
    "function": Contract(TimeFunction, ("curvature",)),
    "integrator": Contract(Integrator, ("notes",)),
    "joint": _CONNECTOR,
    "linear_solver": Contract(LinearSolver, ("expected", "direct")),
    "load": _CONNECTOR,
    "mesh": Contract(MeshPlugin, ("expected",)),
    "normal_law": Contract(NormalLaw),
    "preconditioner": Contract(Preconditioner),
    "reducer": Contract(Reducer, (
        "check", "basis", "bases", "force_basis", "snapshot_copies", "budgets", "resample")),
    "sampler": Contract(Sampler, ("required", "unit")),
    "sparse_solver": Contract(SparseSolver, ("capabilities", "screen")),
}
"""Kinds of plugins whose classes are checked. Observers are checked when they are registered."""


@cache
def breaches(kind: str, cls: type) -> tuple[str, ...]:
    """What keeps a class from being a plugin of this kind, in words; () when nothing does."""
    contract = CONTRACTS.get(kind)
    if contract is None:
        return ()
    members = sorted(get_protocol_members(contract.protocol))
    found = [text for m in members if (text := _breach(cls, contract.protocol, m))]
    return (*found, *_misspelled(cls, members, contract.optional))


def refusal(kind: str, cls: type) -> str:
    """The breaches of a class in one sentence, "" when there are none."""
    found = breaches(kind, cls)
    return f"breaks the protocol {CONTRACTS[kind].protocol.__name__}: {'; '.join(found)}" if (
        found) else ""


def absent_members(protocol: type, value: object) -> list[str]:
    """Members of a protocol that an object lacks, methods with their arguments."""
    return [_shape(protocol, m) for m in sorted(get_protocol_members(protocol))
            if inspect.getattr_static(value, m, _ABSENT) is _ABSENT]


def origin(plugin: object) -> str:
    """Module and name of the class of a plugin."""
    cls = type(plugin)
    return f"{cls.__module__}.{cls.__qualname__}"


def _breach(cls: type, protocol: type, member: str) -> str:
    wanted = inspect.getattr_static(protocol, member)
    has = _member(cls, member)
    if has is _ABSENT:
        close = difflib.get_close_matches(member, _public(cls), n=1, cutoff=CLOSE)
        hint = f" ({close[0]} is near to it)" if close else ""
        return f"lacks {_shape(protocol, member)}{hint}"
    if isinstance(wanted, property):
        if _function(has) is not None:
            return f"{member} must be a property or a value, and is a method"
        return ""
    function = _function(has)
    if function is None:
        return "" if callable(has) else f"{member} must be a method {_shape(protocol, member)}"
    return _unfit(function, isinstance(has, staticmethod), protocol, member)


def _unfit(function: Callable[..., Any], static: bool, protocol: type, member: str) -> str:
    """Why a method cannot be called as the protocol calls it, "" where it can."""
    wanted = _parameters(protocol, member)
    try:
        given = inspect.signature(function)
    except (TypeError, ValueError):  # written in C: it does not say
        return ""
    self_too: list[object] = [] if static else [None]
    always = [p.name for p in wanted if p.default is p.empty]
    rest = {p.name: None for p in wanted if p.default is not p.empty}
    try:
        given.bind(*self_too, *always)
        given.bind(*self_too, *always, *rest)
        given.bind(*self_too, *always, **rest)
    except TypeError as error:
        return (f"{member}{_without_types(given, static)} cannot be called as "
                f"{_shape(protocol, member)} ({error})")
    names = list(given.parameters)[len(self_too):]
    order = [p.name for p in wanted]
    moved = [n for i, n in enumerate(order) if n in names[:len(order)] and names[i] != n]
    if moved:
        return (f"{member}{_without_types(given, static)} has {' and '.join(moved)} at other "
                f"places than {_shape(protocol, member)}")
    return ""


def _misspelled(cls: type, members: list[str], optional: tuple[str, ...]) -> list[str]:
    """Public attributes that nobody looks for and that are all but the name of an ability."""
    known = {*members, *optional}
    found = []
    for name in _public(cls):
        near = difflib.get_close_matches(name, optional, n=1, cutoff=CLOSE)
        if name not in known and near and _member(cls, near[0]) is _ABSENT:
            found.append(f"{name} is not looked for: did you mean {near[0]}?")
    return found


def _public(cls: type) -> list[str]:
    """Attributes that a class adds to `Plugin`, its options left out."""
    names = {n for c in cls.__mro__ if c is not object and c not in Plugin.__mro__
             for n in vars(c) if not n.startswith("_")}
    return sorted(names - _annotated(cls) - {"model_config"})


def _annotated(cls: type) -> set[str]:
    """Names of options, fields and annotated class variables."""
    return {n for c in cls.__mro__ if c not in Plugin.__mro__ for n in inspect.get_annotations(c)}


def _member(cls: type, name: str) -> object:
    """A class's attribute without binding it; None for a field without a default."""
    absent = None if name in _annotated(cls) else _ABSENT
    return inspect.getattr_static(cls, name, absent)


def _function(member: object) -> Callable[..., Any] | None:
    if isinstance(member, staticmethod | classmethod):
        wrapped: Callable[..., Any] = member.__func__
        return wrapped
    return member if inspect.isfunction(member) else None


def _parameters(protocol: type, member: str) -> list[inspect.Parameter]:
    wanted = inspect.getattr_static(protocol, member)
    return list(inspect.signature(wanted).parameters.values())[1:]


def _shape(protocol: type, member: str) -> str:
    """`sample(block, m, dictionary, rng, required)`, or the bare name of a property."""
    if not inspect.isfunction(inspect.getattr_static(protocol, member, None)):
        return member
    return member + _written(_parameters(protocol, member))


def _without_types(given: inspect.Signature, static: bool) -> str:
    return _written(list(given.parameters.values())[0 if static else 1:])


def _written(parameters: list[inspect.Parameter]) -> str:
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in parameters]
    return f"({', '.join(map(str, bare))})"
