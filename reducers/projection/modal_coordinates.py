"""Modal coordinates: the span of a dictionary in the eigenvectors of its projected operators.

A block that is projected on orthonormal atoms and solved by itself has two small symmetric
operators, K and M (heat: conductivity and capacity). In the eigenvectors of this pencil both are
diagonal, whatever the step: the product of a block with its own unknowns then takes k
multiplications per step instead of k^2. Softer modes come first, so that coupling to the rotation
of a frame decays towards the last of them. The span, and so the solution in it, is the same.
"""

from dataclasses import replace

import numpy as np
from scipy import linalg

from sparsemor.core import Csr, Dictionary, FloatArray, distinct_names, oriented_unit_columns

ORTHONORMAL = 1e-8
"""How far the Gram matrix of atoms may be from 1. Others keep their own coordinates: eigenvectors
of what is nearly singular would lose what distinguishes atoms."""
SHIFT = 1e-2
"""Multiple of M, of the mean of the eigenvalues, that is added to K: an insulated body has K 1 = 0.
Small, and soft modes are exact; at 1e-6 temperatures of an insulated pendulum lost two digits.
Independent of the step, so that solvers of several steps share their coordinates."""
ROUND_OFF = 1e-10
"""Smallest trace of the projected K that is taken for more than rounding, as a share of that of
|atoms|^T |K| |atoms|: uniform temperatures of an insulated body give K 1 = 0, which in floating
point is zero, or either sign of 1e-17 of its terms."""


def modal_coordinates(d: Dictionary, K: Csr, M: Csr, unit: str) -> tuple[Dictionary, float] | None:
    """The same span in atoms (n, k) that make atoms^T K atoms and atoms^T M atoms diagonal, and by
    how much more than before a coefficient can be at most. None where atoms are not orthonormal,
    or numbers are too extreme for eigenvectors. unit: what modes are named by, the "Hz" of
    displacements or the "/s" of decaying heat.
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
    values, V = values[::-1], V[:, ::-1]
    turned = A @ V
    # coefficients of old atoms times V^-1 = V^T stiff, and by how much the atoms become shorter
    back = np.linalg.norm(turned, axis=0)[:, None] * (V.T @ stiff)
    rates = np.maximum(1.0 / np.maximum(values, 1e-300) - shift, 0.0)
    at = np.sqrt(rates) / (2.0 * np.pi) if unit == "Hz" else rates
    return replace(
        d, atoms=oriented_unit_columns(turned),
        provenance=distinct_names([f"mode at {value:.4g} {unit}" for value in at]),
        info={**d.info, "coordinates": "eigenmodes of the span"},
    ), float(np.abs(back).sum(axis=1).max())


def projected(K: Csr, A: FloatArray) -> FloatArray:
    """A^T K A (k, k) of a symmetric K, symmetric to the last digit."""
    small = A.T @ (K @ A)
    return np.asarray(0.5 * (small + small.T))


def diagonal(A: FloatArray) -> FloatArray:
    """A (k, k) without what is off its diagonal: in modal coordinates that is round-off."""
    return np.diag(np.diagonal(A))


def carried(A: FloatArray) -> FloatArray:
    """A (s, k) as it is multiplied in each step: its diagonal (k,) where that is all of it."""
    d = np.diagonal(A)
    plain = A.shape[0] == A.shape[1] and np.count_nonzero(A) == np.count_nonzero(d)
    return d.copy() if plain else np.ascontiguousarray(A)


def times(A: FloatArray, x: FloatArray) -> FloatArray:
    """A x of a `carried` A."""
    return A * x if A.ndim == 1 else A.dot(x)


def dense(A: FloatArray) -> FloatArray:
    """The matrix of a `carried` A."""
    return np.diag(A) if A.ndim == 1 else A
