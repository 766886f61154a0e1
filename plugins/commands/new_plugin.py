"""Command `sparsemor new-plugin`: writes a third-party package, ready to install and test."""

import re
from collections.abc import Mapping
from keyword import iskeyword
from pathlib import Path
from string import Template
from typing import Annotated

import typer

from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.plugins.command_line.options import located_in, path_of
from sparsemor.plugins.commands.validate_schema_plugins import NO_CLASS

TEMPLATES = Path(__file__).with_name("plugin_templates")
"""Folder of the package templates: one text per plugin kind; a line `==> NAME` begins the file
NAME."""
COMMON = "common"
KINDS = tuple(sorted(p.stem for p in TEMPLATES.glob("*.txt") if p.stem != COMMON))
USES = {"scene": "`sparsemor run $name` runs it", "study": "`sparsemor study $name` conducts it",
        "charts": "`sparsemor compare` draws them",
        "error_norm": "`sparsemor compare` and studies measure it",
        "choice": "it is applied to each scene before a run",
        "command": "`sparsemor $name double_pendulum` calls it",
        "paper": "`sparsemor reproduce --paper $name` recomputes it",
        "observer": "a script passes `$cls().observer()` to `simulate`",
        "check": "each run is checked by it"}
"""Plugin kind -> how plugins of that kind are used; scene files select those of all other kinds."""


def new_plugin(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The plugin's name, as in my_rows.")],
    kind: Annotated[str, typer.Option(help=f"One of: {', '.join(KINDS)}.")],
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="DIRECTORY",
        help="Directory to create (default: sparsemor-NAME).")] = None,
) -> None:
    """Write a third-party package with one plugin and its law test."""
    directory = out or Path(f"sparsemor-{name.replace('_', '-')}")
    files = package_files(name, kind)
    taken = [p.origin for p in Registry().names(kind) if p.name == name]
    if taken:
        offer = "offers" if len(taken) == 1 else "offer"
        raise InputError(f"NAME: {' and '.join(taken)} {offer} a {kind} called {name!r} "
                         "already: choose another name")
    with located_in():
        OutputDirectory(directory).require_empty("choose another --out")
        OutputDirectory(directory).make()
    for path, text in files.items():
        (directory / path).parent.mkdir(parents=True, exist_ok=True)
        (directory / path).write_text(text, encoding="utf-8")
    typer.echo(f"wrote {directory}: install it with `pip install -e {directory}`, then run its "
               "law test with `pytest`")


def package_files(name: str, kind: str) -> dict[str, str]:
    """Files of a package with one plugin: relative path -> text. Raises `InputError` for a bad name
    or an unknown plugin kind."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or iskeyword(name):
        raise InputError("NAME: lower-case letters, digits and _, beginning with a letter, and no "
                         f"keyword of Python (got {name})")
    if kind not in KINDS:
        raise InputError(f"--kind {kind}: there is no template: {suggestions(kind, KINDS)}")
    values = {
        "name": name, "kind": kind, "module": f"sparsemor_{name}",
        "distribution": f"sparsemor-{name.replace('_', '-')}",
        "cls": "".join(part.capitalize() for part in name.split("_")),
    }
    values["target"] = name if kind in NO_CLASS else values["cls"]
    values["use"] = Template(USES.get(kind, "a scene can contain `use: $name`")).substitute(values)
    files = _files(kind, values)
    packaged = [f for f in files if f == f"{values['module']}.py" or f.startswith(f"{name}.")]
    values["files"] = ", ".join(f'"{f}"' for f in packaged)
    return {**_files(COMMON, values), **files}


def _files(template: str, values: Mapping[str, str]) -> dict[str, str]:
    """Files of one template: relative path -> text."""
    text = (TEMPLATES / f"{template}.txt").read_text(encoding="utf-8")
    parts = re.split(r"^==> (.*)\n", Template(text).substitute(values), flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))
