"""Check of plugin classes against the contract of their kind, before a plugin is used.

A plugin derives from its contract and has the defaults of it. Compared are names: nothing required
is missing, no public name is nearly that of a member, and a method takes the arguments of the
contract. Return values are checked at first use (`core.registry.boundary`).
"""

import difflib
import inspect
from abc import ABC
from collections.abc import Mapping
from functools import cache
from typing import Any, Generic, Protocol, get_type_hints

from pydantic import BaseModel
from typing_extensions import get_protocol_members, is_protocol

from sparsemor.core.protocols.basis import Basis
from sparsemor.core.protocols.body import Body, BodyPlugin, Material
from sparsemor.core.protocols.connector import Load, LoadPlugin
from sparsemor.core.protocols.contact import Contact, ContactPlugin, FrictionLaw, NormalLaw
from sparsemor.core.protocols.integrator import Integrator
from sparsemor.core.protocols.joint import Joint, JointPlugin
from sparsemor.core.protocols.linear_solver import LinearSolver
from sparsemor.core.protocols.mesh import MeshPlugin
from sparsemor.core.protocols.plugin import API, Plugin
from sparsemor.core.protocols.reducer import Reducer
from sparsemor.core.protocols.sampler import Preconditioner, Sampler
from sparsemor.core.protocols.sparse_solver import SparseSolver
from sparsemor.core.protocols.time_function import Function
from sparsemor.core.registry.hooks import Observer
from sparsemor.core.registry.value_types import fits, required_type

CONTRACTS: Mapping[str, type] = {
    "basis": Basis, "body": BodyPlugin, "contact": ContactPlugin,
    "friction_law": FrictionLaw, "function": Function, "integrator": Integrator,
    "joint": JointPlugin, "linear_solver": LinearSolver, "load": LoadPlugin,
    "material": Material, "mesh": MeshPlugin, "normal_law": NormalLaw, "observer": Observer,
    "preconditioner": Preconditioner, "reducer": Reducer, "sampler": Sampler,
    "sparse_solver": SparseSolver,
}
"""Kind of plugin -> contract of the plugin class."""
PARTS: Mapping[str, type] = {
    "body": Body, "contact": Contact, "joint": Joint, "load": Load}
"""Kind of plugin -> contract of the object that its `build` returns."""
PAGE = "docs/developers/version-3.md"
"""The page on what plugins for version 2 have to rename."""
CLOSE = 0.82
"""Similarity (difflib ratio) from which an unknown name is reported as a misspelt member:
`smaple` and `sample` have 0.83; `nodes` and `notes`, two words, 0.80."""
_ROOTS = frozenset({*BaseModel.__mro__, ABC, Generic, Protocol})


@cache
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


@cache
def required(contract: type) -> dict[str, str]:
    """Members of a contract that have no default, methods with their arguments, by name."""
    return {n: shape(n, m) for n, m in members(contract).items()
            if m is None or getattr(m, "__isabstractmethod__", False)}


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
    if not issubclass(cls, contract):
        return (f"it does not derive from sparsemor.core.{contract.__name__}, as plugins do since "
                f"version {API} of the extension API ({PAGE})",)
    built = members(PARTS[kind]) if kind in PARTS else {}
    return (*(f"lacks {text}" for name, text in required(contract).items()
              if name in getattr(cls, "__abstractmethods__", ())),
            *part_breaches(contract, cls, built),
            *(f"{n} is a value without a type: write {n}: type = value to make it an option"
              for n, m in _own(cls, contract).items() if isinstance(m, str | bool)
              and n not in members(contract) and not any(
                  n in inspect.get_annotations(c) for c in cls.__mro__)))


def part_breaches(contract: type, cls: type, also: Mapping[str, object]) -> list[str]:
    """Violations of a contract by the class of a built object, except missing members. also:
    further members that a misspelt name may mean."""
    required_members, members_of_class = members(contract), _own(cls, contract)
    unused = [n for n in {**also, **required_members} if n not in members_of_class]
    similar = {n: difflib.get_close_matches(n, unused, n=1, cutoff=CLOSE) for n in members_of_class
            if n not in required_members}
    misfits = [_misfit(n, members_of_class[n], member) for n, member in required_members.items()
               if n in members_of_class]
    return [*filter(None, misfits), *(f"{n} is not looked for: did you mean {found[0]}?"
                                      for n, found in similar.items() if found)]


def refusal(kind: str, cls: type) -> str:
    """All violations of a class in one sentence, "" if there are none."""
    found = breaches(kind, cls)
    return f"breaks the contract {CONTRACTS[kind].__name__}: {'; '.join(found)}" if found else ""


def chosen(kind: str, cls: type) -> dict[str, object]:
    """Members with a default that a class of this kind has written itself."""
    contract = CONTRACTS.get(kind, Plugin)
    own, needed = _own(cls, contract), required(contract)
    return {n: m for n, m in members(contract).items() if n in own and n not in needed}


def origin(plugin: object) -> str:
    """Module and name of the class of a plugin."""
    cls = type(plugin)
    return f"{cls.__module__}.{cls.__qualname__}"


def shape(name: str, member: object) -> str:
    """Signature of a method without types, such as `sample(block, m, dictionary, rng, required)`;
    the bare name of a value."""
    return f"{name}{_call(member) or ''}"


def _own(cls: type, contract: type) -> dict[str, Any]:
    """Public names that a class adds to its contract or replaces in it, except options."""
    added = [c for c in reversed(cls.__mro__) if c not in (*_ROOTS, *contract.__mro__, Plugin)
             and not is_protocol(c)]
    options = set(getattr(cls, "model_fields", ()))
    return {n: m for c in added for n, m in vars(c).items()
            if not n.startswith("_") and n not in {*options, "model_config", "sparsemor_api"}}


def _misfit(name: str, has: Any, wanted: Any) -> str:
    """The form of a member that differs from that in the contract, in words, "" if none does. has:
    the member of the class, wanted: that of the contract."""
    mine, theirs = _call(has), _call(wanted)
    if theirs is None:
        if mine is not None:
            return f"{name} must be a property or a value, and is a method"
        plain = isinstance(wanted, property) and not hasattr(has, "__get__")
        hint = get_type_hints(wanted.fget).get("return", Any) if plain else Any
        return "" if fits(has, hint, exact=False) else (
            f"{name} must be {required_type(hint)} (got {has!r})")
    if mine is None:
        return "" if callable(has) else f"{name} must be a method {shape(name, wanted)}"
    always, rest = list[str](), dict[str, None]()
    for argument in theirs.parameters.values():
        if argument.default is argument.empty:
            always.append(argument.name)
        else:
            rest[argument.name] = None
    try:
        # calls without what has a default, with all by position, and with the rest by name
        for arguments, named in ((always, {}), ([*always, *rest], {}), (always, rest)):
            mine.bind(*arguments, **named)
    except TypeError as error:
        return f"{name}{mine} cannot be called as {shape(name, wanted)} ({error})"
    order, names = [*always, *rest], list(mine.parameters)
    moved = [n for i, n in enumerate(order) if n in names[:len(order)] and names[i] != n]
    return (f"{name}{mine} has {' and '.join(moved)} at other positions than "
            f"{shape(name, wanted)}") if moved else ""


def _call(member: Any) -> inspect.Signature | None:
    """Signature of a method without types and `self`; None for what is no method."""
    function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
    if not inspect.isfunction(function):
        return None
    own = 0 if isinstance(member, staticmethod) else 1
    parameters = [*inspect.signature(function).parameters.values()][own:]
    return inspect.Signature([p.replace(annotation=p.empty) for p in parameters])
