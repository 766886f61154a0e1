"""Bound on the motion of a surface's points, from the change of few reduced unknowns."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A surface in d dimensions as its points move: X (n, d) at reference, m; facets (F, d).

    frame (f,), u (n, d): where the frame's unknowns, position first, and the displacements are in a
    list, -1: nowhere. A frame turns by an angle (f = d + 1) or a quaternion (f = 7), or has no
    unknowns (all -1, or f = 0).
    """

    X: FloatArray
    facets: IntArray
    frame: IntArray
    u: IntArray

    @property
    def extent(self) -> float:
        """Of the box about it, m."""
        return float(np.ptp(self.X, axis=0).max())


@dataclass(frozen=True, slots=True, eq=False)
class MotionBound:
    """Bound on the motion of one surface's points with k reduced unknowns.

    shift (d, k), turn (m, k) and upright (m,): the frame's share and its turning coordinates where
    the unknowns are 0; own (k,): the unknowns that displace points; gain: m a unit of their norm;
    arm: largest distance of an undisplaced point from the frame origin, m.
    """

    shift: FloatArray
    turn: FloatArray
    upright: FloatArray
    own: BoolArray
    gain: float
    arm: float

    @classmethod
    def of(cls, mover: Mover, atoms: FloatArray, offset: FloatArray) -> Self:
        """Of unknowns x (k,) that stand for offset + atoms @ x, atoms (N, k)."""
        d, at = mover.X.shape[1], mover.frame
        frame, rest = _rows(atoms, at), _rows(offset[:, None], at)[:, 0]
        u, u0 = _rows(atoms, mover.u), _rows(offset[:, None], mover.u)[..., 0]
        arm = float(np.linalg.norm(mover.X + u0, axis=1).max())
        gain = float(np.sqrt((u * u).sum(axis=(1, 2))).max())
        return cls(frame[:d], frame[d:], rest[d:], np.any(u != 0.0, axis=(0, 1)), gain, arm)

    def bound(self, change: FloatArray, x: FloatArray, beyond: float = 0.0) -> float:
        """m, of any point, from x (k,) to x + change; of rates, m/s. beyond: m by which points that
        are carried along may be farther out than the points."""
        arm = self.arm + beyond + self.gain * float(np.linalg.norm(x[self.own]))
        return float(np.linalg.norm(self.shift @ change) + self._turned(change, x) * arm
                     + self.gain * np.linalg.norm(change[self.own]))

    def _turned(self, change: FloatArray, x: FloatArray) -> float:
        """Chord of the unit circle. A quaternion q, brought to unit length, turns by twice the
        angle between q and q + dq; that chord is 2 sin(angle) <= 2 |dq| / |q|, as are the rates.
        """
        by = float(np.linalg.norm(self.turn @ change))
        if len(self.turn) < 4 or by == 0.0:
            return by
        size = float(np.linalg.norm(self.upright + self.turn @ x))
        return 2.0 * by / size if size > 0.0 else np.inf


def _rows(matrix: FloatArray, at: IntArray) -> FloatArray:
    """(..., k) rows of a matrix (N, k) at positions (...), 0 where one is -1."""
    if not len(matrix):
        return np.zeros((*at.shape, matrix.shape[1]))
    return np.where((at >= 0)[..., None], matrix[at], 0.0)
