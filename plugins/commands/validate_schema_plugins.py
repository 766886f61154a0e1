"""Commands `sparsemor validate`, `schema` and `plugins`: check a scene, print the JSON schema of
scene files, list the installed plugins."""

import json
import re
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel

from sparsemor.core.cli.commands import GROUP, function_of
from sparsemor.core.cli.exit_codes import exit_codes, print_json
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.contracts import CONTRACTS, chosen, required, shape
from sparsemor.core.registry.registry import PluginName, Registry, suggestions
from sparsemor.core.scene.source import Source
from sparsemor.plugins.command_line.completion import plugin_names
from sparsemor.plugins.command_line.options import (
    Json,
    SceneName,
    Settings,
    load_with,
    located_in,
    warn,
)
from sparsemor.plugins.commands.option_types import type_in_words

NO_CLASS = ("charts", "choice", "command", "error_norm", "paper", "scene", "study")
"""Plugin kinds whose entry points refer to objects, functions and files."""


def validate(scene: SceneName, settings: Settings = None, as_json: Json = False) -> None:
    """Check a scene file and build its parts, without running it: nodes, unknowns, masses, first
    frequencies and sets of its bodies."""
    loaded = load_with(scene, settings)
    with located_in(loaded):
        from sparsemor.core.notes import Level, sentences
        from sparsemor.core.simulation.checks import Checks
        from sparsemor.core.simulation.validation import checked_model
        from sparsemor.plugins.command_line.folded_notes import folded
        from sparsemor.plugins.commands.body_summary import body_facts, in_words

        model = checked_model(loaded)
        found = sentences(Checks.for_scene(loaded).of_model(loaded, model), Level.WARNING)
        bodies = body_facts(model, loaded.bodies)
    if as_json:
        print_json({"status": "done", "scene": loaded.dump(), "notes": found,
                    "bodies": {name: facts.plain() for name, facts in bodies.items()}})
    else:
        warn(folded({"": found}, loaded.bodies))
        typer.echo(f"{loaded.name}: valid ({', '.join(loaded.bodies)})")
        typer.echo(in_words(bodies))


def schema() -> None:
    """Print the JSON schema of scene files, with the plugins installed here."""
    from sparsemor.plugins.commands.json_schema import scene_schema

    with exit_codes(as_json=True):
        print_json(scene_schema())


def plugins(
    which: Annotated[
        str | None, typer.Argument(metavar="[KIND or NAME]", help="Describe only these.",
                                   autocompletion=plugin_names)] = None,
    as_json: Json = False,
) -> None:
    """List the installed plugins; describe those of a kind, or the options of one."""
    if which is None and not as_json:
        _print_names(Registry())
        return
    shown = [_described(Registry(), p) for p in _chosen(Registry(), which)]
    with_options = which is not None and which not in Registry().kinds()
    if as_json:
        print_json({"plugins": shown})
    elif with_options:
        for plugin in shown:
            _print_options(plugin)
    else:
        _print_table(shown)


def _chosen(registry: Registry, which: str | None) -> list[PluginName]:
    """Plugins of a kind, or of a name in any kind; all of them for None. Raises InputError with
    similar names where there is none."""
    kinds = registry.kinds()
    every = [p for kind in kinds for p in registry.names(kind)]
    chosen = [p for p in every if which is None or which in (p.kind, p.name, p.qualified)]
    if which is not None and not chosen:
        alike = [kind for kind in kinds if which in kind.split("_")]
        if alike:
            raise InputError(f"no plugin and no kind is called {which!r}: did you mean the kind "
                             f"{' or '.join(alike)}?")
        names = sorted({p.name for p in every} | set(kinds))
        raise InputError(f"no plugin and no kind is called {which!r}: {suggestions(which, names)}")
    return chosen


