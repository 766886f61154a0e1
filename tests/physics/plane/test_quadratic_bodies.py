"""Bodies of quadratic elements: frames, loads, joints, reduced models, export, refusals."""

from functools import cache
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor import InputError, compare, export, load, open_result, simulate
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.facets import linear_surface, outer_facets, plane_triangles
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing import check_parts
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from tiers import quick

SCENES = Path(__file__).parents[2] / "scenes"
SPACE = {
    "use": "flexible", "order": 2, "mesh": {"use": "block", "size": [0.4, 0.1, 0.06],
                                            "divisions": [2, 1, 1]},
    "material": {"E": 5e8, "nu": 0.3, "rho": 1100, "alpha": 1e-4, "k": 20, "c": 500},
    "fields": ["elastic", "thermal"], "reference": {"clamp": "left"},
}
LOADS: dict[str, Any] = {
    "weight": {"use": "gravity", "g": [0.0, 0.0, -9.81]},
    "gust": {"use": "traction", "on": ["bar:top"], "traction": [30.0, 10.0, 5.0]},
    "press": {"use": "pressure", "on": ["bar:back"], "pressure": 1e3},
    "heat": {"use": "heat_flux", "on": ["bar:top"], "flux": 1e4},
    "air": {"use": "convection", "on": ["bar:bottom"], "film": 50.0, "temperature": 280.0},
}
COLD = {"use": "prescribed_temperature", "on": ["bar:right"], "temperature": 290.0}


def tiny(**changes: Any) -> Scene:
    return load(SCENES / "tiny.yaml", {"bodies.bar.order": 2, **changes})


def in_space(**more: Any) -> Scene:
    return scene_of({
        "bodies": {"bar": SPACE},
        "joints": {"ball": {"use": "spherical", "between": ["ground", "bar:left"]}, "cold": COLD},
        "loads": LOADS, "time": {"end": 0.004, "step": 1e-3}, **more})


def the(run: March, name: str) -> FloatingBody:
    body = run.model.parts[name]
    assert isinstance(body, FloatingBody)
    return body


# ---------------------------------------------------------------------- contracts and frames

@pytest.mark.full
def test_parts_of_a_plane_scene_keep_their_laws() -> None:
    check_parts(tiny(), trials=1)


@pytest.mark.full
def test_parts_of_a_scene_in_space_keep_their_laws() -> None:
    check_parts(in_space(), trials=1)


@pytest.mark.full
@pytest.mark.parametrize("d", quick([2, 3], 2))
def test_a_rotor_blade_stretches_as_the_closed_form_says(d: int) -> None:
    """u(x) = rho w^2 (L^2 x / 2 - x^3 / 6) / E along a bar without lateral contraction."""
    L, speed, E, rho = 0.5, 60.0, 1e9, 2000.0
    mesh = ({"use": "rectangle", "lower": [0, -0.02], "size": [L, 0.04], "divisions": [4, 1]}
            if d == 2 else {"use": "block", "lower": [0, -0.02, -0.02], "size": [L, 0.04, 0.04],
                            "divisions": [4, 1, 1]})
    bar = {"use": "flexible", "order": 2, "mesh": mesh, "fields": ["elastic"],
           "material": {"E": E, "nu": 0.0, "rho": rho}, "reference": {"clamp": "left"},
           "pose": {"spin": speed if d == 2 else [0.0, 0.0, speed]}}
    hub = {"use": "revolute", "between": ["ground", "bar:left"]}
    run = march(scene_of({
        "bodies": {"bar": {**bar, "thickness": 0.04} if d == 2 else bar},
        "joints": {"hub": hub if d == 2 else {**hub, "axis": [0, 0, 1]}},
        "time": {"end": 0.02, "step": 1e-3}, "integrator": "bdf1"}))
    body = the(run, "bar")
    assert body.elasticity is not None
    u = np.zeros(d * len(body.X))
    u[body.elasticity.free] = run.block("bar.elastic")[-1]
    x = body.X[:, 0]
    rates = run.v[-1, run.model.layout["bar.rigid"]]
    spin = rates[2] if d == 2 else 2.0 * np.linalg.norm(rates[3:])  # of a unit quaternion
    assert spin == pytest.approx(speed, rel=0.03)
    want = rho * spin**2 * (L * L * x / 2 - x**3 / 6) / E
    middle = np.isclose(np.abs(body.X[:, 1:]).max(axis=1), 0.02)
    np.testing.assert_allclose(u[::d][middle], want[middle], atol=0.01 * want.max())


