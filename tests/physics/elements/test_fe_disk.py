"""A solid disk, spinning or heated, in plane stress: Timoshenko's closed forms to 0.2 %."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from cell_stress import cell_stress
from disk_fields import radial_and_hoop, rms
from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.mesh import Mesh

STEEL = Isotropic(E=200e9, nu=0.3, rho=7850, alpha=12.3e-6)
RADIUS, SPEED, THICKNESS, RISE = 0.14, 66.667, 0.013, 100.0
INNER, RIM = 821, 84


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """1724 triangles on 905 points: 84 on the rim, the others on a sunflower spiral."""
    k = np.arange(INNER)
    distance = RADIUS * (1 - 1.2 * np.pi / RIM) * np.sqrt((k + 0.5) / INNER)
    angle = np.concatenate([k * np.pi * (3 - np.sqrt(5)), 2 * np.pi * np.arange(RIM) / RIM])
    radius = np.concatenate([distance, np.full(RIM, RADIUS)])
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cells = Delaunay(points).simplices.astype(np.int64)
    turned = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[turned] = cells[turned][:, [0, 2, 1]]
    disk = Mesh(points, cells, {"rim": np.arange(INNER, INNER + RIM)})
    check_mesh(disk)
    assert len(cells) == 1724
    return disk


def rim_displacement(mesh: Mesh, force: FloatArray) -> tuple[FloatArray, float]:
    """Displacements (2 N,) and the mean radial one of the rim, without its rigid part."""
    centre, rim = int(np.argmin(np.linalg.norm(mesh.points, axis=1))), mesh.point_sets["rim"]
    free = np.setdiff1d(np.arange(force.size), [2 * centre, 2 * centre + 1, 2 * rim[0] + 1])
    stiffness = elasticity.elastic_stiffness(mesh, STEEL, THICKNESS)
    u = np.zeros(force.size)
    u[free] = spsolve(stiffness[free][:, free].tocsc(), force[free])
    moved = u.reshape(-1, 2)[rim]
    radial = np.einsum("ij,ij->i", moved - moved.mean(axis=0), mesh.points[rim]) / RADIUS
    return u, float(radial.mean())


def test_spinning_disk(mesh: Mesh) -> None:
    mass = integrals.scalar_mass(mesh, STEEL.rho * THICKNESS)
    u, grown = rim_displacement(mesh, (SPEED**2 * (mass @ mesh.points)).ravel())
    assert grown == pytest.approx(8.3768e-8, rel=2e-3)
    sigma = cell_stress(mesh, STEEL, "plane_stress", u, np.zeros(len(mesh.points)))
    r, radial, hoop = radial_and_hoop(mesh, sigma)
    top = 3.3 / 8 * 7850 * SPEED**2 * RADIUS**2
    assert top == pytest.approx(0.28208e6, rel=1e-4)
    assert rms(radial - top * (1 - (r / RADIUS) ** 2)) < 0.03 * top
    assert rms(hoop - top * (1 - 1.9 / 3.3 * (r / RADIUS) ** 2)) < 0.03 * top


def test_disk_with_parabolic_temperature(mesh: Mesh) -> None:
    dT = RISE * np.sum(mesh.points**2, axis=1) / RADIUS**2
    forces = elasticity.thermoelastic_coupling(mesh, STEEL, THICKNESS) @ dT
    u, grown = rim_displacement(mesh, forces)
    assert grown == pytest.approx(8.61e-5, rel=2e-3)
    r, radial, hoop = radial_and_hoop(mesh, cell_stress(mesh, STEEL, "plane_stress", u, dT))
    centre = 200e9 * 12.3e-6 * RISE / 4
    assert rms(radial - centre * (1 - (r / RADIUS) ** 2)) < 0.03 * centre
    assert rms(hoop - centre * (1 - 3 * (r / RADIUS) ** 2)) < 0.03 * centre
