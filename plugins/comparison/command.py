"""Command `sparsemor compare`: runs one scene with several reducers; the first is the reference."""

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sparsemor.core.cli.exit_codes import FAILED, leave, print_json
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.results.atomic_files import writing
from sparsemor.core.results.output_directory import COMPARISON, OutputDirectory
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.command_line.folded_notes import folded
from sparsemor.plugins.command_line.options import (
    Force,
    Json,
    Quiet,
    Resume,
    SceneName,
    Settings,
    load_with,
    located_in,
    out_option,
    place_for_result,
    progress,
    warn,
    words,
)
from sparsemor.plugins.publishing.listed_files import add_part

if TYPE_CHECKING:
    from sparsemor.core.results.run_result import RunResult

Out = Annotated[Path | None, out_option("runs/SCENE-compare")]
COMPARED = "full,galerkin,sparse"
"""Reducers that are run where none are named."""
TABLES = ("errors.csv", "start_up.csv", "error_over_time.csv")
"""Files of a comparison, besides pictures."""
HALF = 0.5
"""Fraction of the run on which bases are trained where the scene would train them on all of it."""


def compare(
    scene: SceneName,
    reducers: Annotated[
        str, typer.Option(help="Names of reducers; the first is the reference.")
    ] = COMPARED,
    settings: Settings = None, out: Out = None, resume: Resume = False, force: Force = False,
    charts: Annotated[
        bool, typer.Option("--charts/--no-charts", help="Draw pictures, which may take longer "
                           "than the runs.")
    ] = True,
    as_json: Json = False, quiet: Quiet = False,
    training_end: Annotated[
        float | None, typer.Option(min=0.0, max=1.0, help="Fraction of the run on which bases are "
                                   f"trained; errors after it are tabulated and drawn. {HALF} by "
                                   "default if the scene trains on all of the run.")
    ] = None,
    error_limit: Annotated[
        float, typer.Option(min=0.0, help="Errors above this are marked in tables and charts.")
    ] = 0.1,
) -> None:
    """Run a scene with several reducers and tabulate errors and cost."""
    loaded = load_with(scene, settings)
    with located_in(loaded):
        if training_end is None and covered(loaded, settings):
            training_end = HALF
        if training_end is not None:
            loaded = trained_on(loaded, training_end)
        scenes = variants(loaded, words(reducers) or [])
    directory = out or Path("runs", f"{loaded.name}-compare")
    body_cache = BodyCache()
    _refuse_early(scenes, body_cache)
    writes = list(TABLES)
    if charts:
        from sparsemor.plugins.comparison.compare import installed_charts

        for drawing in installed_charts():
            writes += drawing.usual_files(tuple(scenes))
    with place_for_result(directory, resume, force, writes, tuple(scenes)):
        results, failures = _run_all(scenes, directory, resume, quiet or as_json, body_cache)
    _report(results, failures, directory, as_json, quiet, charts, error_limit,
            [*loaded.bodies, *loaded.joints])


def covered(scene: Scene, settings: Sequence[str] | None) -> bool:
    """True if the training run of a scene is all of its run, without being named in `--set`."""
    training = scene.training
    return (not any(s.startswith("training") for s in settings or ())
            and not training.overrides and not training.several
            and scene.training_end >= scene.time.end * (1 - 1e-9))


def trained_on(scene: Scene, share: float) -> Scene:
    """The scene with a training run of the first steps, a share of all. One with more steps than
    numbers can count is refused later, as it is."""
    count = share * scene.time.end / scene.time.step
    if not count < 2**53:
        return scene
    steps = max(1, math.ceil(count - 1e-6))
    return scene.using({"training.end": steps * scene.time.step}, label="--training-end")


def variants(scene: Scene, reducers: list[str]) -> dict[str, Scene]:
    """Reducer name -> copy of the scene with that reducer (model reduction method).

    The scene's own reducer keeps its options; any other takes over what both share, as with `--set
    reducer=NAME` (`core/scene/overrides.py`). Raises InputError for fewer than two names.
    """
    if len(reducers) < 2 or len(set(reducers)) < len(reducers):
        raise InputError(
            f"give two or more different names (got {', '.join(reducers) or 'none'})", "reducers")
    for name in reducers:
        try:
            scene.source.registry.get("reducer", name)
        except InputError as error:
            raise error.under("reducers") from None
    return {name: scene if name == scene.reducer_name else
            scene.using({"reducer": name}, label="--reducers") for name in reducers}


def _refuse_early(scenes: dict[str, Scene], body_cache: BodyCache) -> None:
    """Validates the input of all runs before the first one starts. Raises InputError."""
    from sparsemor.core.simulation.validation import checked_model

    for scene in scenes.values():
        with located_in(scene):
            checked_model(scene, body_cache)


