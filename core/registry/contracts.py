"""Check of plugin classes against the contract of their kind, before a plugin is used.

A plugin derives from its contract and has the defaults of it; what is checked is what a type
checker of the plugin's author would find: nothing required is missing, a method takes the arguments
of the contract, and no public name is nearly that of a member. Return values are checked at first
use (`core.registry.boundary`).
"""

import difflib
import inspect
from abc import ABC
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Generic, Literal, Protocol, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from typing_extensions import get_protocol_members, is_protocol

from sparsemor.core.protocols import (
    Basis,
    Body,
    BodyPlugin,
    Contact,
    ContactPlugin,
    FrictionLaw,
    Function,
    Integrator,
    Joint,
    JointPlugin,
    LinearSolver,
    Load,
    LoadPlugin,
    Material,
    MeshPlugin,
    NormalLaw,
    Preconditioner,
    Reducer,
    Sampler,
    SparseSolver,
)
from sparsemor.core.protocols.plugin import API, Plugin
from sparsemor.core.registry.hooks import Observer

CONTRACTS: Mapping[str, type] = {
    "basis": Basis, "body": BodyPlugin, "contact": ContactPlugin, "friction_law": FrictionLaw,
    "function": Function, "integrator": Integrator, "joint": JointPlugin,
    "linear_solver": LinearSolver, "load": LoadPlugin, "material": Material, "mesh": MeshPlugin,
    "normal_law": NormalLaw, "observer": Observer, "preconditioner": Preconditioner,
    "reducer": Reducer, "sampler": Sampler, "sparse_solver": SparseSolver,
}
"""Kind of plugin -> contract of the plugin class."""
PARTS: Mapping[str, type] = {"body": Body, "contact": Contact, "joint": Joint, "load": Load}
"""Kind of plugin -> contract of the object that its `build` returns."""
PAGE = "docs/developers/version-3.md"
"""The page on what plugins for version 2 have to rename."""
CLOSE = 0.8
"""Similarity (difflib ratio) of a name that is suggested for a missing member."""
TYPING_ERROR = 0.85
"""Similarity (difflib ratio) from which an unknown name is reported as a misspelt member:
`localised` and `localized` have 0.89; `nodes` and `notes`, two words, 0.80."""
_ROOTS = frozenset({*BaseModel.__mro__, ABC, Generic, Protocol})
_ABSENT = object()


def members(contract: type) -> dict[str, object]:
    """Public members of a contract, a class with defaults or a protocol, as they stand in it; None
    for data that are annotated only."""
    if is_protocol(contract):
        return {m: inspect.getattr_static(contract, m, None)
                for m in sorted(get_protocol_members(contract))}
    found: dict[str, object] = {}
    for c in reversed(contract.__mro__):
        if c not in _ROOTS:
            found |= {**dict.fromkeys(inspect.get_annotations(c)), **vars(c)}
    return {n: found[n] for n in sorted(found)
            if not n.startswith("_") and n not in ("model_config", "sparsemor_api")}


def required(contract: type) -> list[str]:
    """Members of a contract that have no default."""
    given = members(contract)
    return list(given) if is_protocol(contract) else [
        n for n, m in given.items() if m is None or getattr(m, "__isabstractmethod__", False)]


@cache
def breaches(kind: str, cls: type) -> tuple[str, ...]:
    """Violations by a class of the contract of this kind of plugin, in words; () if there are
    none."""
    contract = CONTRACTS.get(kind)
    if contract is None:
        return ()
    made_for = inspect.getattr_static(cls, "sparsemor_api", API)
    if made_for != API:
        return (f"it was written for version {made_for} of the extension API, and this is version "
                f"{API} ({PAGE})",)
    if not is_protocol(contract) and not issubclass(cls, contract):
        return (f"it does not derive from sparsemor.core.{contract.__name__}, as plugins do since "
                f"version {API} of the extension API ({PAGE})",)
    wanted, public = members(contract), _public(cls, contract)
    lacking = [n for n in required(contract) if _member(cls, n) is _ABSENT]
    near = {n: difflib.get_close_matches(n, public, n=1, cutoff=CLOSE) for n in lacking}
    hints = {n: f" ({found[0]} is near to it)" if found else "" for n, found in near.items()}
    others = sorted({*public} - {n for found in near.values() for n in found})
    built = members(PARTS[kind]) if kind in PARTS else {}
    return (*(f"lacks {shape(n, wanted[n])}{hints[n]}" for n in lacking),
            *_misfits(cls, wanted), *_misspelt(cls, others, {**built, **wanted}),
            *(f"{n} is a value without a type: write {n}: type = value to make it an option"
              for n in others if n not in wanted and not _annotated(cls, n)
              and isinstance(inspect.getattr_static(cls, n), str | bool)))


def part_breaches(contract: type, cls: type) -> list[str]:
    """Violations of a contract by the class of a built object, except missing members."""
    wanted = members(contract)
    return [*_misfits(cls, wanted), *_misspelt(cls, _public(cls, contract), wanted)]


