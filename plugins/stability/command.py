"""Command `sparsemor stability`: predicted stability of the reduced models of a scene."""

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.results.atomic_files import writing
from sparsemor.core.results.files.written_files import require_ours
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.output_lock import owned
from sparsemor.core.scene.yaml_reader import parse_value
from sparsemor.plugins.command_line.options import (
    Force,
    Json,
    Quiet,
    SceneName,
    Settings,
    finite_number,
    items,
    load_with,
    located_in,
    out_option,
    progress,
    times_at,
)
from sparsemor.plugins.publishing.listed_files import publishing
from sparsemor.plugins.publishing.tables import csv_table, with_head

if TYPE_CHECKING:
    from sparsemor.plugins.stability.survey import Survey
    from sparsemor.plugins.stability.variants import SurveyPlan

Out = Annotated[Path | None, out_option("only printed")]
FILES = ("stability.csv", "seeds.csv", "stability_map.png", "stability_map.svg")


def stability(
    scene: SceneName, settings: Settings = None,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds 1, 2, .. of each variant.")] = 10,
    samplers: Annotated[str | None, typer.Option(help="Samplers, such as lhs,random.")] = None,
    required: Annotated[str | None, typer.Option(
        help="Keep the rows of joints and loads: true, false or both.")] = None,
    rows: Annotated[str | None, typer.Option(
        help="Rows drawn of the blocks of each field, such as 30/20,60/40.")] = None,
    atoms: Annotated[str | None, typer.Option(
        help="Atoms of the blocks of each field, such as 30/20.")] = None,
    step: Annotated[str | None, typer.Option(help="Step sizes in s, such as 1e-3,2.5e-4.")] = None,
    integrators: Annotated[str | None, typer.Option(
        help="Integrators, such as 'bdf1,{use: generalized_alpha, rho_inf: 1}'.")] = None,
    at: Annotated[str | None, typer.Option(
        help="Times in s along the Galerkin model's run, such as 0 (the start only). Default: "
             "five from start to end for first-order integrators, else the start.")] = None,
    out: Out = None, force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Tabulate spectral radii of the coupled time-step map over seeds, rows, atoms and steps.

    Options that are left out take the values of the scene.
    """
    loaded = load_with(scene, settings)
    with located_in():
        plan = plan_of(seeds, samplers, required, rows, atoms, step, integrators, at)
        if out is not None:
            OutputDirectory(out).require_replaceable(
                force, "use --force to overwrite, or choose another --out",
                OutputDirectory(out).path.is_dir, "a directory only")
            require_ours(out, FILES)
    from sparsemor.plugins.stability.survey import survey

    with located_in(loaded), owned(out) if out is not None else nullcontext():
        with progress(quiet or as_json) as observers:
            found = survey(loaded, plan, observers=observers)
        files = [] if out is None else write(found, out)
    if as_json:
        print_json({"status": "done", "scene": loaded.name, **found.as_dict(),
                    "files": [str(f) for f in files]})
    elif not quiet:
        typer.echo(str(found))
        if files:
            typer.echo(f"tables and map: {out}")


def plan_of(
    seeds: int, samplers: str | None, required: str | None, rows: str | None, atoms: str | None,
    step: str | None, integrators: str | None, at: str | None,
) -> "SurveyPlan":
    """Plan of a stability survey from the text of the command's options, such as rows "30/20,60/40"
    (values apart by commas, one number a field); None: not given. Raises InputError that names the
    option."""
    from sparsemor.plugins.stability.variants import SurveyPlan

    flags = {"true": [True], "false": [False], "both": [True, False], None: None}
    if required not in flags:
        raise InputError(f"must be true, false or both (got {required})", "required")
    numbers = "must be a number for each field, such as 60/40"
    return SurveyPlan(
        samplers=items("samplers", samplers, str, "must be names of samplers"),
        required=flags[required], rows=items("rows", rows, _counts, numbers),
        atoms=items("atoms", atoms, _counts, numbers),
        steps=items("step", step, _positive, "must be step sizes in s, above 0"),
        integrators=_integrators(integrators), seeds=seeds, at=times_at(at))


def write(found: "Survey", folder: Path) -> list[Path]:
    """Writes stability.csv (one line per variant), seeds.csv (one line per seed of each variant)
    and the stability map; returns their paths."""
    from sparsemor.plugins.charts.style import save
    from sparsemor.plugins.stability.figure import stability_figure

    with writing(folder), publishing(folder) as fresh:  # temporary folder, moved at the end
        table, each = fresh / "stability.csv", fresh / "seeds.csv"
        lines = [e.as_dict() for e in found.entries]
        findings = [{**e.settings, **_flat(f.as_dict())} for e in found.entries for f in e.findings]
        for file, rows in ((table, lines), (each, findings)):
            file.write_text(csv_table(with_head(rows)), encoding="utf-8", newline="")
        save(stability_figure(found), fresh, "stability_map", ("png", "svg"))
    return [folder / name for name in FILES]


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    own = row["own"]
    radii = {f"radius_{name}": value for name, value in own.items()}
    return {k: v for k, v in row.items() if k != "own"} | radii


def _counts(word: str) -> tuple[int, ...]:
    counts = tuple(int(n) for n in word.split("/"))
    if min(counts) < 0:
        raise ValueError(word)
    return counts


def _positive(word: str) -> float:
    value = finite_number(word)
    if not value > 0.0:
        raise ValueError(word)
    return value


def _integrators(text: str | None) -> list[Any] | None:
    """Integrators from a YAML list without its brackets: names and mappings `{use: name, ..}`."""
    if text is None:
        return None
    return list(parse_value(f"[{text}]", "integrators"))
