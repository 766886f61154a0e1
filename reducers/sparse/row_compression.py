"""Compression of sampled rows by an orthogonal transformation, exact in the 2-norm.

All operators of a block have few columns, so that their m rows span a space of lower dimension. In
an orthonormal basis of it, ordered as [range of B | frame directions P | rest], every residual has
the same norm and every least-squares problem the same solution. B and P vanish in the rest. Where
columns of B are linearly dependent, QR adds arbitrary orthonormal vectors, which does no harm.
Where B has at least as many columns as rows, as with a complete basis, nothing is compressed: a
rotation of m rows of several matrices with k columns would take m^2 k operations each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy import linalg

from sparsemor.core import FloatArray
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat, TestMap

DEPENDENT = 1e-14
"""Distance of a unit column from the span of the others below which it is round-off."""


T = TypeVar("T", ProjectedElastic, ProjectedHeat)


@dataclass(frozen=True, slots=True, eq=False)
class Compact(Generic[T]):
    """Operators of a block and B (l, k) in the compressed rows; basis (m, l): their orthonormal
    basis in the sampled rows, None where they are the same; reach: number of its first columns,
    which span the range of B: in the other rows B is zero."""

    operators: T
    B: FloatArray
    basis: FloatArray | None
    reach: int


def compact(t: T, B: FloatArray, columns: Sequence[FloatArray]) -> Compact[T]:
    """Compressed rows of B (m, k) and of the operators in the same m sampled rows; columns: what
    the rows consist of beside B, in the order of the basis."""
    m, k = B.shape
    if k >= m:  # nothing to compress
        return Compact(t, B, basis=None, reach=m)
    Z = np.linalg.qr(_unit(B))[0]
    reach = Z.shape[1]
    for A in columns:
        Z = _joined(Z, A)
    return Compact(t.through(TestMap(left=Z.T)), Z.T @ B, Z, reach)


def elastic_columns(t: ProjectedElastic) -> tuple[FloatArray, FloatArray]:
    """Frame directions, and all other columns of which the rows of an elastic block consist."""
    return t.directions, np.hstack([
        *t.generators, t.damping, t.coupling, t.loads, t.constant[:, None], t.mass,
        *(table.values.T for table in t.tables)])


def heat_columns(t: ProjectedHeat) -> tuple[FloatArray]:
    """Columns of which the rows of a thermal block without local terms consist."""
    return np.hstack([
        t.capacity, t.loads, t.constant[:, None], *(table.values.T for table in t.tables)]),


def _joined(Z: FloatArray, A: FloatArray) -> FloatArray:
    """Orthonormal Z (m, j) extended by columns that complete it to the span of [Z A]; at most m
    columns."""
    A, room = _unit(A), len(A) - Z.shape[1]
    if room == 0 or A.shape[1] == 0:
        return Z
    for _ in range(2):  # the second pass removes what rounding left of the first
        A = A - Z @ (Z.T @ A)
    # pivoted QR: |R_ii| is the distance of column i from the span of those before it
    R, order = linalg.qr(A, mode="r", pivoting=True)
    kept = order[: len(R)][np.abs(np.diag(R)) > DEPENDENT][:room]
    # one factorization of both: a short column alone would not stay orthogonal to Z
    Q = np.linalg.qr(np.hstack([Z, A[:, kept] / np.linalg.norm(A[:, kept], axis=0)]))[0]
    return np.hstack([Z, Q[:, Z.shape[1] :]])


def _unit(A: FloatArray) -> FloatArray:
    """Nonzero columns of A, scaled to unit length."""
    sizes = np.linalg.norm(A, axis=0)
    return np.asarray(A[:, sizes > 0.0] / sizes[sizes > 0.0])
