"""Overrides of options of a scene, applied to the parsed file before validation.

The name of a reducer, and an option that the reducer of the scene lacks, mean the same for `--set`,
`compare` and studies.
"""

from collections.abc import Mapping, Sequence
from itertools import repeat
from typing import Any, NamedTuple

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.notes import Note, information
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.registry.validation_errors import shown
from sparsemor.core.scene.default_plugins import SAMPLED
from sparsemor.core.scene.yaml_reader import KeyPath, not_finite, parse_value

REMOVABLE = ("bodies", "joints", "loads", "contacts", "probes", "linear_solvers")
"""Tables of the scene from which `NAME: null` removes an entry."""
REDUCER: KeyPath = ("reducer",)
NAMES = (REDUCER, (*REDUCER, "use"))
"""Keys whose value is the name of a reducer."""


def parse_settings(settings: Sequence[str]) -> dict[str, Any]:
    """Overrides, as a mapping, from settings such as `["time.end=0.5", "reducer={use: full}"]`;
    values are YAML."""
    parsed: dict[str, Any] = {}
    faults: list[Fault] = []
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not (equals and key.strip()):
            faults.append(Fault("", f"--set takes key=value, as time.end=0.5 (got {setting})"))
            continue
        try:
            parsed[key.strip()] = parse_value(text, key.strip())
        except InputError as error:
            faults.extend(error.faults)
    if faults:
        raise InputError(faults)
    return parsed


def split(key: str) -> KeyPath:
    """Parts of a dotted key such as `reducer.budgets."*.elastic".rows`; quotes keep a dot inside
    one part."""
    parts: list[str] = [""]
    quote = ""
    for letter in key:
        if quote:
            quote = "" if letter == quote else quote
            parts[-1] += "" if not quote else letter
        elif letter in "'\"" and not parts[-1]:
            quote = letter
        elif letter == ".":
            parts.append("")
        else:
            parts[-1] += letter
    return tuple(parts)


def inside(key: str, of: str) -> bool:
    """True for the key `of` and those below it."""
    parts = split(of)
    return split(key)[: len(parts)] == parts


def find(tree: object, key: str) -> KeyPath:
    """Path in `tree` of a dotted key. Existing keys that contain dots themselves take
    precedence."""
    return _matched(tree, split(key))


class Applied(NamedTuple):
    """Changed data of a scene, the key of the override for each changed path, whether the reducer
    was changed, and notes."""

    tree: dict[str, Any]
    origins: dict[KeyPath, str]
    new_reducer: bool
    notes: tuple[Note, ...]


def apply(
    tree: Mapping[str, Any], overrides: Mapping[str, Any], registry: Registry
) -> Applied:
    """Changed copy of the tree.

    The order of the overrides does not matter: outer keys are applied first, and `use` before the
    options next to it. A reducer's name keeps shared options.
    """
    changed = copied(tree)
    origins: dict[KeyPath, str] = {}  # changed path -> key of the override
    notes: tuple[Note, ...] = ()
    # True if an override names a reducer, or an option for which another one is taken
    new_reducer = any(split(key) in NAMES for key in overrides)
    faults: list[Fault] = []
    for key in sorted(overrides, key=_outer_first):
        value = overrides[key]
        faults.extend(Fault(key, f"must be finite (got {shown(value)})")
                      for _ in not_finite(value)[:1])
        try:
            path, value = find(changed, key), copied(value)
            if path in NAMES and isinstance(value, str):  # the name of a reducer alone
                notes += _name_notes(changed, value, registry)
                path, value = REDUCER, _with_name(changed, value, registry)
            elif path[:1] == REDUCER and len(path) > 1 and not new_reducer:
                # an option that the reducer may lack: another reducer that has it, and notes
                found = _sampling(changed, str(path[1]), registry)
                if found is not None:
                    changed["reducer"], more = found
                    notes, new_reducer = (*notes, *more), True
            origins[_set(changed, path, value)] = key
        except InputError as error:
            faults.extend(error.under(key).faults)
    if faults:
        raise InputError(faults)
    return Applied(changed, origins, new_reducer, notes)


def copied(value: Any) -> Any:
    """Deep copy of containers; other objects in them, such as plugin instances, are shared."""
    root = [value]
    waiting: list[tuple[Any, Any]] = [(root, 0)]
    while waiting:
        holder, key = waiting.pop()
        part: Any = holder[key]
        if isinstance(part, Mapping):
            holder[key] = part = dict(part)
            waiting += zip(repeat(part), part)
        elif isinstance(part, list | tuple):
            holder[key] = part = list(part)
            waiting += zip(repeat(part), range(len(part)))
    return root[0]


def _outer_first(key: str) -> tuple[int, bool]:
    path = split(key)
    return len(path), path[-1] != "use"


