"""Commands `sparsemor export`, `pictures` and `animate`: ParaView files, charts and an animation of
a stored run."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sparsemor.core.cli.options import (
    Force,
    Json,
    Quiet,
    exit_codes,
    items,
    located_in,
    path_of,
    print_json,
    times_at,
    warn,
    words,
)
from sparsemor.core.errors import InputError
from sparsemor.core.results.files.listing import add_to_listing, require_ours
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.output_lock import owned

if TYPE_CHECKING:
    from sparsemor.core.results.run_result import RunResult
    from sparsemor.core.results.stress import Field

Run = Annotated[str, typer.Argument(
    metavar="RUN", help="Directory of a run, finished or not.")]
At = Annotated[str | None, typer.Option(
    "--at", help="Times in s, such as 0.3,1.2; the nearest stored steps are used.")]


def export(
    run: Run,
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
    with exit_codes(as_json), located_in():
        from sparsemor.core.results.export import export as write
        from sparsemor.core.results.run_result import open_result

        result = open_result(run)
        folder = out or result.path.parent / form
        with part_of(result, folder):
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


def pictures(
    run: Run, at: At = None,
    fields: Annotated[str | None, typer.Option(
        "--fields", help="Colour the bodies by some of displacement,temperature,stress,strain "
        "(default: the first two).")] = None,
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="DIRECTORY",
        help="Directory for the files (default: `pictures` in the run's).")] = None,
    as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Draw a stored run: motion, fields at some times, probes, active atoms. PNG and SVG."""
    with exit_codes(as_json), located_in():
        from sparsemor.core.analysis.charts import (
            DEFAULT_FIELDS,
            silent,
            usual_files,
            write_run_charts,
        )
        from sparsemor.core.results.run_result import open_result
        from sparsemor.core.results.stress import FIELDS

        result = open_result(run)
        times = times_at(at)
        try:
            result.steps_at(times)
        except InputError as error:
            raise error.under("at") if times else error from None
        chosen = DEFAULT_FIELDS if fields is None else items(
            "fields", fields, _field, f"give some of {', '.join(FIELDS)}") or DEFAULT_FIELDS
        folder = out or result.path.parent / "pictures"
        with owned(folder), part_of(result, folder):
            require_ours(folder, usual_files())
            files = write_run_charts(
                result, folder, times, fields=chosen,
                report=silent if as_json or quiet else lambda file: typer.echo(str(file)))
        if as_json:
            print_json({"status": "done", "out": folder, "files": [str(f) for f in files]})


def animate(
    run: Run,
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
    with exit_codes(as_json), located_in():
        from sparsemor.core.analysis.charts.animation import animate as write
        from sparsemor.core.results.run_result import open_result

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


@contextmanager
def part_of(result: "RunResult", folder: Path) -> Iterator[None]:
    """Context in which files are written to a folder, which is listed as a part of the run's if it
    is new and inside it: `--force` replaces both."""
    run, place = result.path.parent.absolute(), folder.absolute()
    new = run in place.parents and not OutputDirectory(place).occupied()
    yield
    if new:
        with suppress(OSError, InputError):  # the run may be of another user
            add_to_listing(run, [{"part": place.relative_to(run).as_posix()}])


def _field(name: str) -> "Field":
    from sparsemor.core.results.stress import FIELDS

    if name not in FIELDS:
        raise ValueError(name)
    return FIELDS[name]


def _line(run: "RunResult", body: str, file: Path, fields: tuple[str, ...], times: int) -> str:
    from sparsemor.core.results.export.snapshot import exported_mesh

    what = ", ".join(fields) or "no field"
    points = len(exported_mesh(run, body, fields)[0])
    return f"{file}: {points} points, {times} times, {what}"
