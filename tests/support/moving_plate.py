"""A plate under a pressure that moves and heats it: its blocks, and its full-order run."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, eye_array, kron
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core import BlockData
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.load_tables import LoadTable, Table, path_rows, ring
from sparsemor.core.protocols.mesh import Mesh

ALLOY = Isotropic(E=70.006e9, nu=0.3, rho=2700, alpha=23.8e-6, k=150, c=900)
THICKNESS = 1.25e-3
STEP, STEPS = 1.5e-5, 220
"""s; the contact passes over most of the plate."""


@cache
def mesh() -> Mesh:
    return Rectangle(size=(5e-3, 1.25e-3), divisions=(24, 6), diagonal="alternating").build(Path())


def pushes(x: FloatArray, speed: float) -> FloatArray:
    """(T, j) N: a pressure that grows linearly over 1.1 mm, at nodes x (j,) of the surface."""
    found = np.zeros((STEPS + 1, len(x)))
    for n in range(1, STEPS + 1):
        at = 0.1e-3 + speed * STEP * n + 1.1e-3 * (np.arange(300) + 0.5) / 300
        p = 22e6 * (np.arange(300) + 0.5) / 300 * 1.1e-3 / 300 * THICKNESS
        hats = np.maximum(0.0, 1.0 - np.abs(at - x[:, None]) / (x[1] - x[0]))
        found[n] = hats @ p
    return found


@cache
def plate(speed: float = 1.0) -> tuple[BlockData, BlockData]:
    """Displacements and temperatures: the bottom is held, heat goes in with friction 0.2."""
    m, N = mesh(), len(mesh().points)
    top = m.point_sets["top"]
    W, times = pushes(m.points[top, 0], speed), STEP * np.arange(STEPS + 1)
    C = integrals.capacity(m, 2700, 900, THICKNESS)
    one = csr_array((np.ones(len(top)), (top, np.arange(len(top)))), shape=(N, len(top)))
    heat_in = LoadTable("sole", one, tuple(f"sole, node {i}" for i in top),
                        Table(times, 0.1 * speed * W))
    heat = _data("plate.thermal", C, integrals.conductivity(m, 150, THICKNESS), m.points,
                 np.zeros(N, dtype=np.int64), heat_in, (0.0, 1 / STEP))
    free = np.setdiff1d(np.arange(2 * N), np.ravel([2 * m.point_sets["bottom"],
                                                    2 * m.point_sets["bottom"] + 1]))
    K, M = (csr_array(A)[free][:, free] for A in (
        elasticity.elastic_stiffness(m, ALLOY, THICKNESS, "plane_strain"),
        kron(integrals.scalar_mass(m, 2700 * THICKNESS), eye_array(2))))
    both = csr_array(kron(one, eye_array(2)))[free]
    push = LoadTable("sole", both, tuple(f"sole, node {i}, {c}" for i in top for c in "xy"),
                     Table(times, np.stack([0.2 * W, -W], axis=2).reshape(STEPS + 1, -1)))
    data = _data("plate.elastic", M, K, np.repeat(m.points, 2, axis=0)[free],
                 (np.arange(2 * N) % 2)[free], push, (1 / STEP, 1 / STEP**2))
    thermal = elasticity.thermoelastic_coupling(m, ALLOY, THICKNESS, "plane_strain")
    coupling = csr_array(thermal)[free]
    return replace(data, coupling=coupling, heat=heat), heat


def _data(
    name: str, mass: Csr, stiffness: Csr, places: FloatArray, component: IntArray,
    load: LoadTable, factors: tuple[float, float],
) -> BlockData:
    n = mass.shape[0]
    return BlockData(
        name, np.zeros((n, 0)), mass, stiffness, places, component, np.zeros((n, 0)),
        order=2 if component.any() else 1, start=np.zeros(n), moving=(load,), factors=factors,
        step=STEP,
        ring=ring(mass, stiffness, places, path_rows((load,))))


def given(data: BlockData) -> FloatArray:
    """(T, n) the moving load."""
    (load,) = data.moving
    return np.asarray((load.columns @ load.table.values.T).T)


def run(data: BlockData, force: FloatArray, atoms: FloatArray) -> FloatArray:
    """(n, T) implicit Euler from rest, projected on atoms (n, k)."""
    first = data.factors[0] == 0.0
    A, F, h = atoms, force @ atoms, STEP
    D, M = A.T @ (data.operator @ A), A.T @ (data.mass @ A)
    inverse, c, v, out = np.linalg.inv(D), np.zeros(A.shape[1]), np.zeros(A.shape[1]), []
    for f in F:
        past = M @ c / h if first else M @ (c / h**2 + v / h)
        new = inverse @ (f + past) if out else c
        v, c = (new - c) / h, new
        out.append(c)
    return np.asarray(A @ np.array(out).T)


@cache
def full(speed: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """u and T (n, steps + 1), by factors of the whole operators."""
    data, heat = plate(speed)
    found = []
    for block in (heat, data):
        force = given(block)
        if found:
            force = force + np.asarray(data.coupling @ found[0]).T
        factor, h = splu(block.operator.tocsc()), STEP
        x, v, out = np.zeros(block.size), np.zeros(block.size), [np.zeros(block.size)]
        for f in force[1:]:
            past = x / h if block is heat else x / h**2 + v / h
            new = factor.solve(f + block.mass @ past)
            v, x = (new - x) / h, new
            out.append(x)
        found.append(np.array(out).T)
    return found[1], found[0]


def error(got: FloatArray, want: FloatArray) -> float:
    size = np.linalg.norm(want, axis=0).max()
    return float(np.linalg.norm(got - want, axis=0).max() / size)