def _set(tree: dict[str, Any], path: KeyPath, value: Any) -> KeyPath:
    """Sets a value in a tree of options, creates mappings on the way, and returns the path with
    numbers of lists. Another plugin (`use`) drops the options of the former one; None removes an
    entry."""
    if any(part == "" for part in path):
        raise InputError("a key is made of names with single dots between them")
    node: Any = tree
    for depth, part in enumerate(path[:-1]):
        inner = _child(node, part)
        if isinstance(inner, str):  # `sampler: lhs` is short for `sampler: {use: lhs}`
            inner = {"use": inner}
        elif inner is None:
            inner = {}
        elif not isinstance(inner, dict | list):
            raise InputError(f"{'.'.join(map(str, path[:depth + 1]))} has no options to set "
                             f"(it is {shown(inner)})")
        node[part] = inner
        node = inner
    last = path[-1]
    _child(node, last)  # raises InputError beyond the end of a list
    if last == "use" and isinstance(node, dict) and node.get("use") != value:
        node.clear()  # the options were those of another plugin
    if value is None and len(path) == 2 and path[0] in REMOVABLE:
        if str(last) not in node:
            raise InputError("there is nothing of this name to remove: "
                             + suggestions(str(last), list(node), path[0]))
        del node[str(last)]
        return path
    node[last] = value
    return path


def _child(node: Any, part: str | int) -> Any:
    if isinstance(node, dict):
        return node.get(str(part))
    if isinstance(part, int) and part < len(node):
        return node[part]
    raise InputError(f"the list has items 0 to {len(node) - 1} (got {part})")


def _matched(tree: object, parts: KeyPath) -> KeyPath:
    """Path of a dotted key in a tree: a name with dots in it is one part where the tree has it."""
    if not parts:
        return ()
    if isinstance(tree, Mapping):
        for count in range(len(parts), 0, -1):
            key = ".".join(map(str, parts[:count]))
            if key in tree:
                return (key, *_matched(tree[key], parts[count:]))
    if isinstance(tree, list) and str(parts[0]).isdecimal():
        index = int(parts[0])
        rest = tree[index] if index < len(tree) else None
        return (index, *_matched(rest, parts[1:]))
    return parts


# ------------------------------------------------------------------ the reducer of a scene


def _with_name(tree: Mapping[str, Any], name: str, registry: Registry) -> object:
    """Reducer of a scene's data after a change of its name alone.

    The same name keeps all options. Another reducer takes over the options that both declare as
    shared (such as `basis`, `bases` and `budgets`), and those of the same name, type and default;
    an option with another default has another meaning.
    """
    old = tree.get("reducer")
    options = old if isinstance(old, Mapping) else {}
    old_class, new_class = _reducer_class(old, registry), _reducer_class(name, registry)
    if old_class is None or new_class is None:
        return name
    if old_class is new_class:
        return old
    new_fields, old_fields, shared = new_class.model_fields, old_class.model_fields, (
        {*old_class.shared_options} & {*new_class.shared_options})
    both = old_fields.keys() & new_fields.keys()
    taken_over = {key: value for key, value in options.items() if key in both and (
        key in shared or (new_fields[key].annotation == old_fields[key].annotation
                          and new_fields[key].default == old_fields[key].default))}
    return {"use": name, **taken_over} if taken_over else name


def _name_notes(tree: Mapping[str, Any], name: object, registry: Registry) -> tuple[Note, ...]:
    """Note on a change of the reducer's name to the one that the scene has."""
    mine = _reducer_class(tree.get("reducer"), registry)
    if not isinstance(name, str) or mine is None or mine is not _reducer_class(name, registry):
        return ()
    return (information(
        f"reducer: {name} changes nothing: the reducer of the scene is {name}, whose options stay; "
        f"reducer: {{use: {name}}} is {name} with its defaults", "no_effect"),)


def _sampling(
    tree: Mapping[str, Any], option: str, registry: Registry
) -> tuple[object, tuple[Note, ...]] | None:
    """Reducer of a scene's data after a change of an option that its own reducer lacks and the
    reducer `SAMPLED` has, with a note; None where the reducer stays.

    Only a reducer that shares options with `SAMPLED` is replaced: not the full-order one.
    """
    mine, other = _reducer_class(tree.get("reducer"), registry), _reducer_class(SAMPLED, registry)
    if mine is None or other is None or option in mine.model_fields or (
            option not in other.model_fields) or not (
            {*mine.shared_options} & {*other.shared_options}):
        return None
    old = registry.name_of("reducer", mine)
    return _with_name(tree, SAMPLED, registry), (Note(
        f"reducer.{option}: {old}, the reducer of the scene, has no {option}: the run takes "
        f"{SAMPLED}, which has one, with the options that both share", "reducer_changed"),)


def _reducer_class(reducer: object, registry: Registry) -> Any:
    """Plugin class of a reducer as written in a scene: a name, {use: name} or an instance; None
    where there is none."""
    name = reducer.get("use") if isinstance(reducer, Mapping) else reducer
    if name is not None and not isinstance(name, str):
        return type(name)
    try:
        return None if name is None else registry.get("reducer", name)
    except InputError:  # which the validation reports
        return None