def refusal(kind: str, cls: type) -> str:
    """All violations of a class in one sentence, "" if there are none."""
    found = breaches(kind, cls)
    return f"breaks the contract {CONTRACTS[kind].__name__}: {'; '.join(found)}" if found else ""


def chosen(kind: str, cls: type) -> dict[str, object]:
    """Members with a default that a class of this kind has written itself."""
    if kind not in CONTRACTS:
        return {}
    needed = required(CONTRACTS[kind])
    return {n: m for n, m in members(CONTRACTS[kind]).items()
            if n not in needed and inspect.getattr_static(cls, n, m) is not m}


def absent_members(contract: type, value: object) -> list[str]:
    """Required members that an object lacks, methods with their arguments."""
    return [shape(n, members(contract)[n]) for n in required(contract)
            if inspect.getattr_static(value, n, _ABSENT) is _ABSENT]


def origin(plugin: object) -> str:
    """Module and name of the class of a plugin."""
    cls = type(plugin)
    return f"{cls.__module__}.{cls.__qualname__}"


def shape(name: str, member: object) -> str:
    """Signature of a method without types, such as `sample(block, m, dictionary, rng, required)`;
    the bare name of a value."""
    function = _function(member)
    return f"{name}{_call(function)}" if inspect.isfunction(function) else name


def shapes(contract: type) -> list[str]:
    """Required members of a contract, methods with their arguments."""
    return [shape(n, members(contract)[n]) for n in required(contract)]


def _misfits(cls: type, wanted: Mapping[str, object]) -> list[str]:
    """Members that a class has in another form than the contract."""
    return [text for n, m in wanted.items()
            if (has := _member(cls, n)) is not m and has not in (None, _ABSENT)
            and (text := _misfit(n, has, m))]


def _misfit(name: str, has: Any, wanted: Any) -> str:
    own, wanted = _function(has), _function(wanted)
    if not inspect.isfunction(wanted):
        if inspect.isfunction(own):
            return f"{name} must be a property or a value, and is a method"
        plain = isinstance(wanted, property) and not inspect.isdatadescriptor(has)
        allowed = get_type_hints(wanted.fget).get("return") if plain else None
        if get_origin(allowed) is Literal and has not in get_args(allowed):
            return f"{name} must be {' or '.join(map(repr, get_args(allowed)))} (got {has!r})"
        return f"{name} must be True or False (got {has!r})" if (
            allowed is bool and not isinstance(has, bool)) else ""
    if not inspect.isfunction(own):
        return "" if callable(has) else f"{name} must be a method {shape(name, wanted)}"
    mine = _call(own, 0 if isinstance(has, staticmethod) else 1)
    theirs = _call(wanted).parameters.values()
    always = [p.name for p in theirs if p.default is p.empty]
    rest = {p.name: None for p in theirs if p.default is not p.empty}
    try:
        mine.bind(*always, *rest)
        mine.bind(*always, **rest)
        mine.bind(*always)
    except TypeError as error:
        return f"{name}{mine} cannot be called as {shape(name, wanted)} ({error})"
    order, names = [*always, *rest], list(mine.parameters)
    moved = [n for i, n in enumerate(order) if n in names[:len(order)] and names[i] != n]
    return (f"{name}{mine} has {' and '.join(moved)} at other positions than "
            f"{shape(name, wanted)}") if moved else ""


def _misspelt(cls: type, public: Iterable[str], wanted: Mapping[str, object]) -> list[str]:
    """Public names that are nearly that of a member which the class has not written."""
    free = [n for n, m in wanted.items() if _member(cls, n) in (_ABSENT, m)]
    near = ((n, difflib.get_close_matches(n, free, n=1, cutoff=TYPING_ERROR))
            for n in public if n not in wanted)
    return [f"{n} is not looked for: did you mean {found[0]}?" for n, found in near if found]


def _public(cls: type, contract: type) -> list[str]:
    """Public names that a class adds to its contract, except options."""
    names = {n for c in cls.__mro__ if c not in _ROOTS and c not in contract.__mro__
             and c is not Plugin and not is_protocol(c) for n in vars(c) if not n.startswith("_")}
    options = set(cls.model_fields) if issubclass(cls, BaseModel) else set[str]()
    return sorted(names - options - {"model_config", "sparsemor_api"})


def _member(cls: type, name: str) -> Any:
    """Class attribute without binding; None for a field without a default; absent where it is
    abstract."""
    if issubclass(cls, BaseModel) and name in cls.model_fields:
        return None
    found = inspect.getattr_static(cls, name, None if _annotated(cls, name) else _ABSENT)
    return _ABSENT if getattr(found, "__isabstractmethod__", False) else found


def _annotated(cls: type, name: str) -> bool:
    for c in cls.__mro__:
        if c not in _ROOTS and name in inspect.get_annotations(c):
            return True
    return False


def _function(member: Any) -> Any:
    return member.__func__ if isinstance(member, staticmethod | classmethod) else member


def _call(method: Any, skip: int = 1) -> inspect.Signature:
    """Signature of a method without types and `self`."""
    parameters = list(inspect.signature(method).parameters.values())[skip:]
    return inspect.Signature([p.replace(annotation=p.empty) for p in parameters])
