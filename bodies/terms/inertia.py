"""Inertia of the displacements: functionals and matrices for its dependence on the frame motion."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, kron

from sparsemor.core import Csr, FloatArray


def generator(m: Csr, B: FloatArray) -> Csr:
    """(d N, d N) inertia matrix m (x) B without stored zeros; m (N, N): mass matrix, kg; B (d, d).
    """
    return csr_array(kron(m, csr_array(B), format="csr"))


def about(m: Csr, X: FloatArray, matrices: FloatArray) -> FloatArray:
    """(d N, g) functionals M_g X of the g matrices (g, d, d)."""
    return np.stack([(m @ X @ B.T).ravel() for B in matrices], axis=1)
