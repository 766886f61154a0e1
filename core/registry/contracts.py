"""Check of plugin classes against the protocol of their kind, before a plugin is used.

Each required member must exist, a method must accept the arguments of the protocol, and a property
must have an allowed value; optional protocols (`protocols.capabilities`) are checked if a class
implements part of them. A public name that is nearly that of a member is reported as a spelling
error. Return values are checked at first use (`core.registry.returned_values`).
"""

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

from typing_extensions import get_protocol_members, is_protocol

from sparsemor.core.protocols import (
    Basis,
    Body,
    BodyPlugin,
    Contact,
    ContactPlugin,
    FrictionLaw,
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
    TimeFunction,
)
from sparsemor.core.protocols.capabilities import BUILT, CAPABILITIES, EVERY
from sparsemor.core.registry.hooks import ObserverPlugin
from sparsemor.core.registry.plugin import API, Plugin

_ABSENT = object()
CLOSE = 0.8
"""Similarity (difflib ratio) above which a name is suggested for a missing member."""
TYPING_ERROR = 0.85
"""Similarity (difflib ratio) above which an unknown name is reported as a misspelt optional member:
`localised` and `localized` have 0.89; `nodes` and `notes`, two words, 0.80."""

CONTRACTS: Mapping[str, type] = {
    "basis": Basis, "body": BodyPlugin, "contact": ContactPlugin, "friction_law": FrictionLaw,
    "function": TimeFunction, "integrator": Integrator, "joint": JointPlugin,
    "linear_solver": LinearSolver, "load": LoadPlugin, "material": Material, "mesh": MeshPlugin,
    "normal_law": NormalLaw, "observer": ObserverPlugin, "preconditioner": Preconditioner,
    "reducer": Reducer, "sampler": Sampler, "sparse_solver": SparseSolver,
}
"""Kind of plugin -> protocol of the plugin class."""
PARTS: Mapping[str, type] = {"body": Body, "contact": Contact, "joint": Joint, "load": Load}
"""Kind of plugin -> protocol of the object that its `build` returns."""


@cache
def breaches(kind: str, cls: type) -> tuple[str, ...]:
    """Violations by a class of the protocol of this kind of plugin, in words; () if there are
    none."""
    protocol = CONTRACTS.get(kind)
    if protocol is None:
        return ()
    abilities = (*CAPABILITIES.get(kind, ()), *EVERY)
    looked_for = _members((protocol, *abilities))
    return (*_version(cls), *_breaches(cls, protocol, get_protocol_members(protocol)),
            *_unfit_abilities(cls, abilities),
            *_misspelled(cls, _public(cls), looked_for,
                         _members((*abilities, *BUILT.get(kind, ())))))


def part_breaches(protocol: type, abilities: tuple[type, ...], cls: type) -> list[str]:
    """Violations of `protocol` and its optional protocols by the class of a built object, except
    missing members."""
    looked_for = _members((protocol, *abilities))
    public = {n for c in cls.__mro__ if c is not object and not is_protocol(c)
              for n in (*vars(c), *inspect.get_annotations(c)) if not n.startswith("_")}
    present = [m for m in get_protocol_members(protocol) if _member(cls, m) is not _ABSENT]
    return [*_breaches(cls, protocol, present), *_unfit_abilities(cls, abilities),
            *_misspelled(cls, sorted(public), looked_for, _members(abilities))]


def refusal(kind: str, cls: type) -> str:
    """All protocol violations of a class in one sentence, "" if there are none."""
    found = breaches(kind, cls)
    return f"breaks the protocol {CONTRACTS[kind].__name__}: {'; '.join(found)}" if found else ""


def required_members(kind: str) -> list[str]:
    """Required members of this kind of plugin, methods with their arguments."""
    protocol = CONTRACTS.get(kind)
    return [] if protocol is None else shapes(protocol)


def shapes(protocol: type) -> list[str]:
    """Members of a protocol, methods with their arguments."""
    return [_shape(protocol, m) for m in sorted(get_protocol_members(protocol))]


def abilities_of(kind: str, cls: type) -> list[type]:
    """Optional protocols of a kind of plugin that a class implements."""
    return [ability for ability in (*CAPABILITIES.get(kind, ()), *EVERY)
            if all(_member(cls, m) is not _ABSENT for m in get_protocol_members(ability))]


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
        return _unfit_value(has, wanted, member)
    function = _function(has)
    if function is None:
        return "" if callable(has) else f"{member} must be a method {_shape(protocol, member)}"
    return _unfit(function, isinstance(has, staticmethod), protocol, member)


def _unfit(function: Callable[..., Any], static: bool, protocol: type, member: str) -> str:
    """Reason why a method cannot be called with the arguments of the protocol, "" if it can."""
    wanted = _parameters(protocol, member)
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # written in C: it does not say
        return ""
    self_too: list[object] = [] if static else [None]
    always = [p.name for p in wanted if p.default is p.empty]
    rest = {p.name: None for p in wanted if p.default is not p.empty}
    try:
        signature.bind(*self_too, *always)
        signature.bind(*self_too, *always, *rest)
        signature.bind(*self_too, *always, **rest)
    except TypeError as error:
        return (f"{member}{_without_types(signature, static)} cannot be called as "
                f"{_shape(protocol, member)} ({error})")
    names = list(signature.parameters)[len(self_too):]
    order = [p.name for p in wanted]
    moved = [n for i, n in enumerate(order) if n in names[:len(order)] and names[i] != n]
    if moved:
        return (f"{member}{_without_types(signature, static)} has {' and '.join(moved)} at other "
                f"positions than {_shape(protocol, member)}")
    return ""


