"""Sampled rows turned so that few are left: an orthogonal change of rows, exact in the 2-norm.

All operators of a block have few columns, so that their m rows live in a space of fewer
dimensions. In an orthonormal basis of it, ordered as [range of B | further directions | rest],
every residual has the same norm and every least-squares problem the same solution. B and the
directions are zero in the rest. Where columns of B depend on others, QR adds orthonormal ones that
do no harm.
"""

from typing import NamedTuple

import numpy as np
from scipy import linalg

from sparsemor.core import FloatArray
from sparsemor.reducers.step.operators import TestedElastic, TestedHeat, TestMap

DEPENDENT = 1e-14
"""Length of a unit column beyond the others, below which it is rounding."""


class CompactElastic(NamedTuple):
    """The operators and B (l, k) in the new rows; B needs the first `reach` rows, the further
    directions the first `first`."""

    tested: TestedElastic
    B: FloatArray
    reach: int
    first: int


class CompactHeat(NamedTuple):
    """The same for heat, where B alone comes first. turn (m, reach): the rows that it needs, in
    old ones."""

    tested: TestedHeat
    B: FloatArray
    turn: FloatArray


def compact_elastic(t: TestedElastic, B: FloatArray) -> CompactElastic:
    """B (m, k) and the operators of the same rows."""
    Z = np.linalg.qr(_unit(B))[0]
    reach, Z = Z.shape[1], _joined(Z, t.directions)
    first = Z.shape[1]
    Z = _joined(Z, np.hstack([
        *t.generators, t.damping, t.coupling, t.loads, t.constant[:, None], t.mass,
        *(table.values.T for table in t.tables)]))
    return CompactElastic(t.under(TestMap(left=Z.T)), Z.T @ B, reach, first)


def compact_heat(t: TestedHeat, B: FloatArray) -> CompactHeat:
    """B (m, k) and the operators of the same rows."""
    turn = np.linalg.qr(_unit(B))[0]
    Z = _joined(turn, np.hstack([
        t.capacity, t.loads, t.constant[:, None], *(table.values.T for table in t.tables)]))
    return CompactHeat(t.under(TestMap(left=Z.T)), Z.T @ B, turn)


def _joined(Z: FloatArray, A: FloatArray) -> FloatArray:
    """Z (m, j) and orthonormal columns for what A has in addition; never more than m."""
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
