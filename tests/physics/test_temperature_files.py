"""Temperatures of another code, from files: series of VTU files that a run exports, tables, whole
bodies whose temperature is known, reduced and kept models."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, reduce, simulate
from sparsemor.core.errors import InputError
from sparsemor.plugins.export import export

L = 0.2
STEEL = {"rho": 7800.0, "k": 40.0, "c": 500.0, "E": 2.0e11, "nu": 0.3, "alpha": 1.2e-5}
PLANE = {"use": "rectangle", "size": [L, 0.04], "divisions": [10, 3]}
SPACE = {"use": "block", "size": [L, 0.04, 0.03], "divisions": [6, 2, 1]}


def bar(mesh: dict[str, Any], fields: list[str], **more: Any) -> dict[str, Any]:
    body = {"use": "flexible", "mesh": mesh, "fields": fields, "frame": "fixed", "material": STEEL,
            "reference": {"clamp": "left"}, "sets": {"end": {"nearest": [L, 0.0, 0.0][
                : len(mesh["size"])]}}}
    if "elastic" not in fields:
        del body["reference"]
    if mesh["use"] == "rectangle":
        body["thickness"] = 0.03
    return {"format": 1, "bodies": {"b": body}, "reducer": "full", "integrator": "bdf1",
            "time": {"end": 100.0, "step": 5.0}, **more}


def table(path: Path, X: np.ndarray, times: list[float], T: Any) -> None:
    """A csv file of T(X, t) at points X."""
    names = ["x", "y", "z"][: X.shape[1]]
    rows = [",".join([*names, *map(str, times)])]
    rows += [",".join(map(repr, [*map(float, x), *(float(T(x, t)) for t in times)])) for x in X]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.full
def test_a_run_goes_on_from_the_files_of_another(tmp_path: Path) -> None:
    """Heat flows in from the right in one run, whose end temperatures over time, exported as VTU
    files, heat the body of a second one with another mesh: the same temperatures inside."""
    first = simulate(load(bar(SPACE, ["thermal"], loads={
        "flame": {"use": "heat_flux", "on": ["b:right"], "flux": 2e5}})))
    export(first, tmp_path / "one", "vtu", fields=["temperature"])
    (tmp_path / "scene.yaml").write_text("", encoding="utf-8")
    again = load(bar(SPACE, ["thermal"], joints={"hot": {
        "use": "prescribed_temperature", "on": ["b:right"],
        "field": {"path": str(tmp_path / "one" / "b.pvd")}}}))
    second = simulate(again)
    assert np.ptp(first.nodal_temperature("b", -1)) > 50.0
    for step in (1, 10, -1):
        assert np.allclose(first.nodal_temperature("b", step),
                           second.nodal_temperature("b", step), rtol=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("mesh", [PLANE, SPACE])
def test_a_body_whose_temperature_is_known_expands(tmp_path: Path, mesh: dict[str, Any]) -> None:
    """T = 293.15 K + 100 K x t / (L 100 s) in the whole body, at points that are no nodes and in
    degrees Celsius: the end moves by alpha L 50 K at t = 100 s, and far from the clamp there is
    no stress."""
    d = len(mesh["size"])
    rng = np.random.default_rng(3)
    X = rng.uniform(-0.005, 1.0, (400, d)) * np.array([1.05 * L, 0.045, 0.035][:d])
    table(tmp_path / "t.csv", X * 1e3, [0.0, 50.0, 100.0], lambda x, t: 20.0 + x[0] / 2 * t / 100)
    scene = bar(mesh, ["elastic", "thermal"], joints={"known": {
        "use": "prescribed_temperature", "on": ["b"],
        "field": {"path": str(tmp_path / "t.csv"), "unit": "degC", "scale": 1e-3}}},
        probes={"end": {"body": "b", "at": "end"}}, time={"end": 125.0, "step": 25.0})
    scene["bodies"]["b"]["order"] = 2
    run = simulate(load(scene))
    x = run.points("b")[:, 0]
    for step, share in ((1, 0.25), (2, 0.5), (4, 1.0), (5, 1.0)):
        want = 293.15 + 100 * x / L * share
        assert np.allclose(run.nodal_temperature("b", step), want, rtol=1e-9)
    assert run.probe("end")[-1, d] == pytest.approx(1.2e-5 * 50 * L, rel=0.02)
    free = run.von_mises("b", -1)[x > 0.7 * L]
    assert free.max() < 1e-3 * 2e11 * 1.2e-5 * 100
    assert any("m from the nearest point" in n for n in run.summary["information"])


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["sparse", "deim"])
def test_reduced_and_kept_models(tmp_path: Path, reducer: str) -> None:
    """A field of two shapes over time is two columns of a reduced model, whatever the nodes."""
    X = np.stack(np.meshgrid([L], np.linspace(0, 0.04, 9), indexing="ij"), axis=-1).reshape(-1, 2)
    table(tmp_path / "t.csv", X, [0.0, 40.0, 100.0],
          lambda x, t: 293.15 + t * (0.2 + 8.0 * x[1]) + 1e-3 * t * t)
    scene = load(bar(PLANE, ["elastic", "thermal"], joints={"hot": {
        "use": "prescribed_temperature", "on": ["b:right"],
        "field": {"path": str(tmp_path / "t.csv")}}}))
    full = simulate(scene)
    small = scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 8}}})
    model = reduce(small)
    for run in (simulate(small), model.run()):
        T = run.nodal_temperature("b", -1)
        assert np.abs(T - full.nodal_temperature("b", -1)).max() < 1e-4 * 50.0
        u = full.nodal_displacement("b", -1)
        assert np.abs(run.nodal_displacement("b", -1) - u).max() < 1e-3 * np.abs(u).max()


@pytest.mark.full
def test_a_start_from_a_file(tmp_path: Path) -> None:
    X = np.random.default_rng(1).uniform(0, 1, (200, 2)) * [L, 0.04]
    np.savez(tmp_path / "t.npz", points=X, times=[0.0], temperature=[300 + 200 * X[:, 0]])
    scene = bar(PLANE, ["thermal"])
    scene["bodies"]["b"]["initial_temperature"] = {"path": str(tmp_path / "t.npz")}
    run = simulate(load(scene))
    assert np.allclose(run.nodal_temperature("b", 0), 300 + 200 * run.points("b")[:, 0], rtol=1e-9)


@pytest.mark.parametrize(("field", "message"), [
    ({"path": "none.csv"}, "there is no file"),
    ({"path": "t.txt"}, "is none of"),
    ({"path": "t.csv", "scale": 10.0}, "give its length unit"),
    ({"path": "t.csv", "unit": "degC", "distance": 1e-9}, "farther than"),
    ({"path": "bad.csv"}, "do not increase"),
    ({"path": "bad.npz"}, "cannot be read"),
])
def test_bad_files_are_refused(
    tmp_path: Path, field: dict[str, Any], message: str
) -> None:
    X = np.random.default_rng(1).uniform(0, 1, (30, 2)) * [L, 0.04]
    (tmp_path / "t.txt").touch()
    np.savez(tmp_path / "bad.npz", points=X)
    table(tmp_path / "t.csv", X, [0.0, 1.0], lambda x, t: 300.0)
    table(tmp_path / "bad.csv", X, [1.0, 1.0], lambda x, t: 300.0)
    field = {**field, "path": str(tmp_path / field["path"])}
    with pytest.raises(InputError, match=message):
        simulate(load(bar(PLANE, ["thermal"], joints={"hot": {
            "use": "prescribed_temperature", "on": ["b:right"], "field": field}})))
