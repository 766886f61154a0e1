"""One short example of each thing that the program does: what stays in the default tier, though it
takes longer than other tests there. Each has its detailed tests in the full tier."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from small_scenes import SCENES, tiny
from sparsemor import load, open_result, simulate, study
from sparsemor.core.cli import app
from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import Status
from tiers import quick

TINY = str(SCENES / "tiny.yaml")
STEPS = 3
COARSE: dict[str, dict[str, Any]] = {
    "double_pendulum": {
        **{f"bodies.link{i}.mesh.elements": 320 for i in (1, 2)},
        "reducer.budgets": {"*": {"rows": 40, "atoms": 10}}},
    "slider_plate": {
        "bodies.slider.mesh.divisions": [6, 6], "bodies.slider.mesh.elements": 84,
        "bodies.plate.mesh.divisions": [18, 4], "bodies.plate.mesh.elements": 126,
        "reducer.budgets": {"*": {"rows": 30, "atoms": 10}}},
    "brake_disk": {
        "bodies.disk.mesh": {"use": "disk", "triangles": 300, "rim": 36, "layers": 1},
        "reducer.budgets": {"*": {"rows": 40, "atoms": 10}}},
}
COMPLETE = {f"{name}{kind}": name for name in COARSE for kind in ("_published", "_recovered")}
"""Scenes with complete bases, which take up to a minute to make at their size, by the scene whose
bodies they have."""
pytestmark = pytest.mark.usefixtures("here")


def in_json(*arguments: object) -> Any:
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def begins(scene: Scene) -> None:
    end = STEPS * scene.time.step
    run = simulate(scene.using({"time.end": end, "training.end": end}), out="out")
    assert (run.status, run.summary["steps"]) == (Status.DONE, STEPS)
    assert run.times[-1] == pytest.approx(end)
    assert all(np.isfinite(v.to_numpy()).all() for v in run.to_xarray().data_vars.values()
               if v.dtype.kind == "f" and v.name != "step_seconds")


@pytest.mark.end_to_end
@pytest.mark.parametrize("name", [
    *quick([*COARSE, "hot_plate", "hot_pendulum"], "double_pendulum"),
    *(pytest.param(name, marks=pytest.mark.slow) for name in COMPLETE)])
def test_a_packaged_scene_begins(name: str) -> None:
    begins(load(name))


@pytest.mark.full
@pytest.mark.parametrize("name", COMPLETE)
def test_a_scene_with_complete_bases_begins_on_a_coarse_mesh(name: str) -> None:
    begins(load(name, COARSE[COMPLETE[name]]))


@pytest.mark.end_to_end
def test_compare_is_one_table() -> None:
    shown = in_json("compare", TINY, "--reducers", "full,galerkin", "--set", "time.end=0.01",
                    "--training-end", "1", "--no-charts", "--out", "out")
    assert [run["run"] for run in shown["runs"]] == ["full", "galerkin"]
    assert 0 <= shown["errors"]["galerkin"]["bar.elastic"] < 1e-6
    assert Path("out/errors.csv").is_file()


@pytest.mark.end_to_end
def test_a_study_is_one_table() -> None:
    Path("two.yaml").write_text(json.dumps({
        "scene": TINY, "set": {"time.end": 0.01, "reducer": "galerkin"},
        "grid": {"reducer.basis": [{"use": "pod", "count": 2}, {"use": "pod", "count": 5}]}}))
    rows = study("two.yaml", out="out")
    assert Path("out/table.jsonl").is_file()
    assert [row["status"] for row in rows] == ["done", "done"]
    assert rows[0]["error_elastic"] > rows[1]["error_elastic"] >= 0


class StopsAfter:
    """An observer that ends the process's work in the middle of a run."""

    def __init__(self, step: int) -> None:
        self.step = step

    @hookimpl
    def on_step(self, step: int) -> None:
        if step == self.step:
            raise KeyboardInterrupt


@pytest.mark.end_to_end
def test_a_stopped_run_goes_on_to_the_same_numbers() -> None:
    scene = tiny().using({"reducer": "full"})
    with pytest.raises(KeyboardInterrupt):
        simulate(scene, out="stopped", observers=[StopsAfter(17)])
    assert open_result("stopped").status is not Status.DONE
    on = simulate(scene, out="stopped", resume=True)
    whole = simulate(scene, out="whole")
    assert on.summary["steps"] == whole.summary["steps"] == 40
    for name, values in whole.to_xarray().variables.items():
        if name != "step_seconds":
            np.testing.assert_array_equal(on.to_xarray()[name].to_numpy(), values.to_numpy())


@pytest.mark.end_to_end
def test_a_run_is_written_for_paraview() -> None:
    shown = in_json("run", TINY, "--set", "reducer=full", "--set", "time.end=0.01", "--out", "out")
    assert (shown["status"], shown["steps"]) == ("done", 10)
    written = in_json("export", "out", "--every", 5)
    assert (written["status"], written["times"]) == ("done", 3)
    assert all(Path(file).is_file() for file in written["files"].values())
