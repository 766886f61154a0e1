"""Command `sparsemor study`: many runs of one scene, compared in one table."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sparsemor.core.cli.exit_codes import BAD_INPUT, FAILED, INTERRUPTED, leave, print_json
from sparsemor.core.scene.overrides import parse_settings
from sparsemor.plugins.command_line.completion import scene_names, study_names
from sparsemor.plugins.command_line.options import (
    Force,
    Json,
    Quiet,
    Settings,
    located_in,
    located_in_settings,
    path_of,
)

if TYPE_CHECKING:
    from sparsemor.plugins.study import StudyOutcome
    from sparsemor.plugins.study.plan import StudyPlan


def study(
    file: Annotated[str, typer.Argument(
        metavar="STUDY", help="A packaged study's name (`sparsemor plugins study` lists them), a "
                              "study file, or the directory of a study, whose charts are drawn "
                              "again from its table.", autocompletion=study_names)],
    scene: Annotated[str | None, typer.Argument(
        metavar="[SCENE]", help="Scene that the study varies, instead of its own: a packaged "
                                "scene's name, or a scene file.",
        autocompletion=scene_names)] = None,
    settings: Settings = None,
    out: Annotated[Path | None, typer.Option(
        "--out", parser=path_of, metavar="DIRECTORY",
        help="Directory for the table (default: runs/NAME). A stopped study is continued.")] = None,
    workers: Annotated[int, typer.Option(help="Worker processes on this machine; 0: none.")] = 0,
    scheduler: Annotated[str | None, typer.Option(
        metavar="ADDRESS", help="A dask.distributed cluster, as tcp://host:8786.")] = None,
    scheduler_file: Annotated[Path | None, typer.Option(
        parser=path_of, metavar="FILE", help="The same, by the file that `dask scheduler "
                                             "--scheduler-file FILE` writes.")] = None,
    no_times: Annotated[bool, typer.Option(
        "--no-times", help="Leave out the columns that depend on the machine.")] = False,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Run a scene under every combination of changes and tabulate errors and cost."""
    from sparsemor.plugins.study.journal import is_study
    from sparsemor.plugins.study.plan import StudyPlan
    from sparsemor.plugins.study.progress import progress_display
    from sparsemor.plugins.study.run_study import run_plan

    if is_study(Path(file)):
        _redraw(Path(file), as_json, quiet)
        return
    with located_in_settings():
        overrides = parse_settings(settings or ())
    with located_in():
        plan = StudyPlan.read(file, scene=scene, overrides=overrides)
    folder = (out or Path("runs", plan.study.name)).absolute()
    if scheduler is not None and scheduler_file is not None:
        leave(["give either --scheduler or --scheduler-file"], BAD_INPUT)
    try:
        with located_in(), progress_display(plan, quiet or as_json) as on_progress:
            done = run_plan(plan, out=folder, workers=workers,
                            scheduler=scheduler if scheduler_file is None else scheduler_file,
                            times=not no_times, force=force, on_progress=on_progress)
    except KeyboardInterrupt:
        _interrupted(plan, folder, as_json, quiet)
    else:
        _report(done, as_json, quiet)


def _redraw(folder: Path, as_json: bool, quiet: bool) -> None:
    """Draws the charts of a stored study from its table."""
    from sparsemor.core.results.files.written_files import require_ours
    from sparsemor.core.results.output_lock import owned
    from sparsemor.plugins.study.journal import CHARTS, stored
    from sparsemor.plugins.study.report import draw

    with located_in(), owned(folder):
        drawing, rows = stored(folder)
        require_ours(folder, CHARTS)
        charts = draw(drawing, rows, folder)
    if as_json:
        print_json({"status": "done", "out": str(folder), "files": [str(f) for f in charts]})
    elif not quiet:
        typer.echo(f"{folder}: {', '.join(path.name for path in charts)}")


def _report(done: "StudyOutcome", as_json: bool, quiet: bool) -> None:
    """Draws the charts and prints the table."""
    from sparsemor.plugins.study.report import draw, in_words

    charts = draw(done.plan.drawing, done.rows, done.folder)
    none = all(row["status"] != "done" for row in done.rows)
    if as_json:
        print_json({"status": "failed" if none else "done", "out": str(done.folder),
                    "workers_lost": done.lost.count, "runs": list(done.rows)})
    elif not quiet:
        typer.echo(in_words(done.plan, done.rows))
        if done.lost.count or done.lost.runs:
            typer.echo(str(done.lost))
        names = ", ".join(path.name for path in (*done.files, *charts))
        typer.echo(f"{done.folder}: {names}")
    if none:
        leave(["no run reached its end"], FAILED)


def _interrupted(plan: "StudyPlan", folder: Path, as_json: bool, quiet: bool) -> None:
    from sparsemor.plugins.study.journal import Journal, is_study
    from sparsemor.plugins.study.report import in_words

    rows: list[Any] = Journal(folder, plan.columns).rows() if is_study(folder) else []
    rows.sort(key=lambda row: int(row["run"]))
    if as_json:
        print_json({"status": "interrupted", "out": str(folder), "runs": rows})
    elif not quiet:
        typer.echo(in_words(plan, rows))
    leave([f"interrupted: the same command continues {folder / 'runs.csv'}"], INTERRUPTED)

