"""Inertia of displacements: its directions and generators."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, kron

from sparsemor.bodies.frames import nodal
from sparsemor.core import Csr, FloatArray


def generator(m: Csr, B: FloatArray) -> Csr:
    """(d N, d N): m (x) B without stored zeros."""
    return csr_array(kron(m, csr_array(B), format="csr"))


def directions(m: Csr, X: FloatArray, matrices: FloatArray) -> FloatArray:
    """(d N, d + g): m e_i, then M_g X of the g matrices (g, d, d)."""
    shape = [(m @ X @ B.T).ravel() for B in matrices]
    first = nodal.along(np.asarray(m.sum(axis=1)).ravel(), X.shape[1])
    return np.concatenate([first, np.stack(shape, axis=1)], axis=1)
