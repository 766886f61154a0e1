"""Inertia of the displacements: functionals and matrices for its dependence on the frame motion."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, kron

from sparsemor.bodies.frames import nodal
from sparsemor.core import Csr, FloatArray


def generator(m: Csr, B: FloatArray) -> Csr:
    """(d N, d N) inertia matrix m (x) B without stored zeros; m (N, N): mass matrix, kg; B (d, d).
    """
    return csr_array(kron(m, csr_array(B), format="csr"))


def directions(m: Csr, X: FloatArray, matrices: FloatArray) -> FloatArray:
    """(d N, d + g) functionals of the inertia: m e_i, then M_g X for the g matrices (g, d, d)."""
    shape = [(m @ X @ B.T).ravel() for B in matrices]
    first = nodal.along(np.asarray(m.sum(axis=1)).ravel(), X.shape[1])
    return np.concatenate([first, np.stack(shape, axis=1)], axis=1)
