"""Tetrahedra against closed forms: patch tests, disks that spin or are heated, slab, cantilever."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import eye_array, kron
from scipy.sparse.linalg import eigsh

from cell_stress import cell_stress
from disk_fields import radial_and_hoop, rms
from sparsemor.bodies.fem import elasticity, element_matrices, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.cell_measures import edge_vectors, signed_measures
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.disk import Disk
from sparsemor.bodies.mesh.generators.pad import Pad
from sparsemor.core import DofLocations
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.plugins.linear_solvers.superlu import Splu

STEEL = Isotropic(E=200e9, nu=0.3, rho=7850, alpha=12.3e-6, k=44.5, c=475)
ALLOY = Isotropic(E=7e10, nu=0.3, rho=1000, alpha=2e-5)
RADIUS, SPEED = 0.14, 66.667


@pytest.fixture(scope="module")
def disk() -> Mesh:
    return Disk().build(Path())


@pytest.fixture(scope="module")
def stiffness(disk: Mesh) -> Csr:
    return elasticity.elastic_stiffness(disk, STEEL, 1.0, "solid")


def unknowns(nodes: IntArray, *components: int) -> IntArray:
    return np.sort((3 * np.asarray(nodes)[:, None] + np.array(components)).ravel())


def solved(mesh: Mesh, K: Csr, force: FloatArray, held: IntArray, u: FloatArray) -> FloatArray:
    """u with its values at `held` kept and the others in equilibrium."""
    free = np.setdiff1d(np.arange(len(u)), held)
    right = force[free] - K[free][:, held] @ u[held]
    x = u.copy()
    d = len(u) // len(mesh.points)
    places = DofLocations(mesh.points[free // d], free % d)
    x[free] = Splu().factorize(K[free][:, free].tocsr(), places).solve(right)
    return x


def statically_determinate(mesh: Mesh) -> IntArray:
    """3-2-1: the lowest point of the axis, one of the rim at 0 and one at 90 degrees."""
    axis, rim = mesh.point_sets["axis"][0], mesh.point_sets["rim"]
    across = rim[np.argmax(mesh.points[rim, 1] - mesh.points[rim, 2])]
    return np.sort([3 * axis, 3 * axis + 1, 3 * axis + 2, 3 * rim[0] + 1, 3 * rim[0] + 2,
                    3 * across + 2])


# ------------------------------------------------------------------ patch tests


@pytest.mark.parametrize("mesh", [Disk(refine=0.5, layers=4), BlockMesh(
    size=(1.0, 0.5, 0.3), divisions=(4, 3, 2))], ids=["disk", "block"])
def test_a_linear_field_given_at_the_surface_goes_on_inside(mesh: Disk | BlockMesh) -> None:
    m = mesh.build(Path())
    rng = np.random.default_rng(0)
    surface = np.unique(outer_facets(m))
    assert len(surface) < len(m.points)
    u = (m.points @ rng.normal(size=(3, 3)) + rng.normal(size=3)).ravel()
    K, none = elasticity.elastic_stiffness(m, STEEL, 1.0, "solid"), np.zeros(3 * len(m.points))
    start = u.copy()
    start[np.setdiff1d(np.arange(len(u)), unknowns(surface, 0, 1, 2))] = 7.0
    np.testing.assert_allclose(
        solved(m, K, none, unknowns(surface, 0, 1, 2), start), u, atol=1e-11)
    T = 300 + 50 * m.points @ rng.normal(size=3)
    start = np.where(np.isin(np.arange(len(T)), surface), T, 0.0)
    A = integrals.conductivity(m, 44.5)
    np.testing.assert_allclose(solved(m, A, 0 * T, surface, start), T, rtol=1e-12)


@pytest.mark.full
def test_matrices_of_the_elements_have_their_closed_forms() -> None:
    """B^T C B and products of shape functions, cell by cell; their sums are the matrices."""
    mesh = Pad().build(Path())
    law, n = elasticity.law(STEEL, "solid"), len(mesh.points)
    size = signed_measures(mesh.points, mesh.cells)
    inner = np.linalg.inv(edge_vectors(mesh.points, mesh.cells)).transpose(0, 2, 1)
    g = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    of_u = (3 * mesh.cells[:, :, None] + np.arange(3)).reshape(len(mesh.cells), -1)
    spread = np.einsum("eai,ebj->eaibj", g, g)
    shear = spread.transpose(0, 1, 4, 3, 2) + np.einsum("eak,ebk,ij->eaibj", g, g, np.eye(3))
    K = np.einsum("e,eaibj->eaibj", size, law.lam * spread + law.mu * shear)
    push = np.repeat((size[:, None, None] * law.beta / 4 * g).reshape(len(g), 12, 1), 4, axis=2)
    C = size[:, None, None] * 7850 * 475 * (np.ones((4, 4)) + np.eye(4)) / 20
    k = 44.5 * size[:, None, None] * (g @ g.transpose(0, 2, 1))
    for whole, rows, columns, cells, closed in (
        (elasticity.elastic_stiffness(mesh, STEEL, 1.0, "solid"), of_u, of_u,
         element_matrices.elements(
            element_matrices.stiffness, mesh, 0, rows=True, columns=True, lam=law.lam, mu=law.mu),
         K.reshape(len(g), 12, 12)),
        (elasticity.thermoelastic_coupling(mesh, STEEL, 1.0, "solid"), of_u, mesh.cells,
         element_matrices.elements(
            element_matrices.expansion, mesh, 1, rows=True, weight=law.beta), push),
        (integrals.capacity(mesh, 7850, 475), mesh.cells, mesh.cells, element_matrices.elements(
            element_matrices.mass, mesh, 2, weight=7850.0 * 475), C),
        (integrals.conductivity(mesh, 44.5), mesh.cells, mesh.cells, element_matrices.elements(
            element_matrices.conduction, mesh, 0, weight=44.5), k),
    ):
        np.testing.assert_allclose(cells, closed, atol=1e-13 * np.abs(closed).max())
        dense = np.zeros((n * (3 if rows is of_u else 1), n * (3 if columns is of_u else 1)))
        np.add.at(dense, (rows[:, :, None], columns[:, None, :]), closed)
        np.testing.assert_allclose(whole.toarray(), dense, atol=1e-13 * np.abs(dense).max())


# ------------------------------------------------------------------ surfaces


# ------------------------------------------------------------------ V1, V6: thermoelasticity


def rim_growth(mesh: Mesh, u: FloatArray) -> float:
    """Mean radial displacement of the rim without the rim's translation."""
    rim = mesh.point_sets["rim"]
    moved = u.reshape(-1, 3)[rim, :2]
    return float(np.einsum("ij,ij->i", moved - moved.mean(axis=0), mesh.points[rim, :2]).mean()
                 / RADIUS)


