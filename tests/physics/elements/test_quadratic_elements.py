"""Quadratic triangles and tetrahedra: exact integrals, orders of convergence, beam theory."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from cell_stress import cell_stress
from sparsemor.bodies.fem import elasticity, element_matrices, integrals
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.mesh import Mesh

ALLOY = Isotropic(E=7e10, nu=0.3, rho=1000, alpha=2e-5)
THICKNESS = 0.03


def rectangle(nx: int, ny: int, order: int = 2, size: tuple[float, float] = (1.0, 0.1)) -> Mesh:
    mesh = Rectangle(size=size, divisions=(nx, ny), diagonal="alternating").build(Path())
    return with_midpoints(mesh) if order == 2 else mesh


def block(
    divisions: tuple[int, int, int], order: int = 2,
    size: tuple[float, float, float] = (1.0, 0.3, 0.2),
) -> Mesh:
    mesh = BlockMesh(size=size, divisions=divisions).build(Path())
    return with_midpoints(mesh) if order == 2 else mesh


MESHES = {"plane": rectangle(10, 2), "space": block((3, 2, 2))}


@pytest.fixture(params=MESHES)
def mesh(request: pytest.FixtureRequest) -> Mesh:
    return MESHES[request.param]


def on(mesh: Mesh, field: Any) -> FloatArray:
    """Nodal values of a function of the coordinates."""
    return np.asarray(field(*mesh.points.T), dtype=np.float64)


def model_of(mesh: Mesh) -> elasticity.Model:
    return "solid" if mesh.dimension == 3 else "plane_stress"


def boundary(mesh: Mesh) -> IntArray:
    """Nodes on the outline, midpoints included."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    X = mesh.points
    return np.flatnonzero((np.isclose(X, low) | np.isclose(X, high)).any(axis=1))


# ---------------------------------------------------------------------- exact integrals

def test_mass_and_inertia_are_exact(mesh: Mesh) -> None:
    size = mesh.points.max(axis=0)
    volume = float(np.prod(size))
    m = integrals.scalar_mass(mesh, 7.0)
    assert m.sum() == pytest.approx(7.0 * volume, rel=1e-13)
    found, corners = (MassProperties.of_mesh(a, x) for a, x in (
        (m, mesh.points),
        (integrals.scalar_mass(Mesh(mesh.corners, mesh.cells), 7.0), mesh.corners)))
    assert found.mass == pytest.approx(corners.mass, rel=1e-13)
    np.testing.assert_allclose(found.moment, corners.moment, rtol=1e-12)
    f, g = on(mesh, lambda x, *_: x**2), on(mesh, lambda _x, y, *_: y**2)
    assert f @ (m @ g) == pytest.approx(7.0 * volume * size[0] ** 2 * size[1] ** 2 / 9, rel=1e-12)


