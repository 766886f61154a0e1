"""Sampled rows turned so that few are left: an orthogonal change of rows, exact in the 2-norm.

All operators of a block have few columns, so that their m rows live in a space of fewer
dimensions. In an orthonormal basis of it, ordered as [range of B | directions besides | rest],
every residual has the same norm and every least-squares problem the same solution. B and the
directions are zero in the rest.
"""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from sparsemor.core.arrays import FloatArray
from sparsemor.reducers.rows import elastic_times, heat_times
from sparsemor.reducers.test_map import TestedElastic, TestedHeat

DEPENDENT = 1e-14
"""Length of a unit column beyond the others, below which it is rounding."""


def compact_elastic(t: TestedElastic, B: FloatArray) -> tuple[TestedElastic, FloatArray, int]:
    """The operators and B (m, k) in the new rows, and how many rows B and directions need."""
    rest = [*t.generators, t.damping, t.coupling, t.loads, t.constant[:, None], t.mass,
            *(table.values.T for table in t.tables)]
    Z, first = _basis([B, t.directions], rest)
    return elastic_times(Z.T, t), Z.T @ B, first


def compact_heat(t: TestedHeat, B: FloatArray) -> tuple[TestedHeat, FloatArray, int]:
    """The same for heat; B alone comes first."""
    Z, first = _basis([B], [t.capacity, t.loads, t.constant[:, None],
                            *(table.values.T for table in t.tables)])
    return heat_times(Z.T, t), Z.T @ B, first


def _basis(first: Sequence[FloatArray], rest: Sequence[FloatArray]) -> tuple[FloatArray, int]:
    """Orthonormal columns (m, l) that span all, those of `first` in front, and how many these are.

    Where columns of first[0] depend on others, QR adds orthonormal ones that do no harm.
    """
    Z = np.linalg.qr(_unit(first[0]))[0]
    for part in first[1:]:
        Z = _joined(Z, part)
    return _joined(Z, np.hstack(rest)), Z.shape[1]


def _joined(Z: FloatArray, A: FloatArray) -> FloatArray:
    """Z (m, j) and orthonormal columns for what A has besides; never more than m."""
    A, room = _unit(A), len(A) - Z.shape[1]
    for _ in range(2):  # the second pass removes what rounding left of the first
        A = A - Z @ (Z.T @ A)
    if room == 0 or A.shape[1] == 0:
        return Z
    R, order = linalg.qr(A, mode="r", pivoting=True)
    kept = order[: len(R)][np.abs(np.diag(R)) > DEPENDENT][:room]
    # one factorization of both: a short column alone would not stay orthogonal to Z
    Q = np.linalg.qr(np.hstack([Z, A[:, kept] / np.linalg.norm(A[:, kept], axis=0)]))[0]
    return np.hstack([Z, Q[:, Z.shape[1] :]])


def _unit(A: FloatArray) -> FloatArray:
    """Columns of unit length, without those of zeros."""
    sizes = np.linalg.norm(A, axis=0)
    return np.asarray(A[:, sizes > 0.0] / sizes[sizes > 0.0])