GLOW = {"use": "radiation", "on": ["bar:top", "bar:right"], "emissivity": 0.9,
        "surroundings": 250.0}


@pytest.mark.parametrize("kind", ["plane", "space"])
def test_radiation_of_a_quadratic_temperature_is_exact(kind: str) -> None:
    """Sum over nodes: eps sigma integral (T^4 - T_inf^4), T quadratic along x."""
    scene = tiny(**{"bodies.bar.fields": ["thermal"], "bodies.bar.frame": "fixed",
                    "bodies.bar.reference": None, "joints.pin": None, "loads": {"glow": GLOW},
                    "reducer": "full"}) if kind == "plane" else scene_of({
        "bodies": {"bar": {**SPACE, "fields": ["thermal"], "frame": "fixed"}},
        "loads": {"glow": GLOW}, "time": {"end": 1e-3, "step": 1e-3}})
    model = assemble(scene)
    body, (term,) = model.parts["bar"], model.by_part["glow"]
    assert isinstance(body, FloatingBody)
    x, low, L = body.X[:, 0], body.X[:, 0].min(), float(np.ptp(body.X[:, 0]))
    across = 0.02 if kind == "plane" else 0.1
    end = 0.02 * 0.1 if kind == "plane" else 0.1 * 0.06
    T = 300.0 + 400.0 * ((x - low) / L) ** 2
    s = np.polynomial.Polynomial([300.0, 0.0, 400.0])
    top = across * L * ((s**4).integ()(1.0) - 250.0**4)
    want = 0.9 * 5.670374419e-8 * (top + end * (700.0**4 - 250.0**4))
    zero = np.zeros(len(term.columns))
    local = T[np.searchsorted(np.arange(len(T)), term.columns - model.layout["bar.thermal"].start)]
    found = term.residual(local, zero, zero, 0.0).sum()
    assert found == pytest.approx(want, rel=1e-12)


def kirchhoff_error(columns: int) -> float:
    """Error of theta = integral of k dT, relative to its range, in steady conduction from 900 to
    300 K with k = 20 + 0.04 (T - 300) W/(m K): theta is linear along the slab."""
    slab = {"use": "flexible", "order": 2, "frame": "fixed", "fields": ["thermal"],
            "thickness": 0.02, "reference_temperature": 300.0,
            "mesh": {"use": "rectangle", "size": [0.1, 0.01], "divisions": [columns, 1]},
            "material": {"rho": 1000.0, "c": 500.0, "k": {
                "polynomial": [20.0, 0.04], "origin": 300.0, "range": [200.0, 2000.0]}}}
    held = {side: {**COLD, "on": [f"slab:{side}"], "temperature": T}
            for side, T in (("left", 900.0), ("right", 300.0))}
    run = march(scene_of({"bodies": {"slab": slab}, "joints": held,
                          "time": {"end": 4e7, "step": 1e7}}))
    body = the(run, "slab")
    assert body.heat is not None
    T = run.block("slab.thermal")[-1] - 300.0
    want = (20.0 * 600.0 + 0.02 * 600.0**2) * (1.0 - body.X[body.heat.free, 0] / 0.1)
    return float(np.abs(20.0 * T + 0.02 * T**2 - want).max() / want.max())


@pytest.mark.full
def test_conductivity_that_depends_on_temperature_follows_kirchhoff() -> None:
    coarse, fine = kirchhoff_error(10), kirchhoff_error(20)
    assert fine < 1e-5 and coarse > 4.0 * fine  # linear elements: 4e-5, a ratio of 3.4


