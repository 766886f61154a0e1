"""Static thermoelasticity against closed forms: expansion, bending, a bimetal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from cell_stress import cell_stress
from sparsemor.bodies.fem import elasticity
from sparsemor.bodies.fem.elasticity import Model
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.mesh import Mesh

ALLOY = Isotropic(E=7e10, nu=0.3, rho=1000, alpha=2e-5)


def solve(stiffness: Csr, force: FloatArray, held: IntArray) -> FloatArray:
    free = np.setdiff1d(np.arange(len(force)), held)
    u = np.zeros(len(force))
    u[free] = spsolve(stiffness[free][:, free].tocsc(), force[free])
    return u


def statically_determinate(mesh: Mesh) -> IntArray:
    """u = 0 at the bottom left corner, u_y = 0 at the bottom right one."""
    left, right = mesh.point_sets["bottom_left"][0], mesh.point_sets["bottom_right"][0]
    return np.array([2 * left, 2 * left + 1, 2 * right + 1])


def plate() -> Mesh:
    return Rectangle(size=(1.0, 0.17), divisions=(12, 4), diagonal="alternating").build(Path())


def bar(n: int) -> Mesh:
    """1 x 0.1 m about the x axis; 40 n by 4 n quads, all split the same way."""
    return Rectangle(
        lower=(0.0, -0.05), size=(1.0, 0.1), divisions=(40 * n, 4 * n), diagonal="uniform"
    ).build(Path())


def nearest(mesh: Mesh, x: float, y: float) -> int:
    return int(np.argmin(np.linalg.norm(mesh.points - [x, y], axis=1)))


@pytest.mark.parametrize("model,factor", [("plane_stress", 1.0), ("plane_strain", 1.3)])
def test_free_expansion_is_exact_and_stress_free_in_the_plane(model: Model, factor: float) -> None:
    mesh = plate()
    dT = np.full(len(mesh.points), 100.0)
    K = elasticity.elastic_stiffness(mesh, ALLOY, 0.03, model)
    force = elasticity.thermoelastic_coupling(mesh, ALLOY, 0.03, model) @ dT
    u = solve(K, force, statically_determinate(mesh))
    corner = mesh.point_sets["top_right"][0]
    np.testing.assert_allclose(u[2 * corner : 2 * corner + 2], factor * np.array([2e-3, 3.4e-4]),
                               rtol=1e-10)
    sigma = cell_stress(mesh, ALLOY, model, u, dT)
    expected = np.zeros((3, 3))
    expected[2, 2] = 0.0 if model == "plane_stress" else -7e10 * 2e-5 * 100.0
    np.testing.assert_allclose(sigma, np.broadcast_to(expected, sigma.shape), atol=1e-1)


def test_full_restraint_in_plane_stress() -> None:
    mesh = plate()
    dT = np.full(len(mesh.points), 100.0)
    sigma = cell_stress(mesh, ALLOY, "plane_stress", np.zeros(2 * len(mesh.points)), dT)
    np.testing.assert_allclose(sigma[:, [0, 1], [0, 1]], -200e6, rtol=1e-12)
    np.testing.assert_allclose(sigma[:, 2, 2], 0.0)


def test_full_restraint_in_plane_strain_is_hydrostatic() -> None:
    mesh = plate()
    dT = np.full(len(mesh.points), 100.0)
    sigma = cell_stress(mesh, ALLOY, "plane_strain", np.zeros(2 * len(mesh.points)), dT)
    pressure = 7e10 * 2e-5 * 100.0 / (1 - 2 * 0.3)
    np.testing.assert_allclose(sigma, -pressure * np.eye(3)[None].repeat(len(sigma), 0), rtol=1e-12)


def bent_tip(n: int) -> float:
    """Deflection at mid-height of the right end, held at mid-height and top of the left end."""
    mesh = bar(n)
    origin, above = nearest(mesh, 0.0, 0.0), mesh.point_sets["top_left"][0]
    force = elasticity.thermoelastic_coupling(mesh, ALLOY, 0.03) @ (1000.0 * mesh.points[:, 1])
    K = elasticity.elastic_stiffness(mesh, ALLOY, 0.03)
    u = solve(K, force, np.array([2 * origin, 2 * origin + 1, 2 * above]))
    return float(u[2 * nearest(mesh, 1.0, 0.0) + 1])


def test_linear_gradient_bends_and_converges_with_order_two() -> None:
    tips = [bent_tip(n) for n in (1, 2, 4)]
    assert [f"{tip:.3e}" for tip in tips] == ["-8.423e-03", "-9.534e-03", "-9.875e-03"]
    errors = np.abs(np.array(tips) + 0.01)
    rates = np.log2(errors[:-1] / errors[1:])
    assert np.all((rates > 1.7) & (rates < 2.1))


def bimetal_tip(n: int) -> float:
    mesh = bar(n)
    upper = mesh.points[mesh.cells][:, :, 1].mean(axis=1) > 0
    dT = np.full(len(mesh.points), 100.0)
    K = elasticity.elastic_stiffness(mesh, ALLOY, 0.03)
    force = np.zeros(2 * len(mesh.points))
    for layer, alpha in ((upper, 1e-5), (~upper, 2e-5)):
        part = replace(mesh, cells=mesh.cells[layer])
        metal = ALLOY.model_copy(update={"alpha": alpha})
        force += elasticity.thermoelastic_coupling(part, metal, 0.03) @ dT
    origin, above = nearest(mesh, 0.0, 0.0), mesh.point_sets["top_left"][0]
    u = solve(K, force, np.array([2 * origin, 2 * origin + 1, 2 * above]))
    return float(u[2 * nearest(mesh, 1.0, 0.0) + 1])


def test_bimetal_bends_as_timoshenko_has_it() -> None:
    assert [f"{bimetal_tip(n):.3e}" for n in (2, 4)] == ["7.018e-03", "7.278e-03"]
