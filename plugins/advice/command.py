"""Command `sparsemor advise`: chooses fields and reducer of a scene by trial runs."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.plugins.command_line.options import (
    Json,
    Quiet,
    ReplaceFile,
    SceneName,
    Settings,
    check_new_file,
    load_with,
    located_in,
    path_of,
    progress,
)
from sparsemor.plugins.publishing.listed_files import list_file

Out = Annotated[Path | None, typer.Option(
    "--out", parser=path_of, metavar="FILE",
    help="File for the chosen scene (default: none is written).")]
Tolerance = Annotated[float | None, typer.Option(
    "--tolerance", help="Largest error of each field, relative to its largest change (default: "
    "that of the scene's reducer `auto`, else 1e-3).")]


def advise(
    scene: SceneName, settings: Settings = None, tolerance: Tolerance = None, out: Out = None,
    force: ReplaceFile = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Choose fields and reducer of a scene by trial runs over its training run, and write the scene
    that repeats the choice."""
    loaded = load_with(scene, settings)
    with located_in(loaded), progress(quiet or as_json) as observers:
        if out is not None:
            check_new_file(out, force)
        from sparsemor.plugins.advice.advice import advise as advised

        advice = advised(loaded, tolerance=tolerance, observers=observers)
        if out is not None:
            advice.save(out)
            list_file(out, alone=True)
    if as_json:
        trials = [{k: str(v) if v == float("inf") else v for k, v in asdict(t).items()}
                  for t in advice.choice.trials]
        print_json({"status": "done", "reducer": advice.choice.reducer,
                    "left_out": list(advice.left_out), "trials": trials,
                    "reasons": list(advice.choice.reasons),
                    "doubts": list(advice.choice.doubts),
                    "seconds": {"full_order": advice.full_seconds, "trials": advice.seconds},
                    "out": None if out is None else str(out)})
    elif not quiet:
        typer.echo(str(advice))
        if out is not None:
            typer.echo(f"scene: {out}")
