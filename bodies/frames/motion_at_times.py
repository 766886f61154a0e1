"""Loads on the displacements of a body with prescribed frame motion, at many times at once.

`MotionAtTimes` has the interface of `Motion` (one time) as far as `push` needs it, so each item has
one formula for both (notation: motion.py).
"""

import numpy as np

from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames.attitude import Free
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import Amplitude, FloatArray, Table
from sparsemor.core.protocols.separable import amplitudes_along


class MotionAtTimes:
    """Motion of a frame at T times: A (T, 3, 3), body axes to space axes; w, al (T, 3), angular
    velocity and acceleration in body axes; acc (T, 3) = R'', m/s^2."""

    __slots__ = ("A", "acc", "al", "c1", "times", "w")

    def __init__(
        self, size: int, y: FloatArray, v: FloatArray, a: FloatArray, times: FloatArray
    ) -> None:
        """y, v, a (T, b): rigid coordinates and multipliers with their rates, position first; size:
        number of rigid coordinates."""
        self.times, self.acc, at = times, a[:, :3], slice(3, size)
        turned = _freely if size - 3 == Free.size else _about_z
        self.A, self.w, self.al = turned(y[:, at], v[:, at], a[:, at])

    def in_body(self, f: FloatArray) -> FloatArray:
        """(T, 3) components A^T f in body axes of a vector f in space axes, (3,) or (T, 3)."""
        return np.asarray(np.matmul(f[..., None, :], self.A)[..., 0, :])

    def factor(self, amplitude: Amplitude) -> FloatArray:
        """(T, 1) values of an amplitude at the times."""
        return amplitudes_along((amplitude,), self.times)

    def tabled(self, table: Table) -> FloatArray:
        """(T, j) values of a table at the times."""
        return table.along(self.times)


class Pushes:
    """Loads on the displacements at T times: factors sigma (T, p) of the p functionals, and
    coefficients (T, 2 g) of the g inertia matrices; counterpart of `Sums`."""

    __slots__ = ("coefficients", "sigma")

    def __init__(self, T: int, p: int, g: int) -> None:
        self.sigma, self.coefficients = np.zeros((T, p)), np.zeros((T, 2 * g))


Moved = Motion | MotionAtTimes
"""Frame motion at one time or at many, with in_body, factor, tabled, w, al, acc."""
Pushed = Sums | Pushes


def _freely(
    p: FloatArray, p1: FloatArray, p2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A (T, 3, 3), w (T, 3) and alpha (T, 3) of quaternions p (T, 4) and their rates p1, p2, as in
    `attitude.Free`."""
    E, G = (np.moveaxis(T(p.T), -1, 0) for T in (rot.to_space, rot.to_body))
    w, al = (2.0 * np.matmul(G, q[..., None])[..., 0] for q in (p1, p2))
    return np.matmul(E, G.transpose(0, 2, 1)), w, al


def _about_z(
    q: FloatArray, q1: FloatArray, q2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A (T, 3, 3), w (T, 3) and alpha (T, 3) of angles q (T, 1), rad, and their rates q1, q2, as in
    `attitude.Spin`."""
    A, w, al = np.zeros((len(q), 3, 3)), np.zeros((len(q), 3)), np.zeros((len(q), 3))
    A[:, 0, 0] = A[:, 1, 1] = np.cos(q[:, 0])
    A[:, 1, 0] = np.sin(q[:, 0])
    A[:, 0, 1] = -A[:, 1, 0]
    A[:, 2, 2], w[:, 2], al[:, 2] = 1.0, q1[:, 0], q2[:, 0]
    return A, w, al
