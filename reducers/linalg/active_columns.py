"""Products of a matrix with vectors of which few entries are nonzero, such as the coefficients of a
complete basis with few active atoms."""

from functools import lru_cache

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray

KEPT = 16
"""Number of sets of nonzero entries whose columns are kept."""
NEGLIGIBLE = 1e-40
"""Size of an entry, relative to the largest, below which it counts as zero. Rates of atoms that
left the support fall to round-off of round-off in each step, down to numbers that are slow to
multiply because they are below the normal range."""
WIDE = 200
"""Number of columns from which reading some of them is faster than a product with all."""


def are_few(active: IntArray | None, columns: int) -> bool:
    """True if so few of the columns are active (None: all) that products read only these."""
    return active is not None and columns >= WIDE and 4 * len(active) <= columns


class ActiveColumns:
    """Matrix A (m, k) whose columns are read only where the vector is nonzero.

    The columns of recent sets of nonzero entries are kept, because supports change seldom: a
    product then costs m times the number of nonzero entries. Results do not depend on the order of
    the products, so that several threads may share one object. A is not copied where its columns
    are contiguous.
    """

    def __init__(self, A: FloatArray) -> None:
        self.transposed = np.ascontiguousarray(A.T)
        self._columns = lru_cache(maxsize=KEPT)(self._gathered)

    def times(self, u: FloatArray) -> FloatArray:
        """A u (m,), or U A^T (j, m) for several vectors U (j, k)."""
        some = _nonzero(u)
        return np.asarray(u[..., some].dot(self._columns(some.tobytes())))

    def _gathered(self, nonzero: bytes) -> FloatArray:
        """Columns (j, m), transposed, in a mask (k,)."""
        return np.asarray(self.transposed[np.frombuffer(nonzero, dtype=np.bool_)])


def _nonzero(u: FloatArray) -> BoolArray:
    """Mask (k,) of the entries of u (k,), or the columns of u (j, k), that count."""
    size = np.abs(u)
    some = size > NEGLIGIBLE * size.max(initial=0.0)
    return np.asarray(some.any(axis=0) if u.ndim > 1 else some)
