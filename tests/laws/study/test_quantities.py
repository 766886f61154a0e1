"""Quantities of interest: numbers of histories, columns of a study, and runs that are kept."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import InputError, open_result, study
from sparsemor.plugins.study.plan import StudyPlan
from sparsemor.plugins.study.quantities import TAKEN
from sparsemor.plugins.study.table_columns import label


def test_numbers_of_a_history() -> None:
    t = np.array([0.0, 1.0, 3.0])
    found = {take: number(t, t - 2.0) for take, number in TAKEN.items()}
    assert found == {"max": 1.0, "min": -2.0, "largest": 2.0, "final": 1.0, "time_of_max": 3.0,
                     "integral": -1.5, "mean": -0.5}


def test_labels_of_numbers_are_short() -> None:
    assert [label(v) for v in (1.5e11, 0.1 + 0.2, 7, "a", None, True)] == [
        "1.5e+11", "0.3", "7", "a", "", "true"]


def written(folder: Path, **more: Any) -> Path:
    scene = tiny().using({"probes": {"end": {"body": "bar", "at": "end_b"}}, "time.end": 0.01,
                          "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}}})
    (folder / "tiny.json").write_text(json.dumps(scene.dump()))
    (folder / "study.json").write_text(json.dumps({
        "scene": "tiny.json", "reference": "none", "grid": {"loads.heating.flux": [1e6, 2e5]},
        **more}))
    return folder / "study.json"


@pytest.mark.full
def test_columns_are_numbers_of_the_results_that_are_kept(tmp_path: Path) -> None:
    rows = study(written(tmp_path, keep=True, quantities={
        "tip": {"probe": "end", "component": "u_y", "take": "largest"},
        "hot": {"probe": "end", "component": "temperature", "take": "final"},
        "coldest": {"field": "temperature", "body": "bar", "take": "min"},
        "bent": {"field": "displacement", "body": "bar"},
        "stress": {"field": "stress", "body": "bar"},
        "strain": {"field": "strain", "body": "bar"},
        "pin": {"joint": "pin"},
        "none": {"probe": "end", "component": "voltage"}}), out=tmp_path / "out")
    for row in rows:
        run = open_result(tmp_path / "out" / row["result"])
        probe, steps = run.probe("end"), range(len(run.times))
        columns = run.probe_header("end").components
        assert row["tip"] == np.abs(probe[:, columns.index("u_y")]).max()
        assert row["hot"] == probe[-1, columns.index("temperature")]
        assert row["coldest"] == run.block("bar.thermal").min()
        assert row["stress"] == max(run.von_mises("bar", i).max() for i in steps)
        assert row["strain"] == max(run.equivalent_strain("bar", i).max() for i in steps)
        u = np.stack([run.nodal_displacement("bar", i) for i in steps])
        assert row["bent"] == np.linalg.norm(u, axis=2).max() > 0.0
        forces = run.joint_forces()["pin"]
        assert row["pin"] == np.sqrt(sum(v**2 for v in forces.values())).max()
        assert row["none"] is None and "none: component: none is called 'voltage'" in row["message"]
        assert not [name for name in row if "error" in name or "reference" in name]
    assert rows[0]["hot"] > rows[1]["hot"] > 0.0


def test_quantities_that_the_scene_has_not_are_faults_of_the_file(tmp_path: Path) -> None:
    for quantity, said in (({"probe": "top", "component": "x"}, "the scene has no 'top'"),
                           ({"probe": "end"}, "name the component of the probe"),
                           ({"field": "stress"}, "give `field` and `body`"),
                           ({"joint": "pin", "probe": "end"}, "give exactly one of")):
        with pytest.raises(InputError, match=said):
            StudyPlan.read(written(tmp_path, quantities={"a": quantity}))
    with pytest.raises(InputError, match="steps is a column of the results"):
        StudyPlan.read(written(tmp_path, quantities={"steps": {"joint": "pin"}}))
