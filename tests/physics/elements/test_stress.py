"""Strain and stress of stored results, against closed forms."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import export, simulate
from sparsemor.core.analysis.charts import write_run_charts
from sparsemor.core.errors import InputError
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stress import FIELDS, Derived, StressRecovery
from sparsemor.core.testing.in_memory_run import scene_of

E, NU, ALPHA, PULL = 2e9, 0.3, 1e-5, 3e5
PLANE = {"use": "flexible", "thickness": 0.02, "fields": ["elastic"], "frame": "fixed",
         "mesh": {"use": "rectangle", "size": [0.4, 0.1], "divisions": [4, 2]},
         "reference": {"clamp": "left"},
         "material": {"E": E, "nu": NU, "rho": 1000.0, "alpha": ALPHA}}
SOLID = {k: v for k, v in PLANE.items() if k != "thickness"} | {
    "mesh": {"use": "block", "size": [0.4, 0.1, 0.1], "divisions": [4, 1, 1]}}


def bar(tmp_path: Path, body: dict[str, Any], **more: Any) -> RunResult:
    """The bar at rest under its loads: one long damped step."""
    return simulate(scene_of({
        "bodies": {"bar": body}, "time": {"end": 2e3, "step": 1e3}, "integrator": "bdf1",
        **more}), out=tmp_path / "r")


def loaded(body: dict[str, Any]) -> dict[str, Any]:
    pull = [PULL, 0.0] + [0.0] * ("block" in str(body))
    return {"end": {"use": "traction", "on": ["bar:right"], "traction": pull}}


@pytest.mark.parametrize("body", [
    PLANE, {**PLANE, "order": 2}, {**PLANE, "pose": {"angle": 0.7}}, SOLID], ids=[
    "plane", "quadratic", "turned", "solid"])
def test_a_pulled_bar_has_its_stress_away_from_the_clamp(
    tmp_path: Path, body: dict[str, Any]
) -> None:
    run = bar(tmp_path, {**body, "material": {**PLANE["material"], "nu": 0.0}}, loads=loaded(body))
    stress, strain = run.stress("bar", -1), run.strain("bar", -1)
    want = np.zeros((3, 3))
    want[0, 0] = PULL
    assert np.abs(stress - want).max() < 1e-6 * PULL
    assert np.abs(strain - want / E).max() < 1e-6 * PULL / E
    assert run.von_mises("bar", -1) == pytest.approx(PULL, rel=1e-6)
    assert run.equivalent_strain("bar", -1) == pytest.approx(2 / 3 * PULL / E, rel=1e-6)


@pytest.mark.parametrize("model", ["plane_stress", "plane_strain"])
def test_a_free_warm_plate_has_strain_and_no_stress_in_plane_stress(
    tmp_path: Path, model: str
) -> None:
    """In plane strain it is held across the plane: -E alpha dT."""
    body = {**PLANE, "model": model, "initial_temperature": 333.15,
            "reference": {"chord": ["bottom_left", "bottom_right"]}}
    run = bar(tmp_path, body)
    across = 0.0 if model == "plane_stress" else -E * ALPHA * 40.0
    grown = ALPHA * 40.0 * (1.0 if model == "plane_stress" else 1 + NU)
    assert run.stress("bar", -1) == pytest.approx(
        np.broadcast_to(np.diag([0.0, 0.0, across]), (15, 3, 3)), abs=1e-6 * E * ALPHA * 40)
    assert run.strain("bar", -1) == pytest.approx(np.broadcast_to(np.diag(
        [grown, grown, ALPHA * 40 if across == 0.0 else 0.0]), (15, 3, 3)), abs=1e-9)


def test_quadratic_displacements_are_exact_in_quadratic_cells() -> None:
    points = np.array([[0, 0], [2, 0], [0, 1], [1, 0], [1, 0.5], [0, 0.5]], dtype=float)
    cells = np.arange(6)[None]
    u = np.stack([points[:, 0] ** 2, points[:, 0] * points[:, 1]], axis=1)
    made = StressRecovery(points, cells, np.array([[1.0, 1.0, 0.0, 1.0, 1.0]]), np.zeros(1, int))
    eps = made.strain(u, np.zeros(6))
    assert eps[:, 0, 0] == pytest.approx(2 * points[:, 0])
    assert eps[:, 1, 1] == pytest.approx(points[:, 0])
    assert eps[:, 0, 1] == pytest.approx(0.5 * points[:, 1])


@pytest.mark.full
def test_files_and_pictures_have_the_stress(tmp_path: Path) -> None:
    import meshio

    run = bar(tmp_path, {**PLANE, "pose": {"angle": np.pi / 2}}, loads=loaded(PLANE))
    done = export(run, tmp_path / "vtu", fields=["stress", "strain"], at=[2e3])
    read = meshio.read(next((tmp_path / "vtu" / "bar").glob("*.vtu")))
    assert read.point_data["stress"] == pytest.approx(run.von_mises("bar", -1))
    stress = run.stress("bar", -1)  # body x is space y
    tensor = read.point_data["stress_tensor"].reshape(-1, 3, 3)
    assert tensor[:, 1, 1] == pytest.approx(stress[:, 0, 0])
    assert tensor[:, 0, 1] == pytest.approx(-stress[:, 0, 1])
    assert done.fields == {"bar": ("stress", "strain")}
    assert "Tensor" in export(
        run, tmp_path / "xdmf", "xdmf", fields=["strain"]).files["bar"].read_text()
    files = write_run_charts(run, tmp_path / "pictures", formats=["png"], fields=[Derived.STRESS])
    assert [f.name for f in files if "stress" in f.name] == ["stress.png"]


def test_what_has_no_stress_says_so(tmp_path: Path) -> None:
    curve = {"temperatures": [200.0, 400.0], "values": [2e9, 1e9]}
    run = bar(tmp_path, {**PLANE, "material": {**PLANE["material"], "E": curve}})
    with pytest.raises(InputError, match="its material depends on temperature"):
        run.stress("bar", -1)
    with pytest.raises(InputError, match="no body of this run has stress"):
        write_run_charts(run, tmp_path / "p", fields=[FIELDS["stress"]])
    with pytest.raises(InputError, match="did not store what is needed for it"):
        export(run, tmp_path / "e", fields=["stress"])
