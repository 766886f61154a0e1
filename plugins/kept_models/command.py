"""Command `sparsemor reduce`: prepares the reduced model of a scene and writes it to a file."""

import time
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
    "--out", parser=path_of, metavar="FILE", help="File (default: SCENE-REDUCER.model).")]
Fields = Annotated[bool, typer.Option(
    "--fields", help="Keep meshes and bases too, for pictures and export of the model's results.")]


def reduce(
    scene: SceneName, settings: Settings = None, out: Out = None, fields: Fields = False,
    force: ReplaceFile = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Prepare the reduced model of a scene and write it to a file, which `sparsemor run` runs
    without mesh and training. With the extra `fast`, steps are compiled for its further runs, once
    for all models of a kind; `--set reducer.compiled=off` leaves that out."""
    loaded = load_with(scene, settings)
    file = out or Path(f"{loaded.name}-{loaded.reducer_name}.model")
    with located_in(loaded), progress(quiet or as_json) as observers:
        check_new_file(file, force)
        from sparsemor.plugins.kept_models.reduced_model import load_model
        from sparsemor.plugins.kept_models.reduced_model import reduce as prepare

        begun = time.perf_counter()
        # what a file holds is without the mesh, which estimates need
        model = prepare(loaded, observers=observers, estimate=False)
        model.save(file, fields=fields)
        list_file(file, alone=True)
        seconds = time.perf_counter() - begun
        compiled = load_model(file).compile_steps()  # for all further runs of the file
    said = {"status": "done", "scene": loaded.name, "reducer": loaded.reducer_name,
            "unknowns": model.size, "seconds": seconds, "compiled_s": compiled,
            "bytes": file.stat().st_size, "may_change": list(model.free), "out": str(file)}
    if as_json:
        print_json(said)
    elif not quiet:
        typer.echo(f"{model.size} unknowns, {file.stat().st_size / 1e6:.2g} MB, prepared in "
                   f"{seconds:.3g} s{f', machine code in {compiled:.3g} s' * bool(compiled)}"
                   f"\na run may change {', '.join(model.free)}")
        typer.echo(f"model: {file}")
