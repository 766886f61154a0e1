"""`sparsemor compare`: the same scene solved by several reducers, the first is the reference."""

from pathlib import Path
from typing import Annotated, Any

import typer

from sparsemor.core.cli.common import (
    FAILED,
    Force,
    Json,
    Out,
    Quiet,
    Resume,
    SceneName,
    Settings,
    exit_codes,
    is_result,
    leave,
    load_with,
    located_in,
    place_for_result,
    print_json,
    progress,
)
from sparsemor.core.errors import InputError
from sparsemor.core.registry import Registry
from sparsemor.core.scene import Scene
from sparsemor.core.status import SolveFailed


def compare(
    scene: SceneName,
    reducers: Annotated[
        str, typer.Option(help="Names of reducers; the first is the reference.")
    ] = "full,galerkin,sparse",
    settings: Settings = None, out: Out = None, resume: Resume = False, force: Force = False,
    as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Run a scene with several reducers and tabulate errors and cost."""
    with exit_codes(as_json):
        loaded = load_with(scene, settings)
        scenes = variants(loaded, [n.strip() for n in reducers.split(",") if n.strip()])
        directory = out or Path("runs", f"{loaded.name}-compare")
        with place_for_result(directory, resume, force):
            results, failures = _run_all(scenes, directory, resume, quiet or as_json)
        _report(results, failures, directory, as_json, quiet)


def variants(scene: Scene, reducers: list[str], registry: Registry | None = None
             ) -> dict[str, Scene]:
    """The scene once per reducer.

    The scene's own reducer keeps its options. Others get those that they have in common with it:
    basis, budgets, and any option of the same name and type.
    """
    if len(reducers) < 2 or len(set(reducers)) < len(reducers):
        raise InputError(
            f"--reducers: give two or more different names (given: {','.join(reducers)})")
    known = registry or Registry()
    own: dict[str, Any] = scene.dump()["reducer"]
    chosen: dict[str, Scene] = {}
    for name in reducers:
        if name == own["use"]:
            chosen[name] = scene
            continue
        theirs = known.get("reducer", name).model_fields
        mine = known.get("reducer", own["use"]).model_fields
        common = {
            key: value for key, value in own.items() if key in theirs and (
                key in ("basis", "budgets") or theirs[key].annotation == mine[key].annotation)
        }
        chosen[name] = scene.using({"reducer": {"use": name, **common}}, label="--reducers")
    return chosen


def _run_all(
    scenes: dict[str, Scene], directory: Path, resume: bool, quiet: bool
) -> tuple[dict[str, Any], dict[str, SolveFailed]]:
    from sparsemor.core.results import open_result
    from sparsemor.core.simulate import simulate

    results: dict[str, Any] = {}
    failures: dict[str, SolveFailed] = {}
    for name, scene in scenes.items():
        with located_in(scene), progress(quiet) as observers:
            here = directory / name
            go_on = resume and is_result(here)
            try:
                if go_on and open_result(here).status.ok:
                    results[name] = open_result(here)
                else:
                    results[name] = simulate(
                        scene, out=here, resume=go_on, observers=observers)
            except SolveFailed as error:
                if not results:  # nothing to compare with
                    raise
                failures[name] = error
    return results, failures


def _report(
    results: dict[str, Any], failures: dict[str, SolveFailed], directory: Path, as_json: bool,
    quiet: bool,
) -> None:
    from sparsemor.core.compare import compare as compared

    reference, *others = results
    failed = [f"{name}: {error}" for name, error in failures.items()]
    if not others:
        if as_json:
            print_json({"status": "failed", "failures": failed})
        leave(failed, FAILED)
    comparison = compared(results[reference], **{name: results[name] for name in others})
    comparison.write(directory)
    if as_json:
        runs = {name: dict(result.summary) for name, result in results.items()}
        print_json({"status": "failed" if failed else "done", "reference": reference,
                    "errors": comparison.errors, "runs": runs, "failures": failed,
                    "out": str(directory)})
    elif not quiet:
        typer.echo(str(comparison))
        typer.echo(f"table and charts: {directory}")
    if failed:
        leave(failed, FAILED)
