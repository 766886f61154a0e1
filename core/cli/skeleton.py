"""`sparsemor new-plugin`: a complete third-party package, ready to install and test."""

import re
from pathlib import Path
from string import Template
from typing import Annotated

import typer

from sparsemor.core.cli.common import exit_codes
from sparsemor.core.cli.templates import KINDS, LAW_TEST, PYPROJECT, README
from sparsemor.core.errors import InputError
from sparsemor.core.registry import Registry, near


def new_plugin(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The plugin's name, as in my_rows.")],
    kind: Annotated[str, typer.Option(help=f"One of: {', '.join(sorted(KINDS))}.")],
    out: Annotated[Path | None, typer.Option(
        "--out", help="Directory to make; sparsemor-NAME when not given.")] = None,
) -> None:
    """Write a third-party package with one plugin and its law test."""
    with exit_codes():
        directory = out or Path(f"sparsemor-{name.replace('_', '-')}")
        files = package_files(name, kind)
        taken = [p.origin for p in Registry().names(kind) if p.name == name]
        if taken:
            raise InputError(f"NAME: {' and '.join(taken)} offers a {kind} called {name!r} already,"
                             " which a scene would go on to mean: choose another name")
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise InputError(f"--out {directory}: there is something already: name another one")
        for path, text in files.items():
            (directory / path).parent.mkdir(parents=True, exist_ok=True)
            (directory / path).write_text(text, encoding="utf-8")
    typer.echo(f"wrote {directory}: install it with `pip install -e {directory}`, then run its "
               "law test with `pytest`")


def package_files(name: str, kind: str) -> dict[str, str]:
    """Relative path -> text. Raises `InputError` for a bad name or an unknown kind."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError("NAME: lower-case letters, digits and _, beginning with a letter "
                         f"(given: {name})")
    if kind not in KINDS:
        raise InputError(f"--kind {kind}: there is no template: {near(kind, sorted(KINDS))}")
    values = {
        "name": name, "kind": kind, "module": f"sparsemor_{name}",
        "distribution": f"sparsemor-{name.replace('_', '-')}",
        "cls": "".join(part.capitalize() for part in name.split("_")),
    }
    texts = {
        "pyproject.toml": PYPROJECT, "README.md": README,
        f"{values['module']}.py": KINDS[kind], f"test_{name}.py": LAW_TEST,
    }
    return {path: Template(text).substitute(values) for path, text in texts.items()}
