"""Command `sparsemor solve`: analyses of a scene that are no run in time."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.notes import Level, sentences
from sparsemor.core.results.model_file import is_model_file
from sparsemor.plugins.command_line.completion import scene_names
from sparsemor.plugins.command_line.options import (
    Force,
    Json,
    Quiet,
    Settings,
    finite_number,
    inform,
    items,
    load_with,
    located_in,
    out_option,
    place_for_result,
    progress,
    warn,
    words,
)

if TYPE_CHECKING:
    from sparsemor.plugins.analyses.stored_solution import Solution

MOST = 100000
"""Largest number of frequencies."""


def analyses(incomplete: str) -> list[str]:
    """Analyses, for completion."""
    from sparsemor.plugins.analyses.solve import ANALYSES

    return [name for name in ANALYSES if name.startswith(incomplete)]


def solve(
    scene: Annotated[str, typer.Argument(
        metavar="SCENE|MODEL", help="A packaged scene's name, a scene file, or for "
        "frequency_response the file of a linear model.", autocompletion=scene_names)],
    analysis: Annotated[str, typer.Argument(
        metavar="ANALYSIS", help="static, steady_heat, frequencies, buckling or "
        "frequency_response.", autocompletion=analyses)],
    settings: Settings = None,
    out: Annotated[Path | None, out_option("runs/SCENE-ANALYSIS")] = None,
    at: Annotated[float | None, typer.Option(
        "--at", help="Time of the loads and drives, s (default: the end of the scene).")] = None,
    spin: Annotated[bool, typer.Option(
        "--spin", help="Keep the rates of drives and of the start: steady rotation.")] = False,
    about: Annotated[str | None, typer.Option(
        "--about", help="State of vibrations: equilibrium (the default) or start.")] = None,
    count: Annotated[int | None, typer.Option(
        "--count", min=1, help="Number of modes (default: 10; of buckling 3).")] = None,
    scaled: Annotated[str | None, typer.Option(
        "--scaled", help="Loads that the buckling factor multiplies (default: all).")] = None,
    source: Annotated[str | None, typer.Option(
        "--input", help="Key of the function of time that is harmonic: loads.push.factor.")] = None,
    frequencies: Annotated[str | None, typer.Option(
        "--frequencies", help="Frequencies of a response in Hz: first,last,number, such as "
        "1,1000,300; evenly spaced by their logarithm from above 0.")] = None,
    outputs: Annotated[str | None, typer.Option(
        "--outputs", help="What responds, such as tip.u_y (default: all that a run records).")
    ] = None,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Solve for equilibrium, steady temperatures, vibrations, buckling or response of a scene."""
    with located_in():
        options: dict[str, Any] = {name: value for name, value in {
            "at": at, "spin": spin or None, "about": about, "count": count, "input": source,
            "frequencies": _spaced(frequencies), "outputs": words(outputs),
            "scaled": words(scaled)}.items()
            if value is not None}
    if is_model_file(Path(scene)):
        with located_in():
            found = _kept(scene, analysis, settings, out, force, options)
        directory = out or Path("runs", f"{Path(scene).stem}-{analysis}")
        _report(found, directory, as_json, quiet)
        return
    loaded = load_with(scene, settings)
    directory = out or Path("runs", f"{loaded.name}-{analysis}")
    with (place_for_result(directory, None, force), located_in(loaded),
          progress(quiet or as_json) as observers):
        from sparsemor.plugins.analyses.solve import solve as solved

        found = solved(loaded, analysis, out=directory, observers=observers, **options)
    _report(found, directory, as_json, quiet)


def _kept(
    file: str, analysis: str, settings: list[str] | None, out: Path | None, force: bool,
    options: dict[str, Any],
) -> "Solution":
    """Solution of an analysis of a kept model from its file."""
    from sparsemor.plugins.analyses.solve import solve_kept
    from sparsemor.plugins.kept_models.reduced_model import load_model

    if settings:
        raise InputError("a kept model is solved as it is", "set")
    allowed = ("input", "frequencies", "outputs")
    if wrong := [name for name in options if name not in allowed]:
        raise InputError("a kept model has no such option", wrong[0])
    directory = out or Path("runs", f"{Path(file).stem}-{analysis}")
    with place_for_result(directory, None, force):
        return solve_kept(load_model(file), analysis, out=directory, **options)


def _spaced(text: str | None) -> list[float] | None:
    """Frequencies, Hz, from the text of the option."""
    found = items("frequencies", text, finite_number, "must be first,last,number in Hz")
    if found is None:
        return None
    first, last, count = found if len(found) == 3 else (0.0, 0.0, 0.0)
    if not (0.0 <= first < last and count >= 2 and count == int(count) and count <= MOST):
        raise InputError("must be first,last,number: increasing, at least 2 of them "
                         f"(got {text})", "frequencies")
    spaced = np.geomspace if first > 0.0 else np.linspace
    return [float(f) for f in spaced(first, last, int(count))]


def _report(found: "Solution", directory: Path, as_json: bool, quiet: bool) -> None:
    """Prints a solution as JSON or as a table, then its notes."""
    if as_json:
        print_json({**found.summary, "out": directory})
    elif not quiet:
        typer.echo(str(found))
        typer.echo(f"result: {directory}")
    if not quiet:
        warn(sentences(found.notes, Level.WARNING))
        if not as_json:
            inform(sentences(found.notes, Level.INFORMATION))
