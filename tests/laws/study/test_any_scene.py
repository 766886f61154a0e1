"""Studies of any scene: what they derive from it, and how its charts are drawn again."""

import json
from pathlib import Path
from typing import Any

import pytest

from sparsemor import InputError, study
from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.study.plan import Drawing, StudyPlan
from sparsemor.plugins.study.report import chart_notes

HERE = Path(__file__).parents[2]
SWING, HEATED, RIGID = (HERE / "scenes" / "swing.yaml", HERE / "scenes" / "heated_disk.yaml",
                        HERE.parent / "docs" / "examples" / "rigid_pendulum.yaml")
ANY = ["methods", "samplers", "solvers", "preconditioners", "bases", "integrators"]


def of(name: str, scene: Path, **overrides: Any) -> StudyPlan:
    return StudyPlan.read(name, scene=scene, overrides=overrides)


@pytest.mark.full
@pytest.mark.parametrize("scene", [SWING, HEATED])
def test_every_study_of_any_scene_fits_it(scene: Path) -> None:
    for name in ANY:
        plan = of(name, scene)
        refused = [run.refused for run in plan.runs if run.refused]
        assert not refused, (name, refused[:1])
        if name != "integrators":
            assert 0.0 < plan.drawing.errors_from == plan.drawing.trained_to
            assert all(run.training == plan.runs[0].training for run in plan.runs if run.learns)


@pytest.mark.full
def test_methods_are_those_that_are_installed_and_atoms_those_of_the_scene() -> None:
    basis = {"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 8},
                         "bases": {"*.thermal": {"use": "pod", "count": 4}}}}
    grid = of("methods", SWING, **basis).study.file.grid
    assert grid is not None
    names = {p.name for p in Registry().names("reducer") if p.distribution == "sparsemor"}
    assert names - {"full", "auto"} <= set(grid["method"])
    assert {k: (c["reducer.basis"]["count"], c["reducer.bases"]["*.thermal"]["count"])
            for k, c in grid["atoms"].items()} == {
                "2": (2, 1), "4": (4, 2), "5": (5, 3), "7": (7, 4), "8": (8, 4)}


@pytest.mark.full
def test_the_chart_says_which_part_of_a_run_is_outside_training() -> None:
    halves = of("methods", SWING).drawing
    assert chart_notes(halves, []) == [
        f"errors after {halves.errors_from:g} s, the end of training"]
    given = of("methods", SWING, **{"training.end": 0.012}).drawing
    assert given.errors_from == given.trained_to == 0.012
    other = of("methods", SWING, **{"training.overrides": {"time.step": 1e-3}}).drawing
    assert chart_notes(other, []) == ["errors over the whole run; training had other loads"]
    assert Drawing.of_plain(json.loads(json.dumps(given.plain()))) == given


@pytest.mark.full
def test_rigid_bodies_alone_have_integrators_only() -> None:
    assert {run.reducer for run in of("integrators", RIGID).runs} == {"full"}
    for name in ANY[:-1]:
        with pytest.raises(InputError, match="only `integrators` applies"):
            of(name, RIGID)
    with pytest.raises(InputError, match="is a study of any scene: name one"):
        StudyPlan.read("methods")
    with pytest.raises(InputError, match="name one, or write the changes under `set`"):
        StudyPlan.read("brake_untf", overrides={"time.end": 0.1})


@pytest.mark.full
def test_a_chart_is_drawn_again_from_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from typer.testing import CliRunner

    from sparsemor.core.cli import app

    monkeypatch.chdir(tmp_path)
    changes = {"time.end": 0.02, "reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 2}}}
    rows = study("methods", SWING, overrides=changes, out="a")
    assert len(rows) == len({(row["method"], row["atoms"]) for row in rows})
    assert all(row["late_elastic"] is not None for row in rows if row["status"] == "done")
    before = {p.name: p.read_bytes() for p in Path("a").glob("runs.*")}
    done = CliRunner().invoke(app, ["study", "a"])
    assert done.exit_code == 0, done.output
    assert "work_precision.png" in done.stdout
    assert before == {p.name: p.read_bytes() for p in Path("a").glob("runs.*")}
    about = json.loads(Path("a/study.json").read_text())
    assert about["drawing"]["errors_from"] == pytest.approx(0.01)
    Path("a/study.json").write_text("{}")
    assert CliRunner().invoke(app, ["study", "a"]).exit_code == 2
