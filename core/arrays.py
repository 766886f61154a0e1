"""Type names of arrays in the interfaces of the package."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
Csr: TypeAlias = Any
"""Sparse matrix: a `scipy.sparse.csr_array` of float64 (scipy ships no type information)."""
Matrix: TypeAlias = Any
"""Sparse (`Csr`) or dense matrix (m, n)."""
Arrays: TypeAlias = Mapping[str, NDArray[Any]]
"""Named arrays with entries of any type."""


def union(parts: Iterable[IntArray]) -> IntArray:
    """Sorted distinct numbers of any number of arrays."""
    return np.unique(np.concatenate([np.zeros(0, np.int64), *parts])).astype(np.int64)
