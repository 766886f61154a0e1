"""Bodies of quadratic elements: laws of their parts, radiation, files, refusals."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor import InputError, load
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.facets import linear_surface, outer_facets, plane_triangles
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing import check_parts
from sparsemor.core.testing.in_memory_run import scene_of

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


@pytest.mark.full
def test_parts_of_a_plane_scene_keep_their_laws() -> None:
    check_parts(tiny(), trials=1)


@pytest.mark.full
def test_parts_of_a_scene_in_space_keep_their_laws() -> None:
    check_parts(in_space(), trials=1)


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


# ---------------------------------------------------------------------- files, export, refusals


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