def _described(registry: Registry, plugin: PluginName) -> dict[str, Any]:
    """Entry of the list of plugins as plain data; `broken` is the reason why one cannot be used."""
    found: dict[str, Any] = {
        "kind": plugin.kind, "name": plugin.name, "use": registry.spelling(plugin),
        "distribution": plugin.distribution, "version": plugin.version, "doc": "",
        "broken": "", "options": [], "required": [], "own": [],
    }
    try:
        if plugin.kind == GROUP:
            return {**found, "doc": first_sentence(
                getdoc(function_of(registry, found["use"])) or "")}
        loaded = registry.load(plugin.kind, found["use"])
        if isinstance(loaded, Path):
            return {**found, "doc": _title(registry, plugin)}
        if plugin.kind in NO_CLASS:
            return {**found, "doc": first_sentence(getdoc(loaded) or "")}
        cls = registry.get(plugin.kind, found["use"])
    except InputError as error:
        cause = error.__cause__
        return {**found, "broken": f"{type(cause).__name__}: {cause}" if cause else str(error)}
    return {**found, "doc": first_sentence(cls.__doc__ or ""), "options": _options(cls),
            "required": list(required(CONTRACTS.get(plugin.kind, Plugin)).values()),
            "own": [{"name": shape(n, m), "doc": first_sentence(getdoc(m) or "")}
                    for n, m in chosen(plugin.kind, cls).items()]}


def _title(registry: Registry, plugin: PluginName) -> str:
    """Title of a packaged data file, such as a scene."""
    return str(Source.read(registry.spelling(plugin), registry, plugin.kind).tree.get("title", ""))


def _options(cls: type[BaseModel]) -> list[dict[str, Any]]:
    properties = cls.model_json_schema()["properties"] if cls.model_fields else {}
    return [
        {
            "name": name, "type": type_in_words(properties.get(name, {})),
            "required": field.is_required(), "default": properties.get(name, {}).get("default"),
            "doc": properties.get(name, {}).get("description", ""),
        }
        for name, field in cls.model_fields.items()
    ]


def first_sentence(text: str) -> str:
    """First sentence of a docstring, which may span lines."""
    paragraph = " ".join(text.strip().partition("\n\n")[0].split())
    return re.split(r"(?<=[.!?])\s+(?=[A-Z`(])", paragraph, maxsplit=1)[0]


def _print_names(registry: Registry) -> None:
    """A line or two for each kind. Imports none of the plugins."""
    from rich.table import Table

    table = Table.grid(padding=(0, 2, 0, 0))
    for kind in registry.kinds():
        table.add_row(kind, ", ".join(map(registry.spelling, registry.names(kind))))
    _console().print(table)
    typer.echo("\n`sparsemor plugins KIND` describes a kind, `sparsemor plugins NAME` one of them.")


def _print_table(shown: list[dict[str, Any]]) -> None:
    from rich.table import Table

    table = Table("kind", "name", "distribution", _folded("description"))
    for p in shown:
        doc = p["broken"] and f"BROKEN: {p['broken']}"
        table.add_row(p["kind"], p["use"], f"{p['distribution']} {p['version']}",
                      _plain(doc or p["doc"]))
    _console().print(table)


def _print_options(plugin: dict[str, Any]) -> None:
    """Prints a plugin with the table of its options and the members that all plugins of its kind
    have."""
    from rich.table import Table

    origin = f"{plugin['distribution']} {plugin['version']}"
    _console().print(_plain(f"{plugin['kind']} {plugin['use']} ({origin}): "
                            f"{plugin['broken'] or plugin['doc']}"))
    if plugin["options"]:
        table = Table("option", _folded("type"), _folded("default"), _folded("meaning"))
        for o in plugin["options"]:
            default = "(required)" if o["required"] else json.dumps(o["default"])
            table.add_row(o["name"], _plain(o["type"]), _plain(default), _plain(o["doc"]))
        _console().print(table)
    if plugin["required"]:
        _console().print(_plain(f"Every {plugin['kind']} has: {', '.join(plugin['required'])}"))
    for own in plugin["own"]:
        _console().print(_plain(f"{own['name']}: {own['doc']}"))


def _folded(heading: str) -> Any:
    """Table column that wraps long words instead of cutting them."""
    from rich.table import Column

    return Column(heading, overflow="fold")


def _console() -> Any:
    from rich.console import Console

    return Console(highlight=False)


def _plain(text: str) -> Any:
    from rich.text import Text

    return Text(text)  # square brackets in types are no markup
