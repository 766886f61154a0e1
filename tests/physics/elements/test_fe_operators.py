"""Matrix laws that hold alike in 2-D and 3-D: rigid motion, patch tests, surface integrals."""

from dataclasses import replace
from itertools import permutations
from math import factorial
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from cell_stress import cell_stress
from facet_normals import facet_normals
from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.fem.elasticity import Model
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.cell_measures import signed_measures
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.mesh import Mesh

ALLOY = Isotropic(E=7e10, nu=0.3, rho=1000, alpha=2e-5)
SHEAR = {2: np.array([[1.0, 0.3], [0.0, 0.8]]),
         3: np.array([[1.0, 0.3, 0.1], [0.0, 0.8, -0.2], [0.0, 0.0, 1.2]])}


def box() -> Mesh:
    """A unit cube in 2 x 2 x 2 cells of six tetrahedra each (Kuhn's split)."""
    n = 3
    points = np.stack(np.meshgrid(*[np.linspace(0, 1, n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    number = np.arange(n**3).reshape(n, n, n)
    corners = np.array(list(np.ndindex(2, 2, 2)))
    cells = []
    for corner in corners:
        for order in permutations(range(3)):
            path = corner + np.array([np.isin(range(3), order[:i]) for i in range(4)])
            odd = np.linalg.det(np.eye(3)[list(order)]) < 0
            cells.append(number[tuple(path[[0, 1, 3, 2] if odd else [0, 1, 2, 3]].T)])
    return Mesh(points, np.array(cells))


def skewed(d: int) -> Mesh:
    """A sheared box, so that no facet and no edge is special."""
    plane = Rectangle(size=(1.0, 1.0), divisions=(3, 4), diagonal="alternating")
    mesh = plane.build(Path()) if d == 2 else box()
    mesh = replace(mesh, points=mesh.points @ SHEAR[d].T)
    check_mesh(mesh)
    return mesh


CASES: list[tuple[int, Model]] = [(2, "plane_stress"), (2, "plane_strain"), (3, "solid")]


def random_field(mesh: Mesh, components: int) -> FloatArray:
    return np.random.default_rng(0).normal(size=(len(mesh.points), components))


@pytest.mark.parametrize("d", [2, 3])
def test_mass_holds_the_moments_of_the_volume(d: int) -> None:
    mesh = skewed(d)
    mass, one = integrals.scalar_mass(mesh, 2.5), np.ones(len(mesh.points))
    volume = float(np.linalg.det(SHEAR[d]))
    assert one @ mass @ one == pytest.approx(2.5 * volume, rel=1e-12)
    centre = SHEAR[d] @ np.full(d, 0.5)
    np.testing.assert_allclose(one @ mass @ mesh.points, 2.5 * volume * centre, rtol=1e-12)
    second = SHEAR[d] @ (np.full((d, d), 0.25) + np.eye(d) / 12) @ SHEAR[d].T
    np.testing.assert_allclose(mesh.points.T @ (mass @ mesh.points), 2.5 * volume * second,
                               rtol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_conduction_of_a_linear_temperature(d: int) -> None:
    mesh = skewed(d)
    slope = np.arange(1.0, d + 1)
    heat = integrals.conductivity(mesh, 44.5, 0.03) @ (mesh.points @ slope)
    flux = integrals.surface_normal_load(mesh, outer_facets(mesh), 0.03) @ (44.5 * slope)
    np.testing.assert_allclose(heat, flux, atol=1e-12)


@pytest.mark.parametrize("d,model", CASES)
def test_rigid_motion_costs_no_force(d: int, model: Model) -> None:
    mesh = skewed(d)
    turn = np.zeros((d, d))
    turn[0, 1], turn[1, 0] = -1.0, 1.0
    motion = (mesh.points @ turn.T + np.arange(d)).ravel()
    stiffness = elasticity.elastic_stiffness(mesh, ALLOY, 1.0, model)
    assert np.abs(stiffness @ motion).max() < 1e-12 * np.abs(stiffness).max()
    assert np.abs(stiffness - stiffness.T).max() < 1e-12 * np.abs(stiffness).max()


@pytest.mark.parametrize("d,model", CASES)
def test_constant_strain_is_held_by_boundary_tractions(d: int, model: Model) -> None:
    """K u - K_fT dT equals the traction sigma n on the boundary, and nothing inside."""
    mesh = skewed(d)
    u = (mesh.points @ np.random.default_rng(1).normal(size=(d, d))).ravel() * 1e-3
    dT = np.full(len(mesh.points), 30.0)
    sigma = cell_stress(mesh, ALLOY, model, u, dT)
    np.testing.assert_allclose(sigma, sigma[:1].repeat(len(sigma), 0), atol=1e-3)
    stiffness = elasticity.elastic_stiffness(mesh, ALLOY, 0.03, model)
    coupling = elasticity.thermoelastic_coupling(mesh, ALLOY, 0.03, model)
    traction = integrals.surface_normal_load(mesh, outer_facets(mesh), 0.03) @ sigma[0, :d, :d]
    np.testing.assert_allclose(stiffness @ u - coupling @ dT, traction.ravel(), atol=1e-5)


@pytest.mark.parametrize("d,model", CASES)
def test_coupling_integrates_a_temperature_that_varies_in_the_cell(d: int, model: Model) -> None:
    """Virtual work on a volume change: integral of beta dT div v with div v = d."""
    mesh = skewed(d)
    dT = random_field(mesh, 1)[:, 0]
    work = mesh.points.ravel() @ elasticity.thermoelastic_coupling(mesh, ALLOY, 0.03, model) @ dT
    integral = np.sum(integrals.scalar_mass(mesh, 0.03) @ dT)
    assert work == pytest.approx(d * elasticity.law(ALLOY, model).beta * integral, rel=1e-11)


def test_free_expansion_of_a_solid() -> None:
    mesh = skewed(3)
    dT = np.full(len(mesh.points), 100.0)
    force = elasticity.thermoelastic_coupling(mesh, ALLOY, 1.0, "solid") @ dT
    stiffness = elasticity.elastic_stiffness(mesh, ALLOY, 1.0, "solid")
    expected = 2e-5 * 100.0 * mesh.points
    held = np.arange(12)  # four corner points carry the exact values
    free = np.arange(12, force.size)
    u = expected.ravel()
    u[free] = spsolve(stiffness[free][:, free].tocsc(),
                      force[free] - stiffness[free][:, held] @ u[held])
    np.testing.assert_allclose(u.reshape(-1, 3), expected, atol=1e-14)
    assert np.abs(cell_stress(mesh, ALLOY, "solid", u, dT)).max() < 0.1


@pytest.mark.parametrize("d", [2, 3])
def test_closed_surface(d: int) -> None:
    mesh = skewed(d)
    facets = integrals.boundary_facets(mesh, np.arange(len(mesh.points)))
    np.testing.assert_allclose(facet_normals(mesh, facets).sum(axis=0), 0.0, atol=1e-13)
    outflow = np.sum(integrals.surface_normal_load(mesh, facets) * mesh.points)
    volume = signed_measures(mesh.points, mesh.cells).sum()
    assert outflow == pytest.approx(d * volume, rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_surface_integrals_agree_with_closed_forms(d: int) -> None:
    """Over a simplex of dimension s: integral phi_i phi_j = measure s! (1 + delta_ij) / (s + 2)!"""
    mesh = skewed(d)
    facets = outer_facets(mesh)[::2]
    n, size = len(mesh.points), integrals.facet_measures(mesh, facets)
    load, matrix, forces = np.zeros(n), np.zeros((n, n)), np.zeros((n, d))
    local = (np.ones((d, d)) + np.eye(d)) * (factorial(d - 1) / factorial(d + 1))
    for facet, area, outward in zip(facets, size, facet_normals(mesh, facets), strict=True):
        load[facet] += area / d
        forces[facet] += outward / d
        matrix[np.ix_(facet, facet)] += 7.0 * area * local
    np.testing.assert_allclose(integrals.surface_load(mesh, facets), load, atol=1e-14)
    np.testing.assert_allclose(integrals.surface_normal_load(mesh, facets), forces, atol=1e-14)
    np.testing.assert_allclose(
        integrals.surface_mass(mesh, facets, 7.0).toarray(), matrix, atol=1e-13)


def test_facets_need_a_piece_of_the_surface() -> None:
    mesh = Rectangle(size=(1.0, 1.0), divisions=(3, 3)).build(Path())
    top = integrals.boundary_facets(mesh, mesh.point_sets["top"])
    assert top.shape == (3, 2)
    np.testing.assert_allclose(facet_normals(mesh, top), [[0.0, 1 / 3]] * 3, atol=1e-15)
    with pytest.raises(InputError, match="covers a piece of the surface"):
        integrals.boundary_facets(mesh, mesh.point_sets["top_left"])


def test_model_must_suit_the_dimension() -> None:
    with pytest.raises(InputError, match="take solid") as caught:
        elasticity.elastic_stiffness(skewed(3), ALLOY, 1.0, "plane_stress")
    assert caught.value.faults[0].key == "model"
