"""Unit quaternions: the constraint |p| = 1 of the Euler parameters of a frame, and the attitude of
a body from its normalised quaternion, for contact.

Newton iterates include quaternions of other lengths, for which the matrix of body axes is no
rotation: surfaces would be stretched and penetrations wrong.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.attitude import Free, attitude
from sparsemor.bodies.frames.items import RigidItem
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class UnitLength(RigidItem):
    """Constraint (p.p - 1)/2 = 0 of a unit quaternion p, with a multiplier, N m."""

    others = 0
    forces = 1

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(spatial.unit_length, ()),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        mu, p = m.y[k], m.y[m.at]
        out.rows[m.at] += mu * p
        out.rows[k] = 0.5 * (p.dot(p) - 1.0)
        out.H[m.at, k] = out.H[k, m.at] = p
        out.diagonal[m.at] += mu


class UnitQuaternion:
    """Attitude and angular velocity from coordinates q (n,), normalised if a quaternion, and their
    rates.

    A (3, 3): body axes to space axes; w (3,): angular velocity in body axes, rad/s; by (3, n):
    derivative of the rotation (in body axes) by q, equal to that of w by the rates; w_by (3, n):
    derivative of w by q.
    """

    __slots__ = ("A", "_down", "_lever", "_of_lever", "_size", "_unit", "by", "w", "w_by")

    def __init__(self, q: FloatArray, rate: FloatArray) -> None:
        self._size = size = float(np.linalg.norm(q)) if len(q) == Free.size else 1.0
        self._unit = q / size if len(q) == Free.size else np.zeros(len(q))
        turn = attitude(q / size)
        rates = turn.rates(rate / size, rate / size, 0.0, 0.0)
        self._down = (np.eye(len(q)) - np.outer(self._unit, self._unit)) / size
        self._lever, self._of_lever = turn.lever() / size, turn.of_lever
        self.A, self.w, self.by = turn.A, rates[0], self._lever.T
        self.w_by = rates[2] @ self._down - np.outer(self.w, self._unit) / size

    def rows(self, torque: FloatArray) -> FloatArray:
        """(n,) generalized force on the coordinates of a torque (3,) in body axes, N m."""
        return np.asarray(self._lever @ torque)

    def rows_by(self, torque: FloatArray) -> FloatArray:
        """(n, n) derivative of `rows` by the coordinates, for a constant torque."""
        force = self._lever @ torque
        return np.asarray(self._of_lever(torque) @ self._down
                          - np.outer(force, self._unit)) / self._size

    @classmethod
    def of(cls, pose: FloatArray, rate: FloatArray) -> Self:
        """Attitude from rigid coordinates, position first, and their rates."""
        return cls(pose[3:], rate[3:])
