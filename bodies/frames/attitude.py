"""Attitude of a body frame: free (unit quaternion), or about the z axis of space (angle).

The equations need the rotation matrix A and its derivatives by the attitude coordinates only, so
both parametrisations share one implementation. The angle suits bodies that rotate about a fixed
axis: it needs no multiplier, and BDF1 keeps a constant rate exactly, whereas each step reduces the
rate of a quaternion by the fraction (w h)^2 / 8.
"""

from math import atan2
from typing import Self, TypeAlias

import numpy as np

from sparsemor.bodies.frames import rotation as rot
from sparsemor.core import FloatArray
from sparsemor.core.protocols.poses import FREE_POSE, vectors_in_space

Rates: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Angular velocity w and acceleration alpha (3,) in body axes, 1/s and 1/s^2, and their derivatives
(3, n) by the attitude coordinates."""


class Free:
    """Attitude by a unit quaternion p (4,), with rotation matrix A = E G^T (3, 3) from body to
    space axes; E(p), G(p) (3, 4) are linear in p, and the angular velocity in body axes is w = 2 G
    p' (rotation.py). n = 4 attitude coordinates."""

    __slots__ = ("A", "E", "G", "p")
    size = 4

    def __init__(self, p: FloatArray) -> None:
        self.p, self.E, self.G = p, rot.to_space(p), rot.to_body(p)
        self.A = self.E.dot(self.G.T)

    def of_body(self, b: FloatArray) -> FloatArray:
        """(3, n) derivative of A b by the attitude coordinates."""
        return rot.of_body_vector(self.E, b)

    def of_space(self, f: FloatArray) -> FloatArray:
        """(3, n) derivative of A^T f by the attitude coordinates."""
        return rot.of_space_vector(self.G, f)

    def bend(self, f: FloatArray, b: FloatArray) -> FloatArray:
        """(n, n) second derivative of f . A b by the attitude coordinates."""
        return rot.bend(f, b)

    def turning(self, q1: FloatArray, q2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Angular velocity and acceleration (3,) in body axes, without derivatives; q1, q2: rates
        of the coordinates."""
        return 2.0 * self.G.dot(q1), 2.0 * self.G.dot(q2)

    def rates(self, q1: FloatArray, q2: FloatArray, c1: float, c2: float) -> Rates:
        """Angular velocity, acceleration and their derivatives by the coordinates, where q1, q2
        change by c1, c2 times the coordinates.

        Uses that G is linear in p and G(p) q = -G(q) p.
        """
        G = self.G
        return (*self.turning(q1, q2), (2.0 * c1) * G - 2.0 * rot.to_body(q1),
                (2.0 * c2) * G - 2.0 * rot.to_body(q2))

    def lever(self) -> FloatArray:
        """(n, 3) generalized force on the attitude coordinates per torque in body axes."""
        return 2.0 * self.G.T

    def of_lever(self, torque: FloatArray) -> FloatArray:
        """(n, n) derivative of lever @ torque by the attitude coordinates."""
        return rot.of_moment(torque)


Z = np.array([[0.0], [0.0], [1.0]])


class Spin:
    """Attitude by an angle (1,), rad, about the common z axis of space and body.

    Methods as in `Free`, with n = 1: of_body = d (A b) / dq, of_space = d (A^T f) / dq, bend = d^2
    (f . A b) / dq^2, turning = (w, alpha) in body axes, rates = these with their derivatives by q,
    lever = generalized force per torque in body axes, of_lever = d (lever torque) / dq. Z (3, 1):
    the z axis.
    """

    __slots__ = ("A",)
    size = 1

    def __init__(self, q: FloatArray) -> None:
        c, s = np.cos(q[0]), np.sin(q[0])
        self.A = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def of_body(self, b: FloatArray) -> FloatArray:
        return np.asarray(self.A.dot([[-b[1]], [b[0]], [0.0]]))

    def of_space(self, f: FloatArray) -> FloatArray:
        b = self.A.T.dot(f)
        return np.array([[b[1]], [-b[0]], [0.0]])

    def bend(self, f: FloatArray, b: FloatArray) -> FloatArray:
        return np.array([[-f.dot(self.A.dot([b[0], b[1], 0.0]))]])

    def turning(self, q1: FloatArray, q2: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([0.0, 0.0, q1[0]]), np.array([0.0, 0.0, q2[0]])

    def rates(self, q1: FloatArray, q2: FloatArray, c1: float, c2: float) -> Rates:
        return (*self.turning(q1, q2), c1 * Z, c2 * Z)

    def lever(self) -> FloatArray:
        return Z.T

    def of_lever(self, torque: FloatArray) -> FloatArray:
        return np.zeros((1, 1))


Attitude: TypeAlias = Free | Spin


def attitude(q: FloatArray) -> Attitude:
    """Attitude with coordinates q: quaternion (4,) or angle (1,)."""
    return Free(q) if len(q) == Free.size else Spin(q)


class UnitQuaternion:
    """Attitude and angular velocity from coordinates q (n,), normalised if a quaternion, and their
    rates, for contact: Newton iterates include quaternions of other lengths, for which the matrix
    of body axes is no rotation, so that surfaces would be stretched and penetrations wrong.

    A (3, 3): body axes to space axes; w (3,): angular velocity in body axes, rad/s; by (3, n):
    derivative of the rotation (in body axes) by q, equal to that of w by the rates; w_by (3, n):
    derivative of w by q.
    """

    __slots__ = ("A", "_down", "_lever", "_of_lever", "_size", "_unit", "by", "w", "w_by")

    def __init__(self, q: FloatArray, rate: FloatArray) -> None:
        # |q| and q / |q| of a quaternion; an angle is left as it is: 1 and 0
        self._size = size = float(np.linalg.norm(q)) if len(q) == Free.size else 1.0
        self._unit = q / size if len(q) == Free.size else np.zeros(len(q))
        turn = attitude(q / size)
        rates = turn.rates(rate / size, rate / size, 0.0, 0.0)  # w and dw/dq; accelerations unused
        # derivative of q / |q|; of an angle, which is not normalised, 1
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
    def from_pose(cls, pose: FloatArray, rate: FloatArray) -> Self:
        """Attitude from rigid coordinates, position first, and their rates."""
        return cls(pose[3:], rate[3:])


Jet: TypeAlias = tuple[float, FloatArray, FloatArray]
"""A function of n rigid coordinates with its first (n,) and second (n, n) derivatives."""


def of_angle(cosine: Jet, sine: Jet) -> Jet:
    """Angle atan2(s, c), rad, from its cosine and sine, both times one factor."""
    (c, c1, c2), (s, s1, s2) = cosine, sine
    size = c * c + s * s
    along = (c * s1 - s * c1) / size
    bend = (np.outer(s1, c1) - np.outer(c1, s1) + c * s2 - s * c2) / size - np.outer(
        along, 2.0 * (c * c1 + s * s1) / size)
    return atan2(s, c), along, bend


def vector_rates(pose: FloatArray, rate: FloatArray, z: FloatArray) -> FloatArray:
    """(T, d) time derivatives of A z, a vector z (d,) in body axes, from rigid coordinates (T, n)
    and their rates."""
    if pose.shape[1] == FREE_POSE:  # A is quadratic in the quaternion: this difference is exact
        return np.asarray(
            0.5 * (vectors_in_space(pose + rate, z) - vectors_in_space(pose - rate, z)))
    arm = vectors_in_space(pose, z)
    made = np.zeros_like(arm)
    made[:, 0], made[:, 1] = -rate[:, -1] * arm[:, 1], rate[:, -1] * arm[:, 0]
    return made


def velocity_at(pose: FloatArray, velocity: FloatArray, z: FloatArray) -> FloatArray:
    """(d,) velocity, m/s, of a material point z (d,), m, of a body, from its rigid coordinates and
    their rates."""
    return np.asarray(velocity[: len(z)] + vector_rates(pose[None], velocity[None], z)[0])
