"""Vibration modes and their static derivatives (Idelsohn and Cardona 1985, doi
10.1016/0045-7825(85)90125-2; Jain, Tiso et al. 2017, doi 10.1016/j.compstruc.2016.10.005)."""

from collections.abc import Callable

import numpy as np
from pydantic import Field

from sparsemor.core import Basis, BlockData, Csr, Dictionary, FloatArray
from sparsemor.plugins.bases.modal import lowest_modes, mode_info
from sparsemor.plugins.bases.orthogonalise import independent_atoms
from sparsemor.plugins.bases.static_response import StaticSolver

SMALL = 1e-4
"""Displacement of the modes in differences of stiffness, relative to the size of the body: that of
a polynomial of second degree, as of nonlinear strains, is exact for any."""


class ModalDerivatives(Basis):
    """Modes phi_i of (K, M) and static modal derivatives theta_ij of bodies with nonlinear strains.

        K theta_ij = - (dK(u)/du phi_j) phi_i    at u = 0,    i <= j.

    Where a body bends along its modes, its membrane moves along the derivatives, which the modes
    alone do not allow (membrane locking). No training run is needed. Without terms that are
    nonlinear in the displacements, and for temperatures, there are none, and the modes remain.
    """

    count: int = Field(default=5, ge=1, le=40)
    """Number of modes m, the lowest ones; they have m (m + 1) / 2 derivatives."""
    rank_rtol: float = Field(default=1e-6, gt=0.0, lt=1.0)
    """Tolerance of linear dependence: a derivative is left out when its part outside the span of
    earlier atoms is below this (2-norm, relative)."""

    @property
    def needs_snapshots(self) -> bool:
        return False

    def most_atoms(self, size: int) -> int | None:
        return min(self.count * (self.count + 3) // 2, size)

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with orthonormal atoms (n, k)."""
        modes = lowest_modes(data, self.count)
        names = [f"mode {i}" for i in range(len(modes.values))]
        columns = [modes.shapes]
        if data.tangent is not None:
            made = derivatives(data, data.tangent, modes.shapes)
            columns.append(made)
            i, j = np.triu_indices(len(names))
            names += [f"derivative of mode {a} by mode {b}"
                      for a, b in zip(i.tolist(), j.tolist(), strict=True)]
        found = np.concatenate(columns, axis=1)
        atoms, kept = independent_atoms(found, self.rank_rtol, orthonormal=True)
        return Dictionary(
            atoms, np.zeros(data.size), tuple(names[i] for i in kept),
            {"modes": len(modes.values), "derivatives": len(kept) - len(modes.values),
             **mode_info(data, modes)})


def derivatives(
    data: BlockData, tangent: Callable[[FloatArray], Csr], shapes: FloatArray
) -> FloatArray:
    """Static derivatives (n, m (m + 1) / 2) of m modes (n, m), by rows of their upper triangle.

    tangent(u): stiffness (n, n) of the nonlinear terms at displacements u (n,); by central
    differences, K theta_ij = -(dK/du phi_j) phi_i. The modes are scaled so that their largest
    displacement is the size of the body, m; a derivative that is small beside these is set to zero
    as rounding.
    """
    size = float(np.ptp(data.coordinates, axis=0).max())
    shapes = shapes * (size / np.abs(shapes).max(axis=0))
    forces = {}
    for j, phi in enumerate(shapes.T):
        change = (tangent(SMALL * phi) - tangent(-SMALL * phi)) / (2.0 * SMALL)
        for i in range(j + 1):
            forces[i, j] = -(change @ shapes[:, i])
    order = zip(*np.triu_indices(shapes.shape[1]), strict=True)
    solver = StaticSolver.from_data(data)
    found = solver(np.column_stack([forces[int(i), int(j)] for i, j in order]))
    large = np.linalg.norm(found, axis=0) > 1e-9 * np.linalg.norm(shapes, axis=0).max()
    return np.asarray(np.where(large, found, 0.0))
