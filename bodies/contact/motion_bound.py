"""Upper bound of the displacement of a surface's nodes from the change of few reduced unknowns."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A surface in d dimensions whose nodes move with unknowns.

    X (n, d): reference positions, m; facets (F, d). frame (f,), u (n, d): positions of the rigid
    coordinates (position first) and of the displacements in a list of unknowns, -1 for prescribed
    ones. The attitude is an angle (f = d + 1) or a quaternion (f = 7); a fixed frame has no
    unknowns (all -1, or f = 0).
    """

    X: FloatArray
    facets: IntArray
    frame: IntArray
    u: IntArray

    @property
    def extent(self) -> float:
        """Largest edge of the surface's axis-aligned bounding box, m."""
        return float(np.ptp(self.X, axis=0).max())


@dataclass(frozen=True, slots=True, eq=False)
class MotionBound:
    """Upper bound of the motion of one surface's nodes with k reduced unknowns.

    shift (d, k), turn (m, k): rows of the reduced basis for the frame's position and attitude;
    upright (m,): attitude coordinates at zero unknowns; own (k,): True for unknowns that deform the
    surface; gain: bound on a nodal displacement per unit norm of these, m; arm: largest distance of
    an undeformed node from the frame origin, m.
    """

    shift: FloatArray
    turn: FloatArray
    upright: FloatArray
    own: BoolArray
    gain: float
    arm: float

    @classmethod
    def of(cls, mover: Mover, atoms: FloatArray, offset: FloatArray) -> Self:
        """Bound for a surface whose full unknowns are offset + atoms @ x: atoms (N, k) trial
        vectors, x (k,) reduced unknowns."""
        d, at = mover.X.shape[1], mover.frame
        frame, rest = _rows(atoms, at), _rows(offset[:, None], at)[:, 0]
        u, u0 = _rows(atoms, mover.u), _rows(offset[:, None], mover.u)[..., 0]
        arm = float(np.linalg.norm(mover.X + u0, axis=1).max())
        gain = float(np.sqrt((u * u).sum(axis=(1, 2))).max())
        return cls(frame[:d], frame[d:], rest[d:], np.any(u != 0.0, axis=(0, 1)), gain, arm)

    def bound(self, change: FloatArray, x: FloatArray, beyond: float = 0.0) -> float:
        """Upper bound, m, of the motion of any node from x (k,) to x + change; for rates as
        `change`, of its speed, m/s.

        beyond: additional distance from the frame origin, m, of points that move with the surface.
        """
        arm = self.arm + beyond + self.gain * float(np.linalg.norm(x[self.own]))
        return float(np.linalg.norm(self.shift @ change) + self._turned(change, x) * arm
                     + self.gain * np.linalg.norm(change[self.own]))

    def _turned(self, change: FloatArray, x: FloatArray) -> float:
        """Chord on the unit circle of the rotation by `change`.

        A quaternion q, normalised, rotates by twice the angle between q and q + dq; the chord is at
        most 2 sin(angle) <= 2 |dq| / |q|, and so are the rates.
        """
        by = float(np.linalg.norm(self.turn @ change))
        if len(self.turn) < 4 or by == 0.0:
            return by
        size = float(np.linalg.norm(self.upright + self.turn @ x))
        return 2.0 * by / size if size > 0.0 else np.inf


def _rows(matrix: FloatArray, at: IntArray) -> FloatArray:
    """(..., k) rows of a matrix (N, k) at positions (...); 0 where the position is -1."""
    if not len(matrix):
        return np.zeros((*at.shape, matrix.shape[1]))
    return np.where((at >= 0)[..., None], matrix[at], 0.0)
