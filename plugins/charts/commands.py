"""Commands `sparsemor pictures` and `animate`: charts and an animation of a stored run."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.results.files.written_files import require_ours
from sparsemor.core.results.output_lock import owned
from sparsemor.plugins.command_line.options import (
    At,
    Json,
    Quiet,
    StoredRun,
    items,
    located_in,
    part_of,
    path_of,
    times_at,
)

if TYPE_CHECKING:
    from sparsemor.core.results.result_variables import Field


def pictures(
    run: StoredRun, at: At = None,
    fields: Annotated[str | None, typer.Option(
        "--fields", help="Colour the bodies by some of displacement,temperature,stress,strain "
        "(default: the first two).")] = None,
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="DIRECTORY",
        help="Directory for the files (default: `pictures` in the run's).")] = None,
    as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Draw a stored run: motion, fields at some times, probes, active atoms. PNG and SVG."""
    with located_in():
        from sparsemor.core.results.result_variables import FIELDS
        from sparsemor.core.results.run_result import open_result
        from sparsemor.plugins.charts import (
            DEFAULT_FIELDS,
            usual_files,
            write_run_charts,
        )

        result = open_result(run)
        times = times_at(at)
        try:
            result.steps_at(times)
        except InputError as error:
            raise error.under("at") if times else error from None
        chosen = DEFAULT_FIELDS if fields is None else items(
            "fields", fields, _field, f"give some of {', '.join(FIELDS)}") or DEFAULT_FIELDS
        folder = out or result.path.parent / "pictures"
        with owned(folder), part_of(result.path.parent, folder):
            require_ours(folder, usual_files())
            files = write_run_charts(
                result, folder, times, fields=chosen,
                report=None if as_json or quiet else lambda file: typer.echo(str(file)))
        if as_json:
            print_json({"status": "done", "out": folder, "files": [str(f) for f in files]})


def animate(
    run: StoredRun,
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="FILE",
        help="File to write, .gif or .mp4 (default: animation.gif in the run's directory)."
    )] = None,
    field: Annotated[str, typer.Option(
        "--field", help="displacement, temperature, stress or strain.")] = "displacement",
    frames: Annotated[int, typer.Option("--frames", help="Number of frames, 25 a second.")] = 100,
    at: Annotated[str | None, typer.Option(
        "--at", help="First and last time in s, such as 0.1,0.3 (default: the whole run).")] = None,
    magnify: Annotated[float | None, typer.Option(
        "--magnify", help="Factor of the displacements (default: one that makes them visible)."
    )] = None,
    as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Write an animation of a stored run: the moving bodies, coloured by a field."""
    with located_in():
        from sparsemor.core.results.run_result import open_result
        from sparsemor.plugins.charts.animation import animate as write

        result = open_result(run)
        shown = sys.stderr.isatty() and not quiet and not as_json

        def report(frame: int, count: int) -> None:
            typer.echo(f"\rframe {frame} of {count}", err=True, nl=frame == count)

        file = write(result, out or result.path.parent / "animation.gif", field, frames=frames,
                     at=times_at(at), magnify=magnify, report=report if shown else None)
        if as_json:
            print_json({"status": "done", "file": str(file)})
        elif not quiet:
            typer.echo(str(file))


def _field(name: str) -> "Field":
    from sparsemor.core.results.result_variables import FIELDS

    if name not in FIELDS:
        raise ValueError(name)
    return FIELDS[name]
