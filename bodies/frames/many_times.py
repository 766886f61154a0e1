"""A frame whose motion is given at many times: what its items push on displacements, all at once.

`MotionAtTimes` is to many times what `Motion` is to one, as far as `push` needs it, so that each
item has one formula for both (notation: motion.py).
"""

import numpy as np

from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames.attitude import Free
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import Amplitude, FloatArray, Table, amplitudes_along


class MotionAtTimes:
    """A (T, 3, 3), body axes to space axes; w, al (T, 3) in body axes; acc (T, 3) = R''."""

    __slots__ = ("A", "acc", "al", "c1", "times", "w")

    def __init__(
        self, size: int, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, times: FloatArray
    ) -> None:
        """y, v, a (T, b): border unknowns and their rates; size: of the frame's coordinates."""
        self.c1, self.times, self.acc, at = c1, times, a[:, :3], slice(3, size)
        turned = _freely if size - 3 == Free.size else _about_z
        self.A, self.w, self.al = turned(y[:, at], v[:, at], a[:, at])

    def in_body(self, f: FloatArray) -> FloatArray:
        """(T, 3) A^T f of a vector f of space, (3,) or (T, 3)."""
        return np.asarray(np.matmul(f[..., None, :], self.A)[..., 0, :])

    def factor(self, amplitude: Amplitude) -> FloatArray:
        """(T, 1)"""
        return amplitudes_along((amplitude,), self.times)

    def tabled(self, table: Table) -> FloatArray:
        """(T, j)"""
        return table.along(self.times)


class Pushes:
    """sigma (T, p) and coefficients (T, 2 g), written to by items as those of `Sums`."""

    __slots__ = ("coefficients", "sigma")

    def __init__(self, T: int, p: int, g: int) -> None:
        self.sigma, self.coefficients = np.zeros((T, p)), np.zeros((T, 2 * g))


Moved = Motion | MotionAtTimes
"""At one time or many: `in_body`, `factor`, `tabled`, w, al, acc, c1."""
Pushed = Sums | Pushes


def _freely(
    p: FloatArray, p1: FloatArray, p2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A, w, alpha of quaternions (T, 4) and their rates, as `attitude.Free` has them."""
    E, G = (np.moveaxis(T(p.T), -1, 0) for T in (rot.to_space, rot.to_body))
    w, al = (2.0 * np.matmul(G, q[..., None])[..., 0] for q in (p1, p2))
    return np.matmul(E, G.transpose(0, 2, 1)), w, al


def _about_z(
    q: FloatArray, q1: FloatArray, q2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same of angles (T, 1), as `attitude.Spin` has them."""
    A, w, al = np.zeros((len(q), 3, 3)), np.zeros((len(q), 3)), np.zeros((len(q), 3))
    A[:, 0, 0] = A[:, 1, 1] = np.cos(q[:, 0])
    A[:, 1, 0] = np.sin(q[:, 0])
    A[:, 0, 1] = -A[:, 1, 0]
    A[:, 2, 2], w[:, 2], al[:, 2] = 1.0, q1[:, 0], q2[:, 0]
    return A, w, al
