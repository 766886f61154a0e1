"""`sparsemor stability`: will reduced models of a scene blow up, before any of them runs."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from sparsemor.core.cli.common import (
    Force,
    Json,
    Quiet,
    SceneName,
    Settings,
    exit_codes,
    load_with,
    located_in,
    out_option,
    print_json,
    progress,
)
from sparsemor.core.errors import InputError
from sparsemor.core.yaml_source import parse_value
from sparsemor.core.zarr_files import writing

if TYPE_CHECKING:
    from sparsemor.core.stability.plan import Plan
    from sparsemor.core.stability.survey import Survey

T = TypeVar("T")

Out = Annotated[Path | None, out_option("only printed")]


def stability(
    scene: SceneName, settings: Settings = None,
    seeds: Annotated[int, typer.Option(min=1, help="Seeds 1, 2, .. of each variant.")] = 10,
    samplers: Annotated[str | None, typer.Option(help="Samplers, such as lhs,random.")] = None,
    required: Annotated[str | None, typer.Option(
        help="Whether rows of joints and loads are kept: true, false or both.")] = None,
    rows: Annotated[str | None, typer.Option(
        help="Rows drawn of elastic/thermal blocks, such as 30/20,60/40.")] = None,
    atoms: Annotated[str | None, typer.Option(
        help="Atoms of elastic/thermal blocks, such as 30/20.")] = None,
    step: Annotated[str | None, typer.Option(help="Step sizes in s, such as 1e-3,2.5e-4.")] = None,
    integrators: Annotated[str | None, typer.Option(
        help="Integrators, such as 'bdf1,{use: generalized_alpha, rho_inf: 1}'.")] = None,
    at: Annotated[str | None, typer.Option(
        help="Times in s along the projected model's run, such as 0 (the start only); when not "
             "given five from start to end under rules of first order, else the start.")] = None,
    out: Out = None, force: Force = False, as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Tabulate spectral radii of the coupled one-step map over seeds, rows, atoms and steps.

    What is not given is as in the scene.
    """
    with exit_codes(as_json):
        loaded = load_with(scene, settings)
        plan = plan_of(seeds, samplers, required, rows, atoms, step, integrators, at)
        _admit(out, force)
        from sparsemor.core.stability.survey import survey

        with located_in(loaded), progress(quiet or as_json) as observers:
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
) -> "Plan":
    """The options as data. Raises InputError that names the option."""
    from sparsemor.core.stability.plan import Plan

    flags = {"true": [True], "false": [False], "both": [True, False], None: None}
    if required not in flags:
        raise InputError(f"--required: true, false or both (given: {required})")
    return Plan(
        samplers=_each(samplers, "samplers", str), required=flags[required],
        rows=_each(rows, "rows", _pair), atoms=_each(atoms, "atoms", _pair),
        steps=_each(step, "step", _positive), integrators=_integrators(integrators), seeds=seeds,
        at=_each(at, "at", float))


def write(found: "Survey", folder: Path) -> list[Path]:
    """stability.csv (a line a variant), seeds.csv (a line a seed) and the map."""
    from sparsemor.core.charts.stability import stability_figure
    from sparsemor.core.charts.style import save

    folder.mkdir(parents=True, exist_ok=True)
    table, each = folder / "stability.csv", folder / "seeds.csv"
    with writing(folder):
        _write_csv(table, [e.as_dict() for e in found.entries])
        _write_csv(each, [{**e.settings, **_flat(f.as_dict())}
                          for e in found.entries for f in e.findings])
        return [table, each,
                *save(stability_figure(found), folder, "stability_map", ("png", "svg"))]


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    own = row["own"]
    radii = {f"radius_{name}": value for name, value in own.items()}
    return {k: v for k, v in row.items() if k != "own"} | radii


def _write_csv(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    with file.open("w", encoding="utf-8", newline="") as text:
        writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: "" if v is None else v for k, v in row.items()} for row in rows)


def _admit(out: Path | None, force: bool) -> None:
    if out is None or not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"--out {out}: that is a file: name a directory")
    if any(out.iterdir()) and not force:
        raise InputError(f"--out {out}: there is something already: write into it with --force, or "
                         "name another directory")


def _each(text: str | None, option: str, read: Callable[[str], T]) -> list[T] | None:
    if text is None:
        return None
    found = []
    for word in (w.strip() for w in text.split(",")):
        try:
            found.append(read(word))
        except ValueError:
            raise InputError(f"--{option}: cannot read {word!r}{_FORMS.get(option, '')}") from None
    return found


_FORMS = {"rows": ": give elastic/thermal, such as 60/40",
          "atoms": ": give elastic/thermal, such as 30/20",
          "step": ": give step sizes in s, above 0", "at": ": give times in s"}


def _pair(word: str) -> tuple[int, int]:
    elastic, thermal = (int(n) for n in word.split("/"))
    if min(elastic, thermal) < 0:
        raise ValueError(word)
    return elastic, thermal


def _positive(word: str) -> float:
    value = float(word)
    if not value > 0.0:
        raise ValueError(word)
    return value


def _integrators(text: str | None) -> list[Any] | None:
    """A YAML list without its brackets: names and `{use: name, ..}`."""
    if text is None:
        return None
    try:
        found: list[Any] = list(parse_value(f"[{text}]", "integrators"))
    except InputError as error:
        raise InputError(f"--integrators: {error.faults[0].message}") from None
    return found
