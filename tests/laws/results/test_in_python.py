"""Scenes and studies from plain data; what a notebook shows of scenes, runs and comparisons."""

import gc
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import (
    InputError,
    SolveFailed,
    animate,
    compare,
    load,
    open_result,
    plot,
    simulate,
    study,
)
from sparsemor.core.results.run_result import RunResult

BALL: dict[str, Any] = {
    "bodies": {"ball": {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {
        "hub": [0.0, 0.0], "tip": [0.3, 0.0]}}},
    "joints": {"pin": {"use": "revolute", "between": ["ground", "ball:hub"]}},
    "loads": {"motor": {"use": "torque", "on": "ball:hub", "torque": 1.0}},
    "time": {"end": 0.1, "step": 0.01}}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return simulate(load(BALL), out=tmp_path_factory.mktemp("run"))


def test_a_scene_from_plain_data_is_that_of_a_file(tmp_path: Path) -> None:
    scene = load(BALL, {"time.end": 0.2})
    assert scene.time.end == 0.2 and load(scene.dump()).digest() == scene.digest()
    html = scene._repr_html_()
    assert "<td>pin</td><td>revolute</td>" in html and "0.2 s in steps of 0.01 s" in html
    with pytest.raises(InputError, match="^lodes: no such option: did you mean loads"):
        load({**BALL, "lodes": {}})


@pytest.mark.full
def test_a_temporary_result_is_removed_with_its_last_reader() -> None:
    """The result, its dataset and a copy are readers; a failed run's result is one, too."""
    result = simulate(load(BALL))
    folder, rigid = result.path.parent, result.block("ball.rigid")
    data = result.to_xarray()
    del result
    gc.collect()
    assert np.array_equal(data["ball.rigid"].to_numpy(), rigid)
    data.close()
    del data
    gc.collect()
    assert not folder.exists()
    result = simulate(load(BALL))
    other = pickle.loads(pickle.dumps(result))
    del result
    gc.collect()
    assert np.array_equal(other.block("ball.rigid"), rigid)  # it stays until the process ends
    with pytest.raises(SolveFailed) as caught:
        simulate(load(BALL, {"loads.motor.torque": 1e300}))
    failed = caught.value.result
    assert isinstance(failed, RunResult) and failed.path.exists()


@pytest.mark.full
def test_a_study_from_plain_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.yaml").write_text("format: 1\n" + "\n".join(
        f"{key}: {value}" for key, value in BALL.items()))
    rows = study({"scene": "ball.yaml", "grid": {"time.step": [0.01, 0.005]}}, progress=True)
    assert [row["status"] for row in rows] == ["done", "done"]
    assert "2/2 done" in capsys.readouterr().err
    assert (tmp_path / "runs" / "study").is_dir()
    with pytest.raises(InputError, match="^grid.nix.0: nix: no such option"):
        study({"scene": "ball.yaml", "grid": {"nix": [1]}})


@pytest.mark.full
def test_what_a_notebook_shows(run: RunResult, tmp_path: Path) -> None:
    assert "<td>ball.rigid (3), pin.multiplier (2)</td>" in run._repr_html_()
    found = compare(run, again=open_result(run.path))
    assert repr(found) == "<Comparison with full: combined errors again 0.0e+00>"
    assert "<td>again</td>" in found._repr_html_() and "<th>combined</th>" in found._repr_html_()
    assert "force (" in plot(run, "joint_forces").axes[0].get_ylabel()
    assert plot(found, "angles").axes
    with pytest.raises(InputError, match="no chart is called 'forces': .*joint_forces"):
        plot(run, "forces")
    with pytest.raises(InputError, match="there are no data for stress"):
        plot(run, "stress")


@pytest.mark.full
def test_an_animation_shows_the_rigid_body(run: RunResult, tmp_path: Path) -> None:
    from PIL import Image

    seen: list[tuple[int, int]] = []
    file = animate(run, tmp_path / "a.gif", frames=4, report=lambda *at: seen.append(at))
    with Image.open(file) as image:
        assert image.n_frames == 4
        first = image.convert("L").tobytes()
        image.seek(3)
        assert image.convert("L").tobytes() != first
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    with pytest.raises(InputError, match="give at least 2"):
        animate(run, tmp_path / "b.gif", frames=1)
    with pytest.raises(InputError, match="ends with .gif or .mp4"):
        animate(run, tmp_path / "b.avi")
