"""Command `sparsemor reproduce`: figures and tables of a paper, recomputed, with verdicts."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sparsemor.core.cli.exit_codes import FAILED, INTERRUPTED, leave, print_json
from sparsemor.plugins.command_line.options import Force, Json, Quiet, located_in, path_of, words
from sparsemor.plugins.liang2026 import PAPER

if TYPE_CHECKING:
    from sparsemor.plugins.liang2026.reproduce import Reproduction


def reproduce(
    scene: Annotated[str, typer.Argument(
        metavar="SCENE", help="Only the items of this scene of the paper.")] = "",
    quick: Annotated[bool, typer.Option(
        "--quick", help="Shorter runs and fewer seeds where the whole takes long.")] = False,
    items: Annotated[str, typer.Option(
        help="Only these, such as fig_4,table_2.")] = "",
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="DIRECTORY",
        help="Directory for pages and runs, continued if it exists (default: "
             "runs/reproduce, or runs/reproduce-quick).")] = None,
    workers: Annotated[int | None, typer.Option(
        help="Worker processes (default: one per processor).")] = None,
    paper: Annotated[str, typer.Option(help="A packaged paper's name, or a paper file.")] = PAPER,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Recompute the figures and tables of a paper, with published numbers and verdicts."""
    from sparsemor.plugins.liang2026.reproduce import reproduce as reproduced

    try:
        with located_in():
            done = reproduced(
                scene, quick=quick, out=out, items=words(items) or (), workers=workers,
                paper=paper, force=force,
                on_progress=lambda line: None if quiet or as_json else typer.echo(line, err=True))
    except KeyboardInterrupt:
        leave(["interrupted: the same command continues"], INTERRUPTED)
    else:
        _report(done, as_json, quiet)


def _report(done: "Reproduction", as_json: bool, quiet: bool) -> None:
    """Prints the verdicts."""
    if as_json:
        print_json({
            "status": "failed" if done.incomplete else "done", "out": str(done.folder),
            "counts": dict(done.counts), "verdicts": [
                {"item": v.item, "verdict": v.grade, "rule": v.rule, "faults": v.faults,
                 "numbers": {n.name: {"published": n.paper, "here": n.here, "unit": n.unit}
                             for n in v.numbers}} for v in done.verdicts]})
    elif not quiet:
        for v in done.verdicts:
            typer.echo(f"{v.item:10} {v.grade}{': ' * bool(v.faults)}{'; '.join(v.faults)}")
        counts = ", ".join(f"{count} {grade}" for grade, count in done.counts.items())
        typer.echo(f"{counts}: {done.folder / 'index.html'}")
    if done.incomplete:
        leave(["some items could not be computed"], FAILED)
