"""Checks of matrices that belong to a body: definite, free of supports, connected, in SI units."""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.matrices.displacement_unknowns import Unknowns
from sparsemor.bodies.matrices.matrix_body import ROUND_OFF, motion_error
from sparsemor.bodies.mesh.mesh_checks_and_repairs import HEAVY, LARGEST, some
from sparsemor.core import BoolArray, Csr, FloatArray, InputError, IntArray, Note

__all__ = ["check_forces", "check_mechanical", "check_thermal", "moment_notes", "size_notes",
           "some"]
LEAST = 1.0
"""Mass of a body per volume of its box, kg/m^3, below which units are most likely wrong."""
LARGE, SINGULAR = 20_000, 1e-12
"""Largest number of unknowns of a mass matrix that is factorized, and pivot, relative to the
diagonal, below which it is singular."""
LINEAR = 1e-3
"""Share of the moments of inertia that nodes may lack."""


def check_mechanical(key: str, written: str, A: Csr, u: Unknowns, free: bool) -> None:
    """InputError for a mass, stiffness or damping matrix of no body; free: without supports.

    A matrix with negative values x.A x; a stiffness matrix that resists rigid-body motion, holds
    a node by nothing, or consists of pieces.
    """
    _check_definite(written, A)
    if key == "mass":
        return
    error = motion_error(A, u.rigid_modes) if free else 0.0
    if error > ROUND_OFF:
        lost = f"; {len(u.modal)} unknowns have no place" if len(u.modal) else ""
        raise InputError(
            f"'{written}' resists rigid-body motion v: |A v| is {error:.2g} of |A| |v|, and zero "
            "for a free body. Leave out supports, contacts and prestress, and check that its "
            f"unknowns belong to these nodes, in this order{lost}")
    if key != "stiffness":
        return
    loose = np.flatnonzero(A.diagonal() == 0.0)
    if loose.size:
        nodes = np.unique(u.node[loose]) + 1  # from 1; 0 for modes, whose node is -1
        raise InputError(f"'{written}' is zero in the rows of {loose.size} unknowns: nothing "
                         f"holds {'modes' if nodes[0] == 0 else f'nodes {some(nodes)}'} (in the "
                         "order of the file)")
    placed = np.flatnonzero(u.node >= 0)
    # (N, n) ones: unknowns of each node; nodes are connected where their unknowns are
    of = coo_array((np.ones(len(placed)), (u.node[placed], placed)),
                   shape=(len(u.X), u.size)).tocsr()
    count = connected_components(of @ abs(A) @ of.T, directed=False)[0]
    if free and count > 1:
        raise InputError(f"'{written}' is of {count} pieces that nothing connects: make a body of "
                         "each")


def rigid_coordinates(T: FloatArray, u: Unknowns) -> tuple[IntArray, FloatArray]:
    """Numbers of the rigid-body modes of which shapes T (n, k) are capable, and the coordinates
    (k, number) that make them."""
    modes = u.rigid_modes / np.maximum(np.linalg.norm(u.rigid_modes, axis=0), 1e-300)
    q = np.linalg.lstsq(T, modes, rcond=1e-12)[0]
    able = np.flatnonzero(np.linalg.norm(T @ q - modes, axis=0) <= 1e-6)
    return able, q[:, able]


def check_reduced(written: str, A: Csr, T: FloatArray, u: Unknowns, free: bool) -> None:
    """InputError for a stiffness or damping matrix of generalized coordinates with shapes T (n, k)
    that has negative values x.A x or resists rigid-body motion."""
    _check_definite(written, A)
    _, q = rigid_coordinates(T, u)
    error = motion_error(A, q) if free and q.size else 0.0
    if error > ROUND_OFF:
        raise InputError(f"'{written}' resists rigid-body motion q: |A q| is {error:.2g} of "
                         "|A| |q|, and zero for a free body: are its coordinates in the order of "
                         "the shapes?")


def _check_definite(written: str, A: Csr) -> None:
    """InputError for a matrix that cannot be positive semidefinite: a negative diagonal entry, or
    A_ij^2 > A_ii A_jj, beyond round-off; written: its file."""
    diagonal, entries = A.diagonal(), A.tocoo()
    size = float(np.abs(diagonal).max(initial=0.0))
    bad = np.flatnonzero(diagonal < -ROUND_OFF * size)
    root = np.sqrt(np.maximum(diagonal, 0.0))
    limit = root[entries.row] * root[entries.col]
    over = np.flatnonzero(np.abs(entries.data) > (1 + ROUND_OFF) * limit + ROUND_OFF * size)
    if bad.size or over.size:
        row = int(bad[0]) if bad.size else int(entries.row[over[0]])
        raise InputError(f"'{written}' is not positive semidefinite, as its row {row + 1} shows: "
                         "its triangle, sign or columns are misread, or not of a stable body")


