"""Natural frequencies of a cantilever 1 x 0.1 m against beam and rod theory."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import eye_array, kron
from scipy.sparse.linalg import eigsh

from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.arrays import FloatArray

ALLOY = Isotropic(E=7e10, nu=0.3, rho=1000)
THICKNESS = 0.03


def frequencies(nx: int, ny: int) -> FloatArray:
    """The lowest four, Hz; the left end is clamped."""
    mesh = Rectangle(size=(1.0, 0.1), divisions=(nx, ny), diagonal="uniform").build(Path())
    stiffness = elasticity.elastic_stiffness(mesh, ALLOY, THICKNESS)
    mass = kron(integrals.scalar_mass(mesh, ALLOY.rho * THICKNESS), eye_array(2)).tocsr()
    clamped = mesh.point_sets["left"]
    free = np.setdiff1d(np.arange(mass.shape[0]), [2 * clamped, 2 * clamped + 1])
    values = eigsh(
        stiffness[free][:, free].tocsc(), 4, mass[free][:, free].tocsc(), sigma=0,
        v0=np.ones(len(free)), return_eigenvectors=False,
    )
    return np.asarray(np.sqrt(np.sort(values)) / (2 * np.pi))


@pytest.fixture(scope="module")
def coarse() -> FloatArray:
    return frequencies(80, 8)


@pytest.fixture(scope="module")
def fine() -> FloatArray:
    return frequencies(160, 16)


def test_tabled_values(coarse: FloatArray, fine: FloatArray) -> None:
    assert coarse[:2] == pytest.approx([137.884, 826.74], rel=1e-5)
    assert fine[:2] == pytest.approx([135.181, 810.86], rel=1e-5)


def test_bending_converges_to_plane_elasticity(coarse: FloatArray, fine: FloatArray) -> None:
    plane = np.array([134.264, 805.46])  # quadratic elements
    assert np.all((coarse[:2] - plane) / (fine[:2] - plane) > 3.5)


def test_first_bending_frequency_is_near_the_slender_beam(fine: FloatArray) -> None:
    beta, inertia, area = 1.8751041, 0.03 * 0.1**3 / 12, 0.03 * 0.1
    beam = beta**2 / (2 * np.pi) * np.sqrt(7e10 * inertia / (1000 * area))
    assert beam == pytest.approx(135.154, rel=1e-5)
    assert fine[0] == pytest.approx(beam, rel=1e-2)


def test_axial_frequency(fine: FloatArray) -> None:
    rod = np.sqrt(7e10 / 1000) / 4
    assert rod == pytest.approx(2091.65, rel=1e-5)
    assert fine[2] == pytest.approx(rod, rel=2e-3)
