"""Bordered linear systems of a mechanical step: assembly from the bodies' matrices, and solution.

The pose and attachment forces of body i, its border unknowns, are y_i = T_i x + origin_i, with the
N rigid coordinates and multipliers x of the model. Matrices H_i of the bodies, from which elastic
unknowns are eliminated (Schur complement), form the system of each iteration,

    B dx = r,     B = sum_i T_i^T H_i T_i,     r = sum_i T_i^T r_i.

A few unknowns are solved for with dense matrices; chains, trees and loops of many bodies with
sparse ones (sparse.py), whose cost grows in proportion to the number of bodies.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg.lapack import dgesv

from sparsemor.core import FloatArray
from sparsemor.reducers.linalg.least_norm import least


class BodyMatrices(NamedTuple):
    """Working array `values` with the matrices H_i of all bodies and their rows r_i, and a view of
    each, (b_i, b_i + 1), with r_i as the last column."""

    values: FloatArray
    views: list[FloatArray]


class BorderedSystem(Protocol):
    """Bordered system of a model with N rigid coordinates and multipliers, the first n_rigid of
    which are rigid coordinates, and sum b border unknowns of its bodies. Immutable."""

    def matrices(self) -> BodyMatrices:
        """New working array."""
        ...

    def stacked(self, x: FloatArray) -> FloatArray:
        """T x (sum b,): parts of the border unknowns of all bodies due to x (N,)."""
        ...

    def stacked_rates(self, v: FloatArray) -> FloatArray:
        """T v (sum b,) for rates v (n_rigid,) of the rigid coordinates."""
        ...

    def stacked_sizes(self, x: FloatArray) -> FloatArray:
        """|T| x (sum b,) for magnitudes x (N,)."""
        ...

    def assembled(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """B in the storage of this system, and r (N,); values: those of the bodies' matrices."""
        ...

    def solved(self, B: FloatArray, r: FloatArray) -> FloatArray | None:
        """Solution B^-1 r (N,), not finite where B is not; None where B is singular."""
        ...

    def least(self, B: FloatArray, r: FloatArray) -> FloatArray:
        """Least-squares solution (N,) of least norm of B x = r."""
        ...

    def term_sizes(self, B: FloatArray, x: FloatArray) -> FloatArray:
        """|B| x (N,) for magnitudes x (N,)."""
        ...

    def amplified(self, B: FloatArray, sizes: FloatArray) -> FloatArray:
        """|B^-1| sizes (N,), or an estimate: largest errors of the solution due to errors of these
        sizes in the equations."""
        ...


class DenseSystem:
    """Bordered system with dense matrices; maps: T_i (b_i, N) of all bodies."""

    def __init__(self, maps: Sequence[FloatArray], size: int, n_rigid: int) -> None:
        self.map = np.concatenate([np.zeros((0, size)), *maps])
        edges = np.cumsum([0, *map(len, maps)]).tolist()
        self.at = list(map(slice, edges, edges[1:]))
        # T_i in its first N columns, and r_i in the last one
        self.with_rows = np.concatenate([np.zeros((0, size + 1)), *(
            np.pad(T, ((0, 1), (0, 1))) for T in maps)])
        self.with_rows[[at.stop + i for i, at in enumerate(self.at)], -1] = 1.0
        self.stacked: Callable[[FloatArray], FloatArray] = self.map.dot
        self.stacked_rates: Callable[[FloatArray], FloatArray] = self.map[:, :n_rigid].dot

    def matrices(self) -> BodyMatrices:
        values = np.zeros((len(self.map), len(self.with_rows)))
        return BodyMatrices(values, [values[at, at.start + i : at.stop + i + 1]
                                     for i, at in enumerate(self.at)])

    def stacked_sizes(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.abs(self.map).dot(x))

    def assembled(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        both = self.map.T.dot(values.dot(self.with_rows))
        return both[:, :-1], both[:, -1]

    def solved(self, B: FloatArray, r: FloatArray) -> FloatArray | None:
        x, info = dgesv(B, r)[2:]
        return None if info > 0 else x

    def least(self, B: FloatArray, r: FloatArray) -> FloatArray:
        return least(B, r)

    def term_sizes(self, B: FloatArray, x: FloatArray) -> FloatArray:
        return np.asarray(np.abs(B).dot(x))

    def amplified(self, B: FloatArray, sizes: FloatArray) -> FloatArray:
        return np.asarray(np.abs(dgesv(B, np.eye(len(sizes)))[2]).dot(sizes))
