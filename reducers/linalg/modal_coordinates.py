"""Modal coordinates: the span of a dictionary in the eigenvectors of its projected operators.

A block that is projected on orthonormal atoms and solved separately has two small symmetric
operators, K and M (heat: conductivity and capacity). In the eigenvectors of this pencil both are
diagonal for every step size: the product with the block's own unknowns then takes k multiplications
per step instead of k^2. Modes are sorted from soft to stiff, so that the coupling to the rotation
of a frame decays towards the last ones. The span, and so the solution in it, is the same.
"""

from dataclasses import replace

import numpy as np
from scipy import linalg

from sparsemor.core import Csr, Dictionary, FloatArray
from sparsemor.core.linalg.dense import oriented_unit_columns
from sparsemor.core.model.model import distinct_names

ORTHONORMAL = 1e-8
"""Largest deviation of the Gram matrix of the atoms from the identity. Other dictionaries keep
their own coordinates: eigenvectors of a nearly singular Gram matrix would lose small differences of
atoms."""
SHIFT = 1e-2
"""Shift of K by a multiple of M, relative to the mean eigenvalue: an insulated body has K 1 = 0.

It is small so that soft modes are accurate, but at 1e-6 temperatures of an insulated pendulum lost
two digits. It does not depend on the step, so that solvers of different step sizes share their
coordinates.
"""
ROUND_OFF = 1e-10
"""Smallest trace of the projected K relative to that of |atoms|^T |K| |atoms| that is more than
round-off: uniform temperatures of an insulated body give K 1 = 0, in floating point about 1e-17 of
its terms with either sign."""


def modal_coordinates(d: Dictionary, K: Csr, M: Csr, unit: str) -> tuple[Dictionary, float] | None:
    """Dictionary of the same span whose atoms (n, k) diagonalise atoms^T K atoms and atoms^T M
    atoms, and the factor by which coefficients can grow in this change of basis.

    K, M: symmetric operators (n, n) of the block (heat: conductivity, capacity). None where the
    atoms are not orthonormal or the numbers too extreme for eigenvectors. unit: unit
    of the eigenvalues in the modes' names, "Hz" for displacements or "/s" for decaying
    temperatures.
    """
    A, k = d.atoms, d.atoms.shape[1]
    if not k or k > len(A) or np.abs(A.T @ A - np.eye(k)).max() > ORTHONORMAL:
        return None
    small, mass = projected(K, A), projected(M, A)
    terms = float(np.sum(np.abs(A) * (abs(K) @ np.abs(A))))
    top = float(np.trace(mass))
    if not (0.0 < terms < np.inf and 0.0 < top < np.inf):
        return None
    shift = SHIFT * max(float(np.trace(small)), ROUND_OFF * terms) / top
    stiff = small + shift * mass
    # this way round the soft modes, which are most of a motion, are the exact ones
    try:
        values, V = linalg.eigh(mass, stiff)
    except linalg.LinAlgError:
        return None
    values, V = values[::-1], V[:, ::-1]  # soft modes first
    modes = A @ V
    # coefficients of old atoms times V^-1 = V^T stiff, and by how much the atoms become shorter
    back = np.linalg.norm(modes, axis=0)[:, None] * (V.T @ stiff)
    # eigenvalues of K relative to M: angular frequency squared, or rate of decay, 1/s
    rates = np.maximum(1.0 / np.maximum(values, 1e-300) - shift, 0.0)
    at = np.sqrt(rates) / (2.0 * np.pi) if unit == "Hz" else rates
    return replace(
        d, atoms=oriented_unit_columns(modes),
        provenance=distinct_names([f"mode at {value:.4g} {unit}" for value in at]),
        info={**d.info, "coordinates": "eigenmodes of the span"},
    ), float(np.abs(back).sum(axis=1).max())


def projected(K: Csr, A: FloatArray) -> FloatArray:
    """Projection A^T K A (k, k) of a symmetric K, exactly symmetric."""
    small = A.T @ (K @ A)
    return np.asarray(0.5 * (small + small.T))


def diagonal(A: FloatArray) -> FloatArray:
    """A (k, k) with zeros off the diagonal, where modal coordinates leave only round-off."""
    return np.diag(np.diagonal(A))


def compact(A: FloatArray) -> FloatArray:
    """A (s, k) in the form that is multiplied in each step: a diagonal matrix as its diagonal
    (k,)."""
    d = np.diagonal(A)
    plain = A.shape[0] == A.shape[1] and np.count_nonzero(A) == np.count_nonzero(d)
    return d.copy() if plain else np.ascontiguousarray(A)


def times(A: FloatArray, x: FloatArray) -> FloatArray:
    """Product A x for a matrix A (s, k) or the diagonal (k,) of one, as returned by `compact`."""
    return A * x if A.ndim == 1 else A.dot(x)


def dense(A: FloatArray) -> FloatArray:
    """Matrix of an array returned by `compact`, which may be the diagonal of one."""
    return np.diag(A) if A.ndim == 1 else A