# ---------------------------------------------------------------------- reduced models

REDUCED = {"basis": {"use": "pod", "count": 10}, "bases": {"*.thermal": {"use": "pod", "count": 7}}}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": {"use": "galerkin", **REDUCED},
    "ecsw": {"use": "ecsw", "constant": "weighted", **REDUCED},
    "deim": {"use": "deim", **REDUCED},
    "sparse": {"use": "sparse", **REDUCED, "sampler": {"use": "lhs", "required": True},
               "budgets": {"*.elastic": {"rows": 60, "atoms": 10},
                           "*.thermal": {"rows": 30, "atoms": 7}}},
}


@cache
def full() -> RunResult:
    return simulate(tiny(reducer="full"))


@pytest.mark.full
@pytest.mark.parametrize("name", REDUCERS)
def test_reduced_models_of_quadratic_bodies(name: str) -> None:
    run = simulate(tiny(reducer=REDUCERS[name]))
    errors = compare(reference=full(), run=run).errors["run"]
    assert errors["elastic"] < 1e-4 and errors["thermal"] < 1e-5 and errors["rigid"] < 1e-6
    if name == "ecsw":
        touched = run.summary["elements_touched"]
        assert 0 < touched["bar.elastic"] <= 32 and 0 < touched["bar.thermal"] < 32


# ---------------------------------------------------------------------- files, export, refusals

@pytest.mark.full
@pytest.mark.parametrize("kind, form", [("plane", "vtu"), ("space", "xdmf")])
def test_exported_cells_are_quadratic(kind: str, form: Any, tmp_path: Path) -> None:
    scene = tiny(reducer="full", **{"time.end": 0.003}) if kind == "plane" else in_space()
    run = simulate(scene, out=tmp_path / "run")
    again = open_result(tmp_path / "run")
    name = "triangle6" if kind == "plane" else "tetra10"
    assert again.cells("bar").shape[1] == {"plane": 6, "space": 10}[kind]
    done = export(again, tmp_path / form, form)
    assert done.fields["bar"] == ("displacement", "temperature")
    if form == "vtu":
        file = next((tmp_path / form / "bar").glob("*.vtu"))
        mesh = meshio.read(file)
        assert np.array_equal(mesh.cells_dict[name], run.cells("bar"))
        assert len(mesh.points) == len(run.points("bar"))
    else:
        with meshio.xdmf.TimeSeriesReader(tmp_path / form / "bar.xdmf") as reader:
            assert reader is not None
    from sparsemor.core.protocols.layout import Quantity
    from sparsemor.plugins.charts.planar_fields import deformation_figure
    from sparsemor.plugins.charts.surface_fields import surface_figures

    if kind == "plane":
        assert deformation_figure(run, Quantity.TEMPERATURE) is not None
    else:
        assert set(surface_figures(run, render=lambda _: None)) == {
            "temperature_bar", "deformation_bar"}


@pytest.mark.parametrize("linear", [
    Rectangle(size=(1.0, 0.2), divisions=(3, 2)).build(Path()),
    BlockMesh(size=(1.0, 0.2, 0.1), divisions=(2, 1, 1)).build(Path())], ids=["plane", "space"])
def test_quadratic_cells_divide_into_linear_ones(linear: Mesh) -> None:
    mesh, d = with_midpoints(linear), linear.dimension
    parts = plane_triangles(mesh.nodes) if d == 2 else linear_surface(mesh.nodes, 3)
    assert len(parts) == 4 * len(linear.cells if d == 2 else outer_facets(linear))
    a = mesh.points[parts]
    if d == 2:
        measure = np.linalg.det(a[:, 1:] - a[:, :1])
        assert measure.min() > 0.0
        assert measure.sum() == pytest.approx(2 * 0.2, rel=1e-12)
    else:  # the volume by the divergence theorem
        assert np.linalg.det(a).sum() == pytest.approx(6 * 0.02, rel=1e-12)
    assert len(linear_surface(mesh.nodes, d)) == 2 ** (d - 1) * len(outer_facets(linear))
    np.testing.assert_array_equal(linear_surface(linear.cells, d), outer_facets(linear))


