"""Command `sparsemor run`: simulates one scene and stores the result."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.results.model_file import is_model_file
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.scene.overrides import parse_settings
from sparsemor.plugins.command_line.folded_notes import folded
from sparsemor.plugins.command_line.options import (
    Force,
    Json,
    Quiet,
    Resume,
    SceneName,
    Settings,
    inform,
    load_with,
    located_in,
    located_in_settings,
    out_option,
    place_for_result,
    progress,
    warn,
)

if TYPE_CHECKING:
    from sparsemor.plugins.kept_models.reduced_model import ReducedModel

Out = Annotated[Path | None, out_option("runs/SCENE-REDUCER")]


def run(
    scene: SceneName, settings: Settings = None, out: Out = None, resume: Resume = False,
    force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Simulate a scene, or a model that `sparsemor reduce` wrote, and store the result."""
    model = _kept(scene, resume)
    if model is None:
        loaded = load_with(scene, settings)
    else:
        with located_in_settings():
            loaded = model.scene.using(parse_settings(settings or ()))
            model.check(loaded)
    directory = out or Path("runs", f"{loaded.name}-{loaded.reducer_name}")
    with (place_for_result(directory, resume if model is None else None, force),
          located_in(loaded),
          progress(quiet or as_json) as observers):
        if model is None:
            from sparsemor.core.simulation.simulate import simulate

            result = simulate(loaded, out=directory, resume=resume, observers=observers)
        else:
            result = model.run(loaded, out=directory, observers=observers)
    summary = dict(result.summary)
    if as_json:
        print_json(summary)
    elif not quiet:
        typer.echo(in_words(summary))
        typer.echo(f"result: {directory}")
    owners = [*loaded.bodies, *loaded.joints]
    if not quiet:
        warn(folded({"": summary.get("notes", ())}, owners))
    if not (quiet or as_json):  # programs find it in the summary
        inform(folded({"": summary.get("information", ())}, owners))


def _kept(scene: str, resume: bool) -> "ReducedModel | None":
    """The reduced model in a file; None for a scene. Raises LocatedError."""
    if not is_model_file(Path(scene)):
        return None
    from sparsemor.plugins.kept_models.reduced_model import load_model

    with located_in():
        model = load_model(scene)
        if resume:
            raise InputError("a run of a kept model is not resumed: run it again", "resume")
    return model


def in_words(summary: Mapping[str, Any]) -> str:
    """Summary of a run as aligned lines of text; entries that the run does not report are left
    out."""
    from sparsemor.plugins.comparison.cost import solvers_in_words
    from sparsemor.plugins.publishing.tables import marked

    lines = [("status", summary.get("status")), ("reducer", summary.get("reducer"))]
    if "steps" in summary:
        lines.append(("steps", f"{summary['steps']} to t = {summary.get('t_end', 0.0):g} s"))
    wall = summary.get("wall_s")
    if isinstance(wall, Mapping):
        per_step = summary.get("ms_per_step")
        rate = f" ({per_step:.3g} ms/step)" if isinstance(per_step, int | float) else ""
        lines += [("offline", f"{wall['offline']:.3g} s{_cached(summary)}"),
                  ("online", f"{wall['online']:.3g} s{rate}")]
    iterations = summary.get("newton_iterations")
    lines.append(("iterations", None if iterations is None else f"{_short(iterations)} per step"))
    lines.append(("factorized", summary.get("factorizations")))
    lines += [("linear solver", text) for text in solvers_in_words(
        summary.get("linear_solvers", ()))]
    limit = summary.get("error_tolerance", LIMIT)
    lines += [("error estimate", f"{n}: {marked(e, '.2g', limit)} of its largest change")
              for n, e in summary.get("error_estimate", {}).items()]
    for label, key in (("at full order", "fall_back"), ("for new atoms", "enriched")):
        if found := summary.get(key):
            lines.append((label, f"{found['steps']} steps, {found['seconds']:.3g} s"))
    held = summary.get("memory")
    if held:
        lines.append(("memory", f"{held['peak_gb']:.2g} GB at most"))
    for name in ("rows", "atoms", "atoms_active", "elements_touched", "probes"):
        lines += [(name.replace("_", " "), f"{k}: {_short(v)}")
                  for k, v in _entries(summary.get(name)) if v != 0]
    width = max(len(label) for label, _ in lines)
    return "\n".join(f"{label:<{width}}  {value}" for label, value in lines if value is not None)


def _cached(summary: Mapping[str, Any]) -> str:
    """Cache hits and misses of the offline stage (snapshots, bases), as text."""
    used = ", ".join(f"{k} {v}" for k, v in summary.get("cache", {}).items())
    return f" (cache: {used})" if used else ""


def _entries(value: object) -> list[tuple[str, object]]:
    if isinstance(value, Mapping):
        return list(value.items())
    return [] if value is None else [("all", value)]


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_short, value))
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_short(v)}" for k, v in value.items())
    return str(value)
