"""Command `sparsemor export`: ParaView files of a stored run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sparsemor.core.cli.options import (
    At,
    Force,
    Json,
    Quiet,
    StoredRun,
    located_in,
    part_of,
    path_of,
    print_json,
    times_at,
    warn,
    words,
)

if TYPE_CHECKING:
    from sparsemor.core.results.run_result import RunResult


def export(
    run: StoredRun,
    form: Annotated[str, typer.Option("--format", help="vtu or xdmf.")] = "vtu",
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="DIRECTORY",
        help="Directory for the files (default: inside the run's directory).")] = None,
    at: At = None,
    every: Annotated[int, typer.Option(
        "--every", help="Export every N-th stored step (not with --at).")] = 1,
    fields: Annotated[str | None, typer.Option(
        "--fields", help="Some of displacement,temperature,stress,strain (default: the first "
        "two).")] = None,
    bodies: Annotated[str | None, typer.Option(
        "--body", help="Bodies, such as disk,pad (default: all that have a mesh).")] = None,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Write the moving bodies of a stored run with their fields, for ParaView."""
    with located_in():
        from sparsemor.core.results.run_result import open_result
        from sparsemor.plugins.export import export as write

        result = open_result(run)
        folder = out or result.path.parent / form
        with part_of(result.path.parent, folder):
            done = write(
                result, folder, form, bodies=words(bodies), fields=words(fields),
                at=times_at(at), every=every, force=force)
        if as_json:
            print_json({
                "status": "done", "out": done.folder, "format": form, "times": len(done.times),
                "files": {b: str(f) for b, f in done.files.items()}, "fields": done.fields,
                "notes": done.notes})
        elif not quiet:
            for body, file in done.files.items():
                typer.echo(_line(result, body, file, done.fields[body], len(done.times)))
        if not quiet and not as_json:
            warn(done.notes)


def _line(run: "RunResult", body: str, file: Path, fields: tuple[str, ...], times: int) -> str:
    from sparsemor.plugins.export.snapshot import exported_mesh

    what = ", ".join(fields) or "no field"
    points = len(exported_mesh(run, body, fields)[0])
    return f"{file}: {points} points, {times} times, {what}"
