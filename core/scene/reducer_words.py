"""Meaning of a reducer's name, and of an option that a reducer lacks, among overrides of a scene.

One rule for `--set`, `compare` and studies.
"""

from collections.abc import Mapping
from typing import Any

from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note, information
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.defaults import SAMPLED
from sparsemor.core.scene.yaml_reader import KeyPath

REDUCER: KeyPath = ("reducer",)
NAMES = (REDUCER, (*REDUCER, "use"))
"""Keys whose value is the name of a reducer."""


def named(tree: Mapping[str, Any], name: str, registry: Registry) -> object:
    """Reducer of a scene's data after a change of its name alone.

    The same name keeps all options. Another reducer takes over the options that both declare as
    shared (such as `basis`, `bases` and `budgets`), and those of the same name, type and default;
    an option with another default has another meaning.
    """
    old = tree.get("reducer")
    options = old if isinstance(old, Mapping) else {}
    mine, theirs = _class(old, registry), _class(name, registry)
    if mine is None or theirs is None:
        return name
    if mine is theirs:
        return old
    fields, own, shared = theirs.model_fields, mine.model_fields, (
        {*mine.shared_options} & {*theirs.shared_options})
    kept = {key: value for key, value in options.items() if key in fields and key in own and (
        key in shared or (fields[key].annotation == own[key].annotation
                          and fields[key].default == own[key].default))}
    return {"use": name, **kept} if kept else name


def name_notes(tree: Mapping[str, Any], name: object, registry: Registry) -> tuple[Note, ...]:
    """Note on a change of the reducer's name to the one that the scene has."""
    old = tree.get("reducer")
    if not isinstance(name, str) or _class(old, registry) is not _class(name, registry) is not None:
        return ()
    return (information(
        f"reducer: {name} changes nothing: the reducer of the scene is {name}, whose options stay; "
        f"reducer: {{use: {name}}} is {name} with its defaults", "no_effect"),)


def sampled(
    tree: Mapping[str, Any], option: str, registry: Registry
) -> tuple[object, tuple[Note, ...]] | None:
    """Reducer of a scene's data after a change of an option that its own reducer lacks and the
    reducer `SAMPLED` has, with a note; None where the reducer stays.

    Only a reducer that shares options with `SAMPLED` is replaced: not the full-order one.
    """
    mine, other = _class(tree.get("reducer"), registry), _class(SAMPLED, registry)
    if mine is None or other is None or option in mine.model_fields or (
            option not in other.model_fields) or not (
            {*mine.shared_options} & {*other.shared_options}):
        return None
    old = registry.name_of("reducer", mine)
    return named(tree, SAMPLED, registry), (Note(
        f"reducer.{option}: {old}, the reducer of the scene, has no {option}: the run takes "
        f"{SAMPLED}, which has one, with the options that both share", "reducer_changed"),)


def _class(reducer: object, registry: Registry) -> Any:
    """Plugin class of a reducer as written in a scene: a name, {use: name} or an instance; None
    where there is none."""
    name = reducer.get("use") if isinstance(reducer, Mapping) else reducer
    if name is not None and not isinstance(name, str):
        return type(name)
    try:
        return None if name is None else registry.get("reducer", name)
    except InputError:  # which the validation reports
        return None
