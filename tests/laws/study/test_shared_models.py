"""Runs of a study that share one prepared model have the rows of runs with their own."""

import json
from pathlib import Path

import pytest

from small_scenes import tiny
from sparsemor import study
from sparsemor.core.simulation import training
from sparsemor.plugins.study import jobs
from sparsemor.plugins.study.table_columns import TIMES

FLUX = "loads.heating.flux"


@pytest.mark.full
def test_runs_that_differ_in_free_keys_share_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tiny().using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}}})
    (tmp_path / "tiny.json").write_text(json.dumps(scene.dump()))
    file = tmp_path / "study.json"
    file.write_text(json.dumps({
        "scene": "tiny.json", "list": [{}, {FLUX: 2.0e5}, {"reducer.basis.count": 3},
                                       {"time.end": 0.014, "reducer.basis.count": 3}],
        "set": {"time.end": 0.01, "training": {"end": 0.006, "overrides": {FLUX: 1.0e6}}}}))
    prepared: list[object] = []
    made = jobs.reduce
    monkeypatch.setattr(jobs, "reduce", lambda s, **k: prepared.append(s) or made(s, **k))
    monkeypatch.setattr(training, "train", lambda *a: pytest.fail("full order is solved twice"))
    shared = study(file, out=tmp_path / "shared")
    assert len(prepared) == 2
    assert {row["offline_cache"] for row in shared} == {"shared model"}
    monkeypatch.setattr(jobs, "shared_model", lambda *a: None)
    own = study(file, out=tmp_path / "own")
    for one, other in zip(shared, own, strict=True):
        assert one["status"] == "done" and one["steps"] in (10, 14)
        differing = {k for k in one if one[k] != other[k]} - set(TIMES)
        assert not differing


@pytest.mark.full
def test_runs_at_several_values_of_a_parameter_share_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tiny().using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 6}}, "time.end": 0.01,
        "probes": {"end": {"body": "bar", "at": "end_b"}},
        "parameters": {"angle": {"key": "bodies.bar.pose.angle", "range": [0.0, 0.5]}},
        "training.parameters": {"points": [{"angle": 0.0}, {"angle": 0.5}]}})
    (tmp_path / "tiny.json").write_text(json.dumps(scene.dump()))
    file = tmp_path / "study.json"
    file.write_text(json.dumps({
        "scene": "tiny.json", "reference": "none", "grid": {"parameters.angle": [0.0, 0.4]},
        "quantities": {"y": {"probe": "end", "component": "y"}}}))
    prepared: list[object] = []
    made = jobs.reduce
    monkeypatch.setattr(jobs, "reduce", lambda s, **k: prepared.append(s) or made(s, **k))
    shared = study(file, out=tmp_path / "shared")
    assert len(prepared) == 1
    assert {row["offline_cache"] for row in shared} == {"shared model"}
    monkeypatch.setattr(jobs, "shared_model", lambda *a: None)
    own = study(file, out=tmp_path / "own")
    for one, other in zip(shared, own, strict=True):
        assert one["status"] == "done" and one["y"] == pytest.approx(other["y"], rel=1e-9)
    assert shared[0]["y"] != pytest.approx(shared[1]["y"], rel=1e-3)
