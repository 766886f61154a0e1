"""Centres of sets: means over facets, axes of bores, given points."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.bodies.mesh.set_centres import centre_of_set
from sparsemor.core import FloatArray, IntArray, Mesh
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.testing.in_memory_run import march, scene_of

CASES = Path(__file__).parents[2] / "support" / "cases" / "centres"
LINK = CASES / "link.msh"
"""Free tetrahedra of gmsh, mm: bores of radius 10 at x = 0 and 80, z from 0 to 8."""
AXIS = np.array([0.3, -0.2])


def angles(seed: int, count: int) -> FloatArray:
    """Angles round a circle, two thirds of them in one half, irregular."""
    rng = np.random.default_rng(seed)
    fine = 2 * count // 3
    even = np.concatenate([np.linspace(0, np.pi, fine, endpoint=False),
                           np.linspace(np.pi, 2 * np.pi, count - fine, endpoint=False)])
    return np.asarray(even + rng.uniform(-0.1, 0.1, count) * np.pi / count)


def ring(phi: FloatArray) -> Mesh:
    """Triangles between a circle of 12.5 mm and one of 20 mm about `AXIS`."""
    n, e = len(phi), np.stack([np.cos(phi), np.sin(phi)], axis=1)
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    cells = np.concatenate([np.stack([i, i + n, j], 1), np.stack([j, i + n, j + n], 1)])
    return Mesh(np.concatenate([AXIS + 0.0125 * e, AXIS + 0.02 * e]), cells, {"bore": i})


def tube(seed: int, count: int, layers: int) -> Mesh:
    """Tetrahedra between two cylinders about a slanted axis through (`AXIS`, 0.1); angles and
    heights of the inner points are irregular, the end faces plane."""
    rng, phi = np.random.default_rng(seed), angles(seed, count)
    flat = ring(phi)
    z = np.linspace(-0.01, 0.01, layers + 1) ** 3 * 1e4  # finer in the middle
    points, n = [], len(flat.points)
    for k, height in enumerate(z):
        inner = 0.0 < k < layers
        turn = 0.2 * np.pi / count * rng.uniform(-1, 1, count) * inner
        e = np.stack([np.cos(phi + turn), np.sin(phi + turn)], axis=1)
        rise = height + 1e-3 * rng.uniform(-1, 1, 2 * count) * inner / layers
        points.append(np.column_stack([np.concatenate([0.0125 * e, 0.02 * e]), rise]))
    a, b, c = np.sort(flat.cells, axis=1).T
    prisms = np.concatenate([np.stack(t, axis=1) for t in (
        (a, b, c, c + n), (a, b, b + n, c + n), (a, a + n, b + n, c + n))])
    cells = np.concatenate([prisms + k * n for k in range(layers)])
    X = np.concatenate(points) @ slant().T + [*AXIS, 0.1]
    edges = X[cells[:, 1:]] - X[cells[:, :1]]
    turned = np.linalg.det(edges) < 0
    cells[turned] = cells[turned][:, [1, 0, 2, 3]]
    inner = (np.arange(layers + 1)[:, None] * n + np.arange(count)).ravel()
    return Mesh(X, cells, {"bore": inner, "end": np.arange(n)})


def slant() -> FloatArray:
    a = np.array([0.2, -0.4, 1.0]) / np.linalg.norm([0.2, -0.4, 1.0])
    e = np.cross([0.0, 1.0, 0.0], a) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], a))
    return np.stack([e, np.cross(a, e), a], axis=1)


def nodes_mean(mesh: Mesh, name: str) -> FloatArray:
    return np.asarray(mesh.points[mesh.point_sets[name]].mean(axis=0))


@pytest.mark.parametrize("count, order", [(5, 1), (9, 2), (40, 1)])
def test_the_centre_of_an_unevenly_meshed_bore_is_its_axis(count: int, order: int) -> None:
    """Known exactly: the points lie on circles about the axis."""
    for mesh, axis in ((ring(angles(1, count)), AXIS), (tube(2, count, 3), np.array([*AXIS, 0.1]))):
        mesh = with_midpoints(mesh) if order == 2 else mesh
        assert np.linalg.norm(nodes_mean(mesh, "bore") - axis) > 1e-3
        found = centre_of_set(mesh, mesh.point_sets["bore"])
        assert np.linalg.norm(found.point - axis) < 1e-14
        assert np.linalg.norm(found.weights @ mesh.points - axis) < 1e-14
        assert found.weights.sum() == pytest.approx(1.0, abs=1e-14)
        off = set(range(len(mesh.points))) - set(mesh.point_sets["bore"].tolist())
        assert not found.weights[sorted(off)].any()
        assert found.shift < 0.5 * np.linalg.norm(nodes_mean(mesh, "bore") - axis)


def test_the_centre_of_a_round_face_is_on_the_axis_of_its_rims() -> None:
    mesh = tube(3, 12, 2)
    found = centre_of_set(mesh, mesh.point_sets["end"])
    assert np.linalg.norm(found.point - [*AXIS, 0.1] + 0.01 * slant()[:, 2]) < 1e-14
    assert "rims" in found.how


def test_bores_of_a_free_mesh_of_gmsh_are_on_their_axes() -> None:
    """Today's mean of the points is 1 to 2 mm off, the mean over the facets 0.03 to 0.1 mm."""
    mesh = MeshFile(path=str(LINK)).build(LINK.parent)
    for name, x in (("bore_a", 0.0), ("bore_b", 80.0)):
        found = centre_of_set(mesh, mesh.point_sets[name])
        assert np.linalg.norm(nodes_mean(mesh, name) - [x, 0.0, 4.0]) > 1.0
        assert 1e-2 < found.shift < 0.2
        assert np.linalg.norm(found.weights @ mesh.points - [x, 0.0, 4.0]) < 1e-9