@pytest.mark.parametrize("kind", ["triangle6", "tetra10"])
def test_files_of_second_order_keep_the_nodes_of_their_edges(kind: str, tmp_path: Path) -> None:
    linear = (Rectangle(size=(1.0, 0.2), divisions=(3, 2)) if kind == "triangle6" else
              BlockMesh(size=(1.0, 0.2, 0.1), divisions=(2, 1, 1))).build(Path())
    mesh = with_midpoints(linear)
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dimension)))
    for ending, sets in ((".vtu", {}), (".inp", {"left": mesh.point_sets["left"]})):
        meshio.Mesh(points, [(kind, mesh.nodes)], point_sets=sets).write(
            tmp_path / f"straight{ending}")
        found = MeshFile(path=f"straight{ending}").build(tmp_path)
        np.testing.assert_allclose(found.points, mesh.points, atol=1e-12)
        np.testing.assert_array_equal(found.nodes, mesh.nodes)
        if sets:
            np.testing.assert_array_equal(found.point_sets["left"], mesh.point_sets["left"])
    bent = points.copy()
    bent[mesh.midpoints[2, 1], 1] += 0.02
    meshio.Mesh(bent, [(kind, mesh.nodes)]).write(tmp_path / "bent.vtu")
    found = MeshFile(path="bent.vtu").build(tmp_path)
    np.testing.assert_allclose(found.points, bent[:, : mesh.dimension], atol=1e-12)
    bent[mesh.midpoints[2, 1], : mesh.dimension] += 2.0
    meshio.Mesh(bent, [(kind, mesh.nodes)]).write(tmp_path / "folded.vtu")
    notes = MeshFile(path="folded.vtu").build(tmp_path).notes
    assert any("folded over by their curved edges" in str(note) for note in notes)


def test_what_quadratic_elements_cannot_do_is_refused_at_its_option() -> None:
    with pytest.raises(InputError, match="row sums of quadratic elements") as refused:
        assemble(tiny(**{"bodies.bar.capacity": "lumped"}))
    assert refused.value.faults[0].key == "bodies.bar.capacity"
    with pytest.raises(InputError, match="order"):
        tiny(**{"bodies.bar.order": 3})


def test_a_rigid_body_of_a_mesh_has_no_order() -> None:
    one, two = (assemble(scene_of({
        "bodies": {"bar": {**SPACE, "fields": [], "reference": None, "order": order}},
        "time": {"end": 1e-3, "step": 1e-3}})).parts["bar"] for order in (1, 2))
    assert isinstance(one, FloatingBody) and isinstance(two, FloatingBody)
    np.testing.assert_array_equal(one.X, two.X)


@pytest.mark.parametrize("mesh", [
    {"use": "rectangle", "size": [1, 0.5], "divisions": [8, 4]},
    {"use": "block", "size": [1, 0.5, 0.5], "divisions": [3, 2, 2]}], ids=lambda m: m["use"])
def test_the_size_is_known_before_the_mesh_is_made(mesh: dict[str, Any]) -> None:
    plane = mesh["use"] == "rectangle"
    body = {**SPACE, "mesh": mesh, **({"thickness": 0.1} if plane else {})}
    scene = scene_of({"bodies": {"bar": body}, "time": {"end": 1e-3, "step": 1e-3}})
    plugin: Any = scene.bodies["bar"]
    told, built = plugin.expected(), plugin.build("bar", Path())
    assert built.heat is not None and built.elasticity is not None
    n, most = len(built.X), 1.0 if plane else 1.35
    assert told.mesh.points - 1 <= n <= most * told.mesh.points
    nnz = built.heat.conductivity.nnz
    held = built.heat.capacity.nnz
    assert nnz <= most * told.mesh.pairs and held <= most * told.mesh.pairs
    assert built.mass_matrix is not None and max(nnz, held) > 0.7 * told.mesh.pairs