def _run_all(
    scenes: dict[str, Scene], directory: Path, resume: bool, quiet: bool, body_cache: BodyCache
) -> "tuple[dict[str, RunResult], dict[str, SolveFailed]]":
    """Runs all scenes: results by reducer name, also of runs that stopped early, and the errors
    that stopped them.

    A full-order run that begins with the training run of the reduced ones (`teacher`) leaves the
    snapshots in the cache. If a later run finds bad input, the results that this call wrote are
    removed.
    """
    from sparsemor.core.results.run_result import RunResult
    from sparsemor.core.simulation.training import training_steps

    results: dict[str, RunResult] = {}
    failures: dict[str, SolveFailed] = {}
    teacher = next((n for n, s in scenes.items() if training_steps(s)), "")
    for name in scenes:
        add_part(directory, name, COMPARISON)
    # results of an earlier command, which stay
    old = {name for name in scenes if OutputDirectory(directory / name).is_result()}
    for name, scene in scenes.items():
        with located_in(scene), progress(quiet) as observers:
            try:
                results[name] = _run_one(
                    scene, directory / name, resume, observers, body_cache, keep=name == teacher)
            except InputError:
                for made in set(results) - old:
                    OutputDirectory(directory / made).remove_result()
                raise
            except SolveFailed as error:
                if not results or error.status is Status.INTERRUPTED:
                    raise  # nothing to compare with, or no wish to
                failures[name] = error
                if isinstance(error.result, RunResult):
                    results[name] = error.result
    return results, failures


def _run_one(
    scene: Scene, here: Path, resume: bool, observers: Sequence[object], body_cache: BodyCache,
    keep: bool,
) -> "RunResult":
    """Result of one reducer in its folder; with `resume` that of an earlier command, if it is
    complete and nothing that its numbers depend on has changed since, or its continuation."""
    from sparsemor.core.results.run_result import open_result
    from sparsemor.core.scene.run_identity import Identity
    from sparsemor.core.simulation.simulate import simulate

    if resume and OutputDirectory(here).is_result():
        earlier = open_result(here)
        if earlier.status.ok and earlier.attributes["scene_digest"] == scene.digest():
            changed = Identity.from_scene(scene).changes(earlier.attributes.get("identity", {}))
            if changed:
                raise InputError(f"{here} cannot be kept: since it was computed, "
                                 f"{'; '.join(changed)}. Start again, with --force", "resume")
            return earlier
        return simulate(scene, out=here, resume=True, observers=observers, body_cache=body_cache,
                        estimate=True)
    return simulate(scene, out=here, observers=observers, body_cache=body_cache,
                    keep_training=keep, estimate=True)


def _drawn(file: Path) -> None:
    """Shows on a terminal which picture was drawn last."""
    typer.echo(f"\r\x1b[Kdrawn: {file.name}", err=True, nl=False)


def _report(
    results: "dict[str, RunResult]", failures: dict[str, SolveFailed], directory: Path,
    as_json: bool, quiet: bool, charts: bool, error_limit: float, owners: Sequence[str],
) -> None:
    """Writes the tables and charts of a comparison and prints it; ends the command with the code of
    a failed run if one has failed. The first result is the reference; owners: names of bodies and
    joints, for notes that are alike but for these."""
    from sparsemor.plugins.comparison.compare import compare as compared

    reference, *others = results
    failed = [f"{name}: {error}" for name, error in failures.items()]
    if not others:
        if as_json:
            print_json({"status": "failed", "failures": failed})
        leave(failed, FAILED)
    runs: dict[str, Any] = {name: results[name] for name in others}
    comparison = compared(results[reference], error_limit=error_limit, failed={
        name: str(error) for name, error in failures.items() if name not in results}, **runs)
    with writing(directory):
        drawing = sys.stderr.isatty() and not (quiet or as_json)
        comparison.write(directory, charts, _drawn if drawing else None)
        if drawing and charts:
            typer.echo("\r\x1b[K", err=True, nl=False)
    summaries = {name: dict(result.summary) for name, result in results.items()}
    if as_json:
        print_json({"status": "failed" if failed else "done", "reference": reference,
                    "runs": [{"run": name, **summary} for name, summary in summaries.items()],
                    "errors": comparison.errors, "effectivity": comparison.effectivity,
                    "above_limit": comparison.above_limit,
                    "late_errors": comparison.late_errors, "trained_to": comparison.trained_to,
                    "wall_clock_gain": {n: g._asdict() for n, g in comparison.gains.items()},
                    "start_up": {n: e.start_up for n, e in comparison.measured.items()},
                    "steady": {n: e.steady for n, e in comparison.measured.items()},
                    "failures": failed, "out": str(directory)})
    elif not quiet:
        typer.echo(str(comparison))
        typer.echo(f"table{' and charts' * charts}: {directory}")
    if not quiet:
        warn(folded({name: s.get("notes", ()) for name, s in summaries.items()}, owners))
    if failed:
        leave(failed, FAILED)
