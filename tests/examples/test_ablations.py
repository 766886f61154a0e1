"""The pages with tables of the packaged studies say what those left, and they can be run again."""

import csv
import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from sparsemor import compare, simulate
from sparsemor.core.registry import Registry
from sparsemor.core.study.plan import Plan
from sparsemor.core.study.work import scene_of

DOCS = Path(__file__).parents[2] / "docs"
STUDIES = [p.name for p in Registry().names("study") if p.distribution == "sparsemor"]


def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_studies", DOCS / "make_studies.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_of_the_pages_are_those_of_the_studies() -> None:
    make, shown = maker(), set()
    for page in make.PAGES:
        text = page.read_text(encoding="utf-8")
        assert make.page(text) == text
        shown |= {match[1] for match in make.MARK.findall(text)}
    assert shown == set(STUDIES)


@pytest.mark.parametrize("name", STUDIES)
def test_every_packaged_study_plans_and_has_the_table_of_all_its_runs(name: str) -> None:
    plan = Plan.of(name)
    assert not any(run.refused for run in plan.runs)
    with (DOCS / "measured" / "studies" / f"{name}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(r["run"]) for r in rows] == [run.number for run in plan.runs]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [
    ("elastic_sparsity", 2), ("thermal_sparsity", 2), ("methods", 6), ("methods", 21),
    ("slider_methods", 1), ("slider_methods", 7), ("brake_methods", 1), ("brake_methods", 5)])
def test_a_row_of_a_table_comes_out_again(name: str, number: int) -> None:
    """To two percent; DEIM's points (docs/hyper-reduction.md) and errors of 1e-6 turn with the
    kernels that the processor gets."""
    run = Plan.of(name).runs[number - 1]
    assert run.scene is not None
    scene = scene_of(run.scene.plain())
    errors = compare(reference=simulate(scene.using({"reducer": "full"})),
                     run=simulate(scene)).errors["run"]
    with (DOCS / "measured" / "studies" / f"{name}.csv").open(encoding="utf-8") as file:
        row = list(csv.DictReader(file))[number - 1]
    for field in {"rigid", "elastic", "thermal"} & errors.keys():
        told = float(row[f"error_{field}"])
        loose = (name, number) == ("methods", 6) or told < 1e-5
        assert errors[field] == pytest.approx(told, rel=0.5 if loose else 2e-2, abs=1e-9)