def _version(cls: type) -> list[str]:
    """Error for a plugin class written for another version of the extension interface, else []."""
    made_for = inspect.getattr_static(cls, "sparsemor_api", API)
    return [] if made_for == API else [
        f"it was written for version {made_for} of the extension API, and this is version {API}"]


def _breaches(cls: type, protocol: type, members: Iterable[str]) -> list[str]:
    """Violations by a class of the given members of a protocol, in words."""
    return [text for m in sorted(members) if (text := _breach(cls, protocol, m))]


def _unfit_abilities(cls: type, abilities: Sequence[type]) -> list[str]:
    """Violations of optional protocols that a class implements in part: it has one of the
    protocol's own methods (or one of its values, if it has no methods) but lacks or breaks another
    member. A value alone does not count, since it may be an option with a common name."""
    found = []
    for ability in abilities:
        own = _own_members(ability)
        telling = {m for m in own if _function(inspect.getattr_static(ability, m, None))} or own
        if any(_member(cls, m) is not _ABSENT for m in telling):
            found += [f"{text} ({ability.__name__})" for text in _breaches(cls, ability, own)]
    return found


def _misspelled(
    cls: type, public: Sequence[str], looked_for: set[str], optional: set[str]
) -> list[str]:
    """Errors for public names that are nearly the name of an optional member, and for plugin
    attributes that are neither an option nor in a protocol."""
    found = []
    untyped = _untyped_values(cls)
    for name in public:
        if name in looked_for:
            continue
        near = [n for n in difflib.get_close_matches(
                    name, sorted(optional), n=1, cutoff=TYPING_ERROR)
                if n == name or _member(cls, n) is _ABSENT]
        if near and near[0] != name:
            found.append(f"{name} is not looked for: did you mean {near[0]}?")
        elif name in untyped and not near:
            found.append(f"{name} is a value without a type: write {name}: type = value to make it "
                         "an option")
    return found


def _untyped_values(cls: type) -> set[str]:
    """Names of attributes of a plugin class without a type annotation."""
    if not issubclass(cls, Plugin):
        return set()
    return {n for c in cls.__mro__ if c not in Plugin.__mro__ for n, v in vars(c).items()
            if isinstance(v, str | bool) and not n.startswith("_")} - _annotated(cls)


def _members(protocols: Sequence[type]) -> set[str]:
    return {m for p in protocols if is_protocol(p) for m in get_protocol_members(p)}


def _own_members(protocol: type) -> set[str]:
    """Members of a protocol that it does not inherit from another protocol."""
    return set(get_protocol_members(protocol)) - _members(protocol.__mro__[1:])


def _unfit_value(has: object, wanted: property, member: str) -> str:
    """Reason why an attribute's value is not allowed by the type of the protocol's property, "" if
    it is."""
    if has is None or inspect.isdatadescriptor(has) or wanted.fget is None:
        return ""  # a field, or computed
    allowed = get_type_hints(wanted.fget).get("return")
    if get_origin(allowed) is Literal and has not in get_args(allowed):
        return f"{member} must be {' or '.join(map(repr, get_args(allowed)))} (got {has!r})"
    if allowed is bool and not isinstance(has, bool):
        return f"{member} must be True or False (got {has!r})"
    return ""


def _public(cls: type) -> list[str]:
    """Public attributes that a class adds to `Plugin`, except options."""
    names = {n for c in cls.__mro__ if c is not object and c not in Plugin.__mro__
             for n in vars(c) if not n.startswith("_")}
    options = set(cls.model_fields) if issubclass(cls, Plugin) else _annotated(cls)
    return sorted(names - options - {"model_config", "sparsemor_api"})


def _annotated(cls: type) -> set[str]:
    """Names of annotated attributes of a class: options, fields and class variables."""
    return {n for c in cls.__mro__ if c not in Plugin.__mro__ for n in inspect.get_annotations(c)}


def _member(cls: type, name: str) -> object:
    """Class attribute without binding; None for a field without a default."""
    absent = None if name in _annotated(cls) else _ABSENT
    if absent is None and issubclass(cls, Plugin) and name in cls.model_fields:
        return None
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
    """Signature of a method without types, such as `sample(block, m, dictionary, rng, required)`;
    the bare name of a property."""
    if not inspect.isfunction(inspect.getattr_static(protocol, member, None)):
        return member
    return member + _written(_parameters(protocol, member))


def _without_types(signature: inspect.Signature, static: bool) -> str:
    return _written(list(signature.parameters.values())[0 if static else 1:])


def _written(parameters: list[inspect.Parameter]) -> str:
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in parameters]
    return f"({', '.join(map(str, bare))})"
