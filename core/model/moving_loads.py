"""Moving loads: rows along their path over the mesh, and the elements that touch the path."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.load_tables import LoadTable


def loaded_columns(load: LoadTable) -> IntArray:
    """Numbers of the columns of a moving load that are nonzero at some time and act on some
    unknown."""
    acts = np.any(load.table.values != 0.0, axis=0)
    tabulated = np.asarray(abs(load.columns).sum(axis=0)).ravel() > 0.0
    return np.flatnonzero(acts & tabulated).astype(np.int64)


def path_rows(moving: Sequence[LoadTable]) -> IntArray:
    """Sorted rows that at least one of the moving loads acts on at some time."""
    touched = [np.flatnonzero(np.asarray(abs(load.columns[:, loaded_columns(load)]).sum(axis=1)))
               for load in moving]
    return np.unique(np.concatenate([*touched, np.zeros(0, np.int64)])).astype(np.int64)


def ring(mass: Csr, stiffness: Csr, coordinates: FloatArray, rows: IntArray) -> IntArray:
    """Sorted rows of all elements that touch a node of `rows` (one-ring neighbourhood), found from
    the sparsity of mass and stiffness: nodes are coupled if they share an element. coordinates:
    nodes of all rows (n, d), m."""
    if not len(rows):
        return rows
    node = np.unique(coordinates, axis=0, return_inverse=True)[1].reshape(-1)
    at = np.flatnonzero(np.isin(node, node[rows]))
    pattern = _ones(mass) + _ones(stiffness)  # a triangle with a right angle lacks an entry in one
    near = np.union1d(at, pattern[at].indices)
    return np.flatnonzero(np.isin(node, node[near])).astype(np.int64)


def _ones(matrix: Csr) -> Csr:
    m = csr_array(matrix)
    return csr_array((np.ones(m.nnz), m.indices, m.indptr), shape=m.shape)