def test_matrices_have_the_symmetry_and_kernel_of_the_form(mesh: Mesh) -> None:
    d, model = mesh.dimension, model_of(mesh)
    K = elasticity.elastic_stiffness(mesh, ALLOY, 1.0, model)
    rigid = np.zeros((len(mesh.points), d, d * (d + 1) // 2))
    rigid[:, range(d), range(d)] = 1.0
    for k, (i, j) in enumerate([(0, 1), (1, 2), (2, 0)][: d * (d - 1) // 2]):
        rigid[:, i, d + k], rigid[:, j, d + k] = -mesh.points[:, j], mesh.points[:, i]
    assert np.abs(K @ rigid.reshape(-1, rigid.shape[2])).max() < 1e-12 * np.abs(K).max()
    for A in (K, integrals.scalar_mass(mesh, 1.0), integrals.conductivity(mesh, 1.0)):
        assert np.abs(A - A.T).max() <= 1e-14 * np.abs(A).max()
        assert ((A != 0) != (A.T != 0)).nnz == 0
        assert np.linalg.eigvalsh(A.toarray()).min() > -1e-12 * np.abs(A).max()


@pytest.mark.full
def test_assembly_by_chunks_gives_the_same_matrices(
    mesh: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    def matrices() -> list[Any]:
        model = model_of(mesh)
        return [integrals.scalar_mass(mesh, 2.0),
                elasticity.elastic_stiffness(mesh, ALLOY, 1.0, model),
                element_matrices.elements(element_matrices.conduction, mesh, 0, weight=2.0)]

    whole = matrices()
    monkeypatch.setattr(element_matrices, "CHUNK", 120)  # 30 quadratic cells
    for one, other in zip(whole, matrices(), strict=True):
        assert abs(one - other).max() <= 1e-15 * abs(one).max()


def test_heat_of_a_quadratic_temperature_is_exact(mesh: Mesh) -> None:
    """k integral |grad x^2|^2 = 4/3 k a^2 V, and no other node carries heat at a linear one."""
    size = mesh.points.max(axis=0)
    K = integrals.conductivity(mesh, 3.0)
    T = on(mesh, lambda x, *_: x**2)
    assert T @ (K @ T) == pytest.approx(3.0 * 4 / 3 * size[0] ** 2 * np.prod(size), rel=1e-12)
    inside = np.setdiff1d(np.arange(len(mesh.points)), boundary(mesh))
    linear = on(mesh, lambda x, y, *_: 2 * x - 3 * y)
    assert np.abs((K @ linear)[inside]).max() < 1e-13 * np.abs(K).max()


def test_surface_integrals_are_consistent(mesh: Mesh) -> None:
    size = mesh.points.max(axis=0)
    right = integrals.boundary_facets(mesh, mesh.point_sets["right"])
    area = float(np.prod(size[1:]))
    y2 = on(mesh, lambda _x, y, *_: y**2)
    load = integrals.surface_load(mesh, right, 2.0)
    assert load.sum() == pytest.approx(2.0 * area, rel=1e-13)
    assert load @ y2 == pytest.approx(2.0 * area * size[1] ** 2 / 3, rel=1e-13)
    assert set(np.flatnonzero(np.abs(load) > 1e-12 * area)) <= set(mesh.point_sets["right"])
    film = integrals.surface_mass(mesh, right, 5.0)
    assert y2 @ (film @ y2) == pytest.approx(5.0 * area * size[1] ** 4 / 5, rel=1e-13)
    normal = integrals.surface_normal_load(mesh, right)
    np.testing.assert_allclose(normal.sum(axis=0), [area, *[0.0] * (mesh.dimension - 1)],
                               atol=1e-15)
    whole = integrals.surface_normal_load(mesh, outer_facets(mesh))
    assert np.abs(whole.sum(axis=0)).max() < 1e-15  # a closed surface
    assert np.sum(whole * mesh.points) == pytest.approx(mesh.dimension * np.prod(size), rel=1e-13)


def test_free_expansion_has_no_stress(mesh: Mesh) -> None:
    """Temperature linear in space: u is quadratic, K u = K_fT dT to round-off."""
    d, model = mesh.dimension, model_of(mesh)
    K = elasticity.elastic_stiffness(mesh, ALLOY, 1.0, model)
    F = elasticity.thermoelastic_coupling(mesh, ALLOY, 1.0, model)
    x, y, z = (*mesh.points.T, np.zeros(len(mesh.points)))[:3]
    dT = 40.0 + 300.0 * x  # strain alpha dT; the shears vanish with u_x - alpha b (y^2 + z^2) / 2
    a, b = 40.0 * ALLOY.alpha, 300.0 * ALLOY.alpha
    u = np.stack([a * x + b * (x * x - y * y - z * z) / 2, (a + b * x) * y, (a + b * x) * z], 1)
    u = np.ascontiguousarray(u[:, :d])
    off = K @ u.ravel() - F @ dT
    assert np.abs(off).max() < 1e-12 * np.abs(F @ dT).max()
    assert np.abs(cell_stress(mesh, ALLOY, model, u.ravel(), dT)).max() < 1e-3


def test_pure_bending_is_exact_with_one_element_over_the_height() -> None:
    """Plane stress, moment M: u = M/(E I) (x y, -(x^2 + nu y^2) / 2); energy M^2 L / (2 E I)."""
    mesh = rectangle(3, 1)
    K = elasticity.elastic_stiffness(mesh, ALLOY, THICKNESS)
    x, y = mesh.points[:, 0], mesh.points[:, 1] - 0.05
    u = 1e-3 * np.stack([x * y, -(x * x + 0.3 * y * y) / 2], axis=1).ravel()
    inertia = THICKNESS * 0.1**3 / 12
    assert u @ (K @ u) == pytest.approx(7e10 * inertia * 1e-6, rel=1e-10)
    ends = np.isclose(x, 0.0) | np.isclose(x, 1.0)
    forces = (K @ u).reshape(-1, 2)
    assert np.abs(forces[~ends]).max() < 1e-10 * np.abs(forces).max()


# ---------------------------------------------------------------------- orders of convergence

def basis_of(mesh: Mesh) -> Any:
    """Basis of scikit-fem on the same corners, with quadrature of degree 8."""
    import skfem

    kind, elements = ((skfem.MeshTri, (skfem.ElementTriP1, skfem.ElementTriP2)),
                      (skfem.MeshTet, (skfem.ElementTetP1, skfem.ElementTetP2)))[mesh.dimension - 2]
    corners = kind(mesh.corners.T.copy(), mesh.cells.T.copy(), sort_t=False)
    return skfem.Basis(corners, elements[mesh.order - 1](), intorder=8)


def heat_errors(mesh: Mesh) -> tuple[float, float]:
    """L2 and energy error of -div grad T = f on the unit square or cube, T = prod sin(pi x_i)."""
    import skfem

    d, basis = mesh.dimension, basis_of(mesh)

    def exact(x: Any) -> Any:
        return np.prod(np.sin(np.pi * x), axis=0)

    f = skfem.LinearForm(lambda v, w: d * np.pi**2 * exact(w.x) * v).assemble(basis)
    K = integrals.conductivity(mesh, 1.0)
    free = np.setdiff1d(np.arange(len(mesh.points)), boundary(mesh))
    T = np.zeros(len(mesh.points))
    T[free] = spsolve(K[free][:, free].tocsc(), f[free])
    far = basis.interpolate(T)
    slopes = [np.pi * np.cos(np.pi * basis.global_coordinates()[i])
              * np.prod(np.delete(np.sin(np.pi * np.asarray(basis.global_coordinates())), i, 0), 0)
              for i in range(d)]
    away = float(np.sum((np.asarray(far) - exact(np.asarray(basis.global_coordinates()))) ** 2
                        * basis.dx))
    steep = sum(float(np.sum((far.grad[i] - slopes[i]) ** 2 * basis.dx)) for i in range(d))
    return float(np.sqrt(away)), float(np.sqrt(steep))


@pytest.mark.full
@pytest.mark.parametrize(("order", "rates"), [(1, (2.0, 1.0)), (2, (3.0, 2.0))])
def test_heat_converges_with_the_order_plus_one(order: int, rates: tuple[float, float]) -> None:
    plane = np.array([heat_errors(rectangle(n, n, order, (1.0, 1.0))) for n in (8, 16)])
    np.testing.assert_allclose(np.log2(plane[0] / plane[1]), rates, atol=0.12)
    space = np.array([heat_errors(block((n, n, n), order, (1.0, 1.0, 1.0))) for n in (4, 8)])
    np.testing.assert_allclose(np.log2(space[0] / space[1]), rates, atol=0.25)


def deflection(mesh: Mesh) -> float:
    """Tip deflection, m, of a cantilever 1 x 0.1 x 0.03 m under 1 kN of shear at its end."""
    K = elasticity.elastic_stiffness(mesh, ALLOY, THICKNESS)
    force = np.zeros((len(mesh.points), 2))
    right = mesh.point_sets["right"]
    force[:, 1] = 1e3 / (0.1 * THICKNESS) * integrals.surface_load(
        mesh, integrals.boundary_facets(mesh, right), THICKNESS)
    held = mesh.point_sets["left"]
    free = np.setdiff1d(np.arange(K.shape[0]), [2 * held, 2 * held + 1])
    u = np.zeros(K.shape[0])
    u[free] = spsolve(K[free][:, free].tocsc(), force.ravel()[free])
    return float(u[2 * right + 1].mean())


def test_a_cantilever_bends_as_the_beam_does() -> None:
    """Timoshenko: F L^3 / (3 E I) + F L / (k G A), k = 5/6, less what the clamp stiffens: with
    refined quadratic elements 1.9162 mm. One element over the height is within 1 %; linear ones
    are still 4 % too stiff with eight."""
    inertia, area, G = THICKNESS * 0.1**3 / 12, 0.1 * THICKNESS, 7e10 / 2.6
    beam = 1e3 / (3 * 7e10 * inertia) + 1e3 / (5 / 6 * G * area)
    settled = 1.9162e-3
    assert settled == pytest.approx(beam, rel=2e-3)
    errors = [1.0 - deflection(rectangle(10 * n, n)) / settled for n in (1, 2, 4)]
    assert 0.0 < errors[0] < 1e-2 and errors[0] > 4 * errors[1] > 12 * errors[2] > 0.0
    linear = [1.0 - deflection(rectangle(10 * n, n, 1)) / settled for n in (1, 8)]
    assert linear[0] > 0.7 and 0.03 < linear[1] < 0.05


# ---------------------------------------------------------------------- sets

def test_sets_contain_the_midpoints_of_their_surface(mesh: Mesh) -> None:
    for name, axis in (("left", 0), ("right", 0)):
        edge = mesh.points[:, axis].min() if name == "left" else mesh.points[:, axis].max()
        np.testing.assert_array_equal(
            mesh.point_sets[name], np.flatnonzero(np.isclose(mesh.points[:, axis], edge)))


def test_an_edge_through_the_body_is_in_no_set_of_its_surface() -> None:
    """One element over the height: the two ends of a diagonal are on top and bottom. A set of all
    corners contains all nodes."""
    linear = Rectangle(size=(1.0, 0.1), divisions=(4, 1)).build(Path())
    ends = np.array([2, 5])  # from the bottom of the first column to the top of the next
    np.testing.assert_allclose(np.diff(linear.points[ends], axis=0), [[0.25, 0.1]])
    every = np.arange(len(linear.points))
    mesh = with_midpoints(Mesh(linear.points, linear.cells, {"ends": ends, "all": every}))
    np.testing.assert_array_equal(mesh.point_sets["ends"], ends)
    assert len(mesh.point_sets["all"]) == len(mesh.points)