def have_mass(M: Csr) -> BoolArray:
    """(n,) True for unknowns on which inertia acts."""
    return np.asarray(abs(M).sum(axis=1) > 0.0)


def check_masses(written: str, M: Csr, free: IntArray) -> None:
    """InputError for a mass matrix M (n, n) that is singular on the unknowns with the numbers
    `free`: accelerations would not follow from forces. Larger ones than `LARGE` are not factorized,
    and diagonals that are not positive are left to other checks."""
    A = M[free][:, free].tocsc()
    if not 0 < len(free) <= LARGE or (A.diagonal() <= 0.0).any():  # negative: reported before
        return
    try:
        scale = diags_array(1.0 / np.sqrt(A.diagonal()))
        least = float(np.abs(splu((scale @ A @ scale).tocsc()).U.diagonal()).min())
    except RuntimeError:
        least = 0.0
    if least < SINGULAR:
        raise InputError(f"'{written}' is singular: some combinations of unknowns have no mass, as "
                         "those of incompatible modes: take elements without them")


def check_thermal(key: str, written: str, A: Csr) -> None:
    """InputError for a conductivity or capacity matrix (key) A (N, N) of no insulated body: one
    that is not definite, a conductivity that conducts at a uniform temperature (`motion_error`:
    largest |A 1| of |A| |1|), or a capacity that is not positive; written: its file."""
    _check_definite(written, A)
    error = motion_error(A, np.ones((A.shape[0], 1)))
    if key == "conductivity" and error > ROUND_OFF:
        raise InputError(
            f"'{written}' gives heat to surroundings at 0 K: a uniform temperature 1 has |A 1| of "
            f"{error:.2g} of |A|, and zero without convection: leave out films and prescribed "
            "temperatures, and add them as loads")
    if key == "capacity" and not A.sum() > 0.0:
        raise InputError(f"'{written}': the heat capacity of the body is {A.sum():.3g} J/K, and "
                         "must be positive")


def check_forces(written: str, forces: Csr, u: Unknowns) -> None:
    """InputError for thermal forces (n, N) with a resultant force or torque."""
    error = motion_error(forces.T.tocsr(), u.rigid_modes)
    if error > ROUND_OFF:
        raise InputError(f"'{written}' has resultant forces: {error:.2g} of the sum of their "
                         "sizes, and those of a free body that expands have none")


def size_notes(name: str, X: FloatArray, mass: float | None) -> Iterator[Note]:
    """Warning about lengths and masses that are not in SI units."""
    extent = np.ptp(X, axis=0)
    volume = float(np.prod(extent)) if X.shape[1] == 3 else 0.0
    density = mass / volume if mass is not None and volume > 0.0 else None
    wrong = density is not None and not LEAST < density < HEAVY
    if extent.max(initial=0.0) >= LARGEST or wrong:
        weight = "" if mass is None else f" and weighs {mass:.3g} kg"
        yield Note(f"{name} is {extent.max():.3g} m long{weight}: matrices in mm, t and s take "
                   "`units: {length: 1.0e-3, mass: 1.0e+3}`", "unlikely_size")


def moment_notes(name: str, u: Unknowns, M: Csr, mass: MassProperties) -> Iterator[Note]:
    """Warning where nodes and modes do not represent displacements linear in the position, whose
    moments the centrifugal loads are.

    Compares X.M X of the nodal positions X, as a field x -> x of the unknowns, with the trace of
    the second moment `mass.second`, which M gives exactly by its product with the rotations.
    u.modal: unknowns without a place, such as modes.
    """
    X = u.field(np.eye(u.d))
    exact, found = float(np.trace(mass.second)), float(X @ (M @ X))
    if len(u.modal) or abs(found - exact) > LINEAR * abs(exact):
        yield Note(
            f"{name}: centrifugal and Coriolis loads on its deformation are approximate, as its "
            f"nodes represent {found / exact:.1%} of its moments of inertia (rigid-body inertia is "
            "exact): give `shapes` with the mass matrix of all nodes, or keep spins far below its "
            "frequencies", "few_nodes")