def graded(d: int) -> Mesh:
    """The unit square or cube, finer towards the origin."""
    options = {"size": [1.0] * d, "divisions": [3] * d}
    body = {"use": "flexible", "mesh": {"use": ["rectangle", "block"][d - 2], **options},
            "fields": [], "material": {"rho": 1.0}, **({"thickness": 1.0} if d == 2 else {})}
    made: Any = assemble(scene_of({"bodies": {"b": body}, "time": {"end": 1, "step": 1}}))
    mesh: Mesh = made.parts["b"].mesh
    return Mesh(mesh.points**2, mesh.cells, dict(mesh.point_sets))


@pytest.mark.parametrize("d, order", [(2, 1), (2, 2), (3, 2)])
def test_the_mean_of_a_set_is_the_integral_over_its_domain(d: int, order: int) -> None:
    """Faces, all cells, an inner line or plane, an edge, points: the mean position is the middle,
    and with quadratic elements the mean of x^2 on a face is 1/3."""
    mesh = graded(d)
    inner = np.flatnonzero(np.abs(mesh.points[:, 0] - 1 / 9) < 1e-12)
    sets: dict[str, IntArray] = {
        "top": mesh.point_sets["top"], "all": np.arange(len(mesh.points)), "inner": inner,
        "edge": np.flatnonzero((mesh.points[:, 1:] == 0.0).all(axis=1)),
        "points": np.flatnonzero((mesh.points == 0.0).all(axis=1)
                                 | (mesh.points == 1.0).all(axis=1))}
    mesh = Mesh(mesh.points, mesh.cells, sets)
    mesh = with_midpoints(mesh) if order == 2 else mesh
    middle = np.full(d, 0.5)
    for name, where in (("all", middle), ("top", [0.5] * (d - 1) + [1.0]),
                        ("inner", [1 / 9, *middle[1:]]), ("edge", [0.5] + [0.0] * (d - 1)),
                        ("points", middle)):
        if (d, name) == (2, "top"):
            where = [0.5, 1.0]
        found = centre_of_set(mesh, mesh.point_sets[name])
        np.testing.assert_allclose(found.point, where, atol=1e-14, err_msg=name)
        np.testing.assert_allclose(found.weights @ mesh.points, where, atol=1e-14)
        assert found.shift == 0.0
    square = centre_of_set(mesh, mesh.point_sets["edge"]).weights @ mesh.points[:, 0] ** 2
    assert bool(abs(square - 1 / 3) < 1e-14) is (order == 2)


