"""Stress at probes: that of the stored fields, in the plane and in space, heated, with prescribed
temperatures, reduced and kept; a controller that reads it."""

from typing import Any

import numpy as np
import pytest

from sparsemor import load, load_model, reduce, simulate
from sparsemor.core.errors import InputError

PARTS = {2: [(0, 0), (1, 1), (2, 2), (0, 1)],
         3: [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]}


def bar(d: int, model: str | None = None, **more: Any) -> dict[str, Any]:
    mesh = {"use": "rectangle" if d == 2 else "block", "size": [0.2, 0.04, 0.03][:d],
            "divisions": [6, 2, 1][:d]}
    body = {"use": "flexible", "mesh": mesh, "fields": ["elastic", "thermal"], "frame": "fixed",
            "order": 2, "reference": {"clamp": "left"},
            "sets": {"half": {"where": "x > 0.1 - 1e-9"}},
            "material": {"rho": 7800.0, "E": 2e11, "nu": 0.3, "alpha": 1.2e-5, "k": 40.0,
                         "c": 500.0},
            "materials": {"half": {"rho": 2700.0, "E": 7e10, "nu": 0.33, "alpha": 2.3e-5,
                                   "k": 200.0, "c": 900.0}}}
    if d == 2:
        body |= {"thickness": 0.02, **({"model": model} if model else {})}
    return {"format": 1, "bodies": {"b": body}, "reducer": "full", "integrator": "bdf1",
            "joints": {"cold": {"use": "prescribed_temperature", "on": ["b:left"],
                                "temperature": {"use": "ramp", "end": 1.0, "final": 250.0,
                                                "initial": 300.0}}},
            "loads": {"pull": {"use": "point_force", "on": "b:right", "force": [1e4, 2e3, 5e2][:d]},
                      "heat": {"use": "heat_flux", "on": ["b:top"], "flux": 1e6}},
            "probes": {"root": {"body": "b", "at": "left", "stress": True},
                       "mid": {"body": "b", "at": [0.1, 0.04, 0.03][:d], "stress": True}},
            "time": {"end": 2.0, "step": 0.1}, **more}


@pytest.mark.full
@pytest.mark.parametrize(("d", "model"), [
    (2, None), pytest.param(2, "plane_strain", marks=pytest.mark.full),
    pytest.param(3, None, marks=pytest.mark.full)])
def test_it_is_that_of_the_fields(d: int, model: str | None) -> None:
    run = simulate(load(bar(d, model)))
    X = run.points("b")
    node = int(np.linalg.norm(X - np.array([0.1, 0.04, 0.03][:d]), axis=1).argmin())
    for step in (0, 7, -1):
        s = run.stress("b", step)
        row = run.probe("mid")[step, 2 * d + 1 :]
        size = np.abs(s).max()
        assert np.allclose(row[:-1], [s[node][k] for k in PARTS[d]], atol=1e-9 * size)
        assert row[-1] == pytest.approx(run.von_mises("b", step)[node], abs=1e-9 * size)
    assert np.abs(run.probe("root")[-1, 2 * d + 1 :]).max() > 1e7


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "ecsw"])
def test_reduced_and_kept(tmp_path: Any, reducer: str) -> None:
    scene = load(bar(2, reducer={"use": reducer, "basis": {"use": "pod", "count": 12}}))
    full = simulate(scene.using({"reducer": "full"})).probe("mid")
    model = reduce(scene)
    model.save(tmp_path / "bar.model")
    for run in (model.run(), load_model(tmp_path / "bar.model").run()):
        found = run.probe("mid")
        assert np.abs(found - full)[:, 5:].max() < 1e-3 * np.abs(full[:, 5:]).max()


@pytest.mark.full
def test_a_controller_reads_it() -> None:
    """A press that lets go above 20 MPa at the root."""
    data = bar(2, loads={"pull": {"use": "point_force", "on": "b:right", "force": [1e5, 0.0],
                                  "factor": {"use": "pid", "sensor": "root.stress_xx",
                                             "target": 2.0e7, "ki": 1e-7}}},
               time={"end": 3.0, "step": 0.05})
    data["bodies"]["b"]["fields"] = ["elastic"]
    data["joints"] = {}
    stress = simulate(load(data)).probe("root")[:, 4]
    assert stress[-1] == pytest.approx(2e7, rel=0.05)


@pytest.mark.parametrize("change", [
    {"strains": "nonlinear"},
    {"material": {"use": "orthotropic", "rho": 1600.0, "E": [1.4e11, 1e10, 1e10],
                  "nu": [0.3, 0.3, 0.4], "G": [5e9, 5e9, 4e9], "alpha": [0.0, 3e-5, 3e-5],
                  "k": [5.0, 0.7, 0.7], "c": 900.0}, "materials": {}}])
def test_a_body_without_such_a_stress_is_refused(change: dict[str, Any]) -> None:
    data = bar(2)
    data["bodies"]["b"] |= change
    with pytest.raises(InputError, match="no stress that is linear"):
        simulate(load(data))
