"""The pages with tables of the packaged studies say what those left, and they can be run again."""

import csv
import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from sparsemor import compare, simulate
from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.study.jobs import scene_of
from sparsemor.plugins.study.plan import StudyPlan

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_REGISTRY = Registry()
STUDIES = {p.name: p.name for p in _REGISTRY.names("study") if p.distribution == "sparsemor"
           and isinstance(_REGISTRY.load("study", p.name), Path)} | {
    file.stem: str(file) for file in sorted(
        (ROOT / "tests" / "benchmarks" / "studies" / "ablations").glob("*.yaml"))}
"""Studies of one scene, whose tables the pages show: name -> packaged name or file."""


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


@pytest.mark.full
@pytest.mark.parametrize("name", STUDIES)
def test_every_packaged_study_plans_and_has_the_table_of_all_its_runs(name: str) -> None:
    plan = StudyPlan.read(STUDIES[name])
    assert not any(run.refused for run in plan.runs)
    with (DOCS / "measured" / "studies" / f"{name}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(r["run"]) for r in rows] == [run.number for run in plan.runs]


BY_PROCESSOR = {("thermal_sparsity", 2): 4e-2}
"""6.8e-6 or 6.9e-6, and its thermal error 4.02e-3 by snapshots of training steps to 1e-13, 3.92e-3
to 1e-11."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [
    ("elastic_sparsity", 2), ("thermal_sparsity", 2), ("methods", 21), ("slider_methods", 7),
    ("brake_methods", 5)])
def test_a_row_of_a_table_comes_out_again(name: str, number: int) -> None:
    """To one percent, but for one row that turns with the kernels the processor gets."""
    run = StudyPlan.read(STUDIES[name]).runs[number - 1]
    assert run.scene is not None
    scene = scene_of(run.scene)
    errors = compare(reference=simulate(scene.using({"reducer": "full"})),
                     run=simulate(scene)).errors["run"]
    with (DOCS / "measured" / "studies" / f"{name}.csv").open(encoding="utf-8") as file:
        row = list(csv.DictReader(file))[number - 1]
    for field in {"rigid", "elastic", "thermal"} & errors.keys():
        told = float(row[f"error_{field}"])
        within = BY_PROCESSOR.get((name, number), 1e-2)
        assert errors[field] == pytest.approx(told, rel=within, abs=1e-9)