@pytest.mark.parametrize("d", [2, 3])
def test_a_given_centre_is_exact_and_keeps_linear_fields(d: int) -> None:
    mesh = graded(d)
    facets = outer_facets(mesh)
    assert len(facets)
    at = np.array([0.4, 1.0] if d == 2 else [0.4, 0.2, 1.0])
    found = centre_of_set(mesh, mesh.point_sets["top"], at)
    field = np.random.default_rng(0).normal(size=(d, d))
    np.testing.assert_allclose(found.weights @ mesh.points, at, atol=1e-14)
    np.testing.assert_allclose(found.weights @ (mesh.points @ field), at @ field, atol=1e-13)
    with pytest.raises(InputError, match=r"0\.1 m off the (line|plane)"):
        centre_of_set(mesh, mesh.point_sets["top"], at - 0.1 * np.eye(d)[d - 1])


def plate(name: str, **more: Any) -> dict[str, Any]:
    return {"use": "flexible", "thickness": 0.01, "fields": ["elastic"], "order": 2,
            "mesh": {"use": "rectangle", "size": [0.4, 0.1], "divisions": [4, 2]},
            "reference": {"clamp": "left"}, "material": {"E": 2e9, "nu": 0.3, "rho": 1000.0},
            **more}


def two_plates(sets: dict[str, Any], at: float) -> Any:
    return scene_of({
        "bodies": {"one": plate("one", sets=sets),
                   "two": plate("two", pose={"position": [0.4, at]})},
        "joints": {"pin": {"use": "revolute", "between": ["one:right", "two:left"]}},
        "probes": {"pin": {"body": "one", "at": "right"}},
        "time": {"end": 0.1, "step": 0.01}})


@pytest.mark.full
def test_joints_and_probes_are_at_a_given_centre() -> None:
    """The plates meet only where the centre is named; the probe is there too."""
    scene = two_plates({"right": {"centre": [0.4, 0.07]}}, 0.02)
    model: Any = assemble(scene)
    assert model.parts["one"].probe("pin", "right").point.tolist() == [0.4, 0.07]
    with pytest.raises(InputError) as caught:
        assemble(two_plates({}, 0.02))
    text = str(caught.value)
    assert "0.02 m apart" in text and "from the mean of its facets" not in text
    assert "centre" in text
    with pytest.raises(InputError, match="no set of this name"):
        assemble(two_plates({"rihgt": {"centre": [0.4, 0.07]}}, 0.02))
    with pytest.raises(InputError) as caught:
        assemble(two_plates({"right": {"centre": [0.3, 0.07]}}, 0.02))
    assert "sets.right.centre" in str(caught.value)


@pytest.mark.full
def test_a_four_bar_of_free_tetrahedra_closes() -> None:
    """Bores of two gmsh meshes meet the pins of a rigid crank and each other: the hinges lie on the
    axes of the bores, so the loop closes to the tolerance of a joint, and stays closed."""
    def link(**pose: Any) -> dict[str, Any]:
        return {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "bore_a"},
                "mesh": {"use": "file", "path": str(LINK), "scale": 1e-3},
                "material": {"rho": 2700, "E": 7e10, "nu": 0.33}, "pose": pose}

    pin = 0.03 * np.array([np.cos(1.0), np.sin(1.0)])
    run = march(scene_of({
        "bodies": {
            "crank": {"use": "rigid", "mass": 0.2, "inertia": [1e-5, 1e-4, 1e-4],
                      "points": {"hub": [0, 0, 0], "pin": [0.03, 0, 0]}, "pose": {"angle": 1.0}},
            "coupler": link(position=[*pin, -0.004]),
            "rocker": link(position=[pin[0] + 0.08, pin[1], -0.004], angle=-1.2)},
        "joints": {
            "O": {"use": "revolute", "between": ["ground", "crank:hub"], "axis": [0, 0, 1]},
            "A": {"use": "spherical", "between": ["crank:pin", "coupler:bore_a"]},
            "B": {"use": "revolute", "between": ["coupler:bore_b", "rocker:bore_a"],
                  "axis": [0, 0, 1]},
            "D": {"use": "revolute", "between": ["rocker:bore_b", "ground"], "axis": [0, 0, 1]}},
        "loads": {"motor": {"use": "torque", "on": "crank:hub", "torque": [0, 0, 0.5]}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "time": {"end": 0.005, "step": 1e-3}}))
    crank = run.block("crank.rigid")
    assert np.abs(crank[-1] - crank[0]).max() > 1e-3  # it moves
    coupler: Any = run.model.parts["coupler"]
    A = coupler.centre_of("bore_a", coupler.points["bore_a"]).point
    assert np.linalg.norm(A - [0.0, 0.0, 0.004]) < 1e-12
