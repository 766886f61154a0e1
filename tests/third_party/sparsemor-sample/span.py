"""A command: the range of the unknowns over a run."""

import json
from typing import Annotated

import typer

from sparsemor import load, simulate
from sparsemor.core import InputError


def span(
    scene: Annotated[str, typer.Argument(help="A packaged scene's name, or a scene file.")],
    block: Annotated[str, typer.Option(help="Only this one, such as bar.thermal.")] = "",
) -> None:
    """Print the largest and smallest unknown of each block over a run, as JSON."""
    run = simulate(load(scene))
    values = {b.name: run.block(b.name) for b in run.layout.blocks}
    if block and block not in values:
        raise InputError(f"no block is called {block}: there are {', '.join(values)}")
    typer.echo(json.dumps({name: [v.min(), v.max()] for name, v in values.items()
                           if block in ("", name)}))
