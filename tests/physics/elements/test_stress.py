"""Strain and stress of stored results, against closed forms."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import export, simulate
from sparsemor.bodies.fem.stress import CellStress
from sparsemor.core.errors import InputError
from sparsemor.core.results.result_variables import FIELDS, Derived
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.charts import write_run_charts
from sparsemor.plugins.charts.animation import animate
from sparsemor.plugins.charts.fields import field_mesh, values_of

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


@pytest.mark.full
@pytest.mark.parametrize("body", [{**PLANE, "order": 2, "pose": {"angle": 0.7}}, SOLID],
                         ids=["plane", "solid"])
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


@pytest.mark.full
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
    made = CellStress(points, cells, np.array([[1.0, 1.0, 0.0, 1.0, 1.0]]), np.zeros(1, int))
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


BIMETAL = {
    "use": "flexible", "order": 2, "thickness": 0.02, "frame": "fixed",
    "mesh": {"use": "rectangle", "lower": [0.0, -0.01], "size": [0.4, 0.02],
             "divisions": [40, 4], "diagonal": "alternating"},
    "sets": {"up": {"where": "y > -1e-9"}}, "reference": {"clamp": "left"},
    "material": {"E": 2.1e11, "nu": 0.3, "rho": 7800.0, "alpha": 1.2e-5},
    "materials": {"up": {"E": 1.1e11, "nu": 0.3, "rho": 8900.0, "alpha": 1.9e-5}},
    "fields": ["elastic"], "initial_temperature": 393.15}


@pytest.mark.full
def test_stress_jumps_between_two_materials(tmp_path: Path) -> None:
    """A strip of steel and copper, 100 K warmer than stress-free: 67.3 MPa below the interface and
    -41.7 MPa above it (Timoshenko 1925, bi-metal thermostats); their mean, 12.8 MPa, is nowhere."""
    import meshio

    run = bar(tmp_path, BIMETAL, integrator="bdf1")
    tip = np.abs(run.nodal_displacement("bar", -1)[:, 1]).max()
    assert tip == pytest.approx(0.02556 * 0.4**2, rel=0.01)  # 0.02556 m with a length of 1 m
    stress, (nodes, own) = run.stress("bar", -1), run.stress_mesh("bar")
    X, count = run.points("bar"), len(run.points("bar"))
    assert nodes[:count].tolist() == list(range(count))
    assert np.array_equal(nodes[own], run.cells("bar"))
    assert np.abs(X[nodes[count:], 1]).max() < 1e-9 and len(nodes) == count + 81
    middle = np.flatnonzero((np.abs(X[nodes, 1]) < 1e-9) & (np.abs(X[nodes, 0] - 0.2) < 1e-9))
    found = np.sort(stress[middle, 0, 0])
    assert found / 1e6 == pytest.approx([-41.7, 67.3], rel=5e-3)
    copper = X[run.cells("bar")].mean(axis=1)[:, 1] > 0.0
    inner = np.abs(X[run.cells("bar")].mean(axis=1)[:, 0] - 0.2) < 0.1
    below, above = (stress[own[inner & side]][:, :, 0, 0].ravel() for side in (~copper, copper))
    assert below.max() == pytest.approx(67.3e6, rel=0.01)  # tension grows towards the interface
    assert above.min() == pytest.approx(-41.7e6, rel=0.01)
    export(run, tmp_path / "vtu", fields=["stress", "displacement"], at=[2e3])
    read = meshio.read(next((tmp_path / "vtu" / "bar").glob("*.vtu")))
    assert len(read.points) == len(read.point_data["displacement"]) == len(nodes)
    assert read.point_data["stress"] == pytest.approx(run.von_mises("bar", -1))
    assert len(export(run, tmp_path / "u", fields=["displacement"], at=[2e3]).files) == 1
    assert len(meshio.read(next((tmp_path / "u" / "bar").glob("*.vtu"))).points) == count


@pytest.mark.full
def test_pictures_show_both_sides_of_an_interface(tmp_path: Path) -> None:
    """In the plane and in space: each cell is coloured by the stress of its own material."""
    run = bar(tmp_path, BIMETAL, integrator="bdf1")
    nodes, cells, facets = field_mesh(run, "bar", Derived.STRESS)
    values = values_of(run, "bar", -1, Derived.STRESS)
    assert values is not None and len(values) == len(nodes)
    X = run.points("bar")[nodes]
    middle = (np.abs(X[cells].mean(axis=1)[:, 0] - 0.2) < 0.05)
    lower = middle & (X[cells].mean(axis=1)[:, 1] < 0.0)
    upper = middle & ~lower
    assert values[cells[lower]].max() == pytest.approx(67.3e6, rel=0.01)
    touching = (np.abs(X[cells[upper]][:, :, 1]) < 1e-9)
    assert values[cells[upper]][touching] == pytest.approx(41.7e6, rel=0.02)
    assert len(np.unique(nodes[facets], axis=0)) == len(facets)
    solid = {k: v for k, v in BIMETAL.items() if k != "thickness"} | {
        "mesh": {"use": "block", "size": [0.1, 0.02, 0.02], "divisions": [2, 2, 2]},
        "sets": {"up": {"where": "y > 0.0099"}}, "order": 1}
    (tmp_path / "solid").mkdir()
    block = bar(tmp_path / "solid", solid, integrator="bdf1")
    for one in (run, block):
        files = write_run_charts(one, tmp_path / "p", formats=["png"], fields=[Derived.STRESS])
        assert any("stress" in f.name for f in files)
    animate(block, tmp_path / "a.gif", "stress", frames=2)


@pytest.mark.full
def test_what_has_no_stress_says_so(tmp_path: Path) -> None:
    curve = {"temperatures": [200.0, 400.0], "values": [2e9, 1e9]}
    run = bar(tmp_path, {**PLANE, "material": {**PLANE["material"], "E": curve}})
    with pytest.raises(InputError, match="its material depends on temperature"):
        run.stress("bar", -1)
    with pytest.raises(InputError, match="no body of this run has stress"):
        write_run_charts(run, tmp_path / "p", fields=[FIELDS["stress"]])
    with pytest.raises(InputError, match="did not store what is needed for it"):
        export(run, tmp_path / "e", fields=["stress"])
