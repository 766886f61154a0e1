"""Command `sparsemor solve`: analyses of a scene that are no run in time."""

from pathlib import Path
from typing import Annotated, Any

import typer

from sparsemor.core.cli.options import (
    Force,
    Json,
    Quiet,
    SceneName,
    Settings,
    inform,
    load_with,
    located_in,
    out_option,
    place_for_result,
    print_json,
    progress,
    warn,
)
from sparsemor.core.notes import Level, sentences


def solve(
    scene: SceneName,
    analysis: Annotated[str, typer.Argument(
        metavar="ANALYSIS", help="static, steady_heat or frequencies.")],
    settings: Settings = None,
    out: Annotated[Path | None, out_option("runs/SCENE-ANALYSIS")] = None,
    at: Annotated[float | None, typer.Option(
        "--at", help="Time of the loads and drives, s (default: the end of the scene).")] = None,
    spin: Annotated[bool, typer.Option(
        "--spin", help="Keep the rates of drives and of the start: steady rotation.")] = False,
    about: Annotated[str | None, typer.Option(
        "--about", help="State of frequencies: equilibrium (the default) or start.")] = None,
    count: Annotated[int | None, typer.Option(
        "--count", min=1, help="Number of modes (default: 10).")] = None,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Solve for equilibrium, steady temperatures or vibration modes of a scene."""
    loaded = load_with(scene, settings)
    given: dict[str, Any] = {"at": at, "spin": spin or None, "about": about, "count": count}
    options = {name: value for name, value in given.items() if value is not None}
    directory = out or Path("runs", f"{loaded.name}-{analysis}")
    with (place_for_result(directory, False, force), located_in(loaded),
          progress(quiet or as_json) as observers):
        from sparsemor.plugins.analyses.solve import solve as solved

        found = solved(loaded, analysis, out=directory, observers=observers, **options)
    if as_json:
        print_json({**found.summary, "out": directory})
    elif not quiet:
        typer.echo(str(found))
        typer.echo(f"result: {directory}")
    if not quiet:
        warn(sentences(found.notes, Level.WARNING))
        if not as_json:
            inform(sentences(found.notes, Level.INFORMATION))