@pytest.mark.full
def test_spinning_disk(disk: Mesh, stiffness: Csr) -> None:
    """V6: thin disk, free faces; plane stress holds in the mean over the thickness."""
    mass = integrals.scalar_mass(disk, 7850.0)
    force = SPEED**2 * (mass @ (disk.points * [1.0, 1.0, 0.0])).ravel()
    u = solved(disk, stiffness, force, statically_determinate(disk), np.zeros(len(force)))
    assert rim_growth(disk, u) == pytest.approx(8.3768e-8, rel=4e-3)
    sigma = cell_stress(disk, STEEL, "solid", u, np.zeros(len(disk.points)))
    r, radial, hoop = radial_and_hoop(disk, sigma)
    top = 3.3 / 8 * 7850 * SPEED**2 * RADIUS**2
    assert rms(radial - top * (1 - (r / RADIUS) ** 2)) < 0.03 * top
    assert rms(hoop - top * (1 - 1.9 / 3.3 * (r / RADIUS) ** 2)) < 0.03 * top
    assert rms(sigma[:, 2, 2]) < 0.03 * top


@pytest.mark.full
def test_disk_with_parabolic_temperature(disk: Mesh, stiffness: Csr) -> None:
    dT = 100.0 * np.sum(disk.points[:, :2] ** 2, axis=1) / RADIUS**2
    force = elasticity.thermoelastic_coupling(disk, STEEL, 1.0, "solid") @ dT
    u = solved(disk, stiffness, force, statically_determinate(disk), np.zeros(len(force)))
    assert rim_growth(disk, u) == pytest.approx(8.61e-5, rel=4e-3)
    r, radial, hoop = radial_and_hoop(disk, cell_stress(disk, STEEL, "solid", u, dT))
    centre = 200e9 * 12.3e-6 * 100.0 / 4
    assert rms(radial - centre * (1 - (r / RADIUS) ** 2)) < 0.05 * centre
    assert rms(hoop - centre * (1 - 3 * (r / RADIUS) ** 2)) < 0.05 * centre


# ------------------------------------------------------------------ V4: heat


