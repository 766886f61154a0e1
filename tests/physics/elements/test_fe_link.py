"""The heated link of the double pendulum: inertia, vibration, temperature and thermal shape."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import eye_array, kron
from scipy.sparse.linalg import eigsh, splu

from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.link import Link
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.mesh import Mesh

MATERIAL = Isotropic(E=7e10, nu=0.3, rho=1000, alpha=2e-5, k=44.5, c=475)
THICKNESS, START, STEP = 0.03, 293.15, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Chord:
    """The link with u = 0 at chord_a and u_y = 0 at chord_b."""

    mesh: Mesh
    mass: Csr
    stiffness: Csr
    free: IntArray


@pytest.fixture(scope="module")
def link() -> Chord:
    mesh = Link().build(Path())
    a, b = mesh.point_sets["chord_a"][0], mesh.point_sets["chord_b"][0]
    free = np.setdiff1d(np.arange(2 * len(mesh.points)), [2 * a, 2 * a + 1, 2 * b + 1])
    stiffness = elasticity.elastic_stiffness(mesh, MATERIAL, THICKNESS)[free][:, free]
    mass = integrals.scalar_mass(mesh, MATERIAL.rho * THICKNESS)
    return Chord(mesh, mass, stiffness.tocsc(), free)


@pytest.fixture(scope="module")
def rises(link: Chord) -> dict[float, FloatArray]:
    """Temperature rises (K) at four times (s): 1e6 W/m2 on the upper edge, implicit Euler."""
    capacity = integrals.capacity(link.mesh, 1000.0, 475.0, THICKNESS)
    facets = integrals.boundary_facets(link.mesh, link.mesh.point_sets["top"])
    heat = 1e6 * integrals.surface_load(link.mesh, facets, THICKNESS)
    solver = splu((capacity / STEP + integrals.conductivity(link.mesh, 44.5, THICKNESS)).tocsc())
    rise, found = np.zeros(len(link.mesh.points)), {}
    for n in range(1, 4001):
        rise = solver.solve(capacity @ rise / STEP + heat)
        if n in (1000, 2332, 3730, 4000):
            found[n / 1000] = rise
    return found


def test_inertia(link: Chord) -> None:
    weights = link.mass @ np.ones(len(link.mesh.points))
    mass = weights.sum()
    centre = weights @ link.mesh.points / mass
    about = link.mesh.points - centre
    assert mass == pytest.approx(5.6287, abs=5e-5)
    np.testing.assert_allclose(centre, [0.5, 0.0], atol=1e-12)
    assert np.sum(about * (link.mass @ about)) == pytest.approx(0.610181, abs=5e-7)


def test_frequencies_in_the_chord_frame(link: Chord) -> None:
    mass = kron(link.mass, eye_array(2)).tocsr()[link.free][:, link.free].tocsc()
    values = eigsh(link.stiffness, 3, mass, sigma=0, v0=np.ones(len(link.free)),
                   return_eigenvectors=False)
    hertz = np.sqrt(np.sort(values)) / (2 * np.pi)
    assert [round(float(f)) for f in hertz] == [730, 1652, 2450]


@pytest.mark.full
def test_highest_temperature(rises: dict[float, FloatArray]) -> None:
    highest = [START + float(rises[t].max()) for t in (1.0, 2.332, 3.73, 4.0)]
    assert highest == pytest.approx([535.45, 666.14, 765.89, 782.81], abs=0.01)


@pytest.mark.parametrize(
    "t,largest,middle",
    [(1.0, 9.28e-4, 8.71e-4), (2.332, 2.02e-3, 1.92e-3), (3.73, 3.08e-3, 2.94e-3)],
)
def test_thermal_shape(
    link: Chord, rises: dict[float, FloatArray], t: float, largest: float, middle: float
) -> None:
    u = np.zeros(2 * len(link.mesh.points))
    force = elasticity.thermoelastic_coupling(link.mesh, MATERIAL, THICKNESS) @ rises[t]
    u[link.free] = splu(link.stiffness).solve(force[link.free])
    size = np.linalg.norm(u.reshape(-1, 2), axis=1)
    assert size.max() == pytest.approx(largest, rel=2e-3)
    np.testing.assert_allclose(link.mesh.points[size.argmax()], [1.085, 0.085])
    centre = np.argmin(np.linalg.norm(link.mesh.points - [0.5, 0.085], axis=1))
    assert u[2 * centre + 1] == pytest.approx(middle, rel=3e-3)