@pytest.mark.full
@pytest.mark.parametrize("length,k,rho_c,h,n,times,surface", [
    (1.25e-3, 150.0, 2.43e6, 2.5e-6, 40, (1.275e-3, 2.55e-3, 3.75e-3),
     (2.11038, 2.98455, 3.61980)),
    (0.17, 44.5, 475e3, 2e-3, 80, (1.0, 2.332, 3.73), (245.43, 374.79, 474.00)),
])
def test_slab_under_a_flux(
    length: float, k: float, rho_c: float, h: float, n: int, times: tuple[float, ...],
    surface: tuple[float, ...],
) -> None:
    """V4: the rise of the heated face of a slab that is insulated elsewhere."""
    wide = length / n
    mesh = BlockMesh(size=(wide, wide, length), divisions=(1, 1, n)).build(Path())
    C, A = integrals.capacity(mesh, rho_c, 1.0), integrals.conductivity(mesh, k)
    top = integrals.boundary_facets(mesh, mesh.point_sets["top"])
    heat = 1e6 * integrals.surface_load(mesh, top)
    step = Splu().factorize((C / h + A).tocsr())
    rise, found = np.zeros(len(mesh.points)), []
    for i in range(1, round(times[-1] / h) + 1):
        rise = step.solve(C @ rise / h + heat)
        if any(abs(i * h - t) < h / 2 for t in times):
            found.append(float(rise[mesh.point_sets["top"]].mean()))
    assert found == pytest.approx(list(surface), rel=3e-3)
    assert np.sum(C @ rise) == pytest.approx(1e6 * wide**2 * times[-1], rel=1e-10)


# ------------------------------------------------------------------ frequencies


def cantilever(n: int) -> Mesh:
    return BlockMesh(size=(1.0, 0.3, 0.2), divisions=(10 * n, 3 * n, 2 * n)).build(Path())


def frequencies(mesh: Mesh) -> FloatArray:
    """The lowest four, Hz: two of bending, torsion, and the next; x = 0 is clamped."""
    K = elasticity.elastic_stiffness(mesh, ALLOY, 1.0, "solid")
    M = kron(integrals.scalar_mass(mesh, ALLOY.rho), eye_array(3)).tocsr()
    held = unknowns(mesh.point_sets["left"], 0, 1, 2)
    return _lowest(K, M, held)


def _lowest(K: Csr, M: Csr, held: IntArray) -> FloatArray:
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    values = eigsh(K[free][:, free].tocsc(), 4, M[free][:, free].tocsc(), sigma=0,
                   v0=np.ones(len(free)), return_eigenvectors=False)
    return np.asarray(np.sqrt(np.sort(values)) / (2 * np.pi))


def quadratic(mesh: Mesh) -> FloatArray:
    """The same by scikit-fem's ten-node tetrahedra."""
    import skfem
    from skfem.helpers import ddot, dot, sym_grad, trace

    s = elasticity.law(ALLOY, "solid")
    solid = skfem.MeshTet(mesh.points.T.copy(), mesh.cells.T.copy())
    basis = skfem.Basis(solid, skfem.ElementVector(skfem.ElementTetP2()))

    @skfem.BilinearForm
    def k(u: Any, v: Any, w: Any) -> Any:
        e, f = sym_grad(u), sym_grad(v)
        return s.lam * trace(e) * trace(f) + 2 * s.mu * ddot(e, f)

    @skfem.BilinearForm
    def m(u: Any, v: Any, w: Any) -> Any:
        return ALLOY.rho * dot(u, v)

    held = basis.get_dofs(lambda x: x[0] < 1e-9).all()
    return _lowest(k.assemble(basis).tocsr(), m.assemble(basis).tocsr(), held)


@pytest.mark.full
def test_cantilever_converges_to_refined_quadratic_elements_with_order_two() -> None:
    exact = np.array([265.634, 383.742, 1122.263, 1430.669])  # `quadratic` on 20 x 6 x 4 cells
    assert ((quadratic(cantilever(1)) > exact) & (quadratic(cantilever(1)) < 1.011 * exact)).all()
    coarse, fine = (frequencies(cantilever(n)) for n in (2, 3))
    assert (fine > exact).all()  # stiffer than the body itself
    assert ((coarse - exact) / (fine - exact) > 2.0).all()  # 2.25 with order two
    assert (9 * fine - 4 * coarse) / 5 == pytest.approx(exact, rel=7e-3)
    inertia, area = 0.3 * 0.2**3 / 12, 0.3 * 0.2
    beam = 1.8751041**2 / (2 * np.pi) * np.sqrt(7e10 * inertia / (1000 * area))
    assert exact[0] == pytest.approx(beam, rel=2e-2)  # the flatter bending, Euler and Bernoulli


