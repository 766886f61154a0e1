"""Motion data of a spatial frame at one time or at many, and the arrays to which its items add.

Notation of all frames: the *border* unknowns y are rigid coordinates, then multipliers; u are
displacements in body axes. A frame reads them by *functionals* s = P^T u, s1 = P^T u', s2 = P^T u''
and by second moments u.M_g u; it acts on them by sigma (P sigma), kappa and mu (kappa_g M_g u +
mu_g M_g u'). tau are derivatives of its rows by s, sigma_y those of sigma by y. R is the position,
A the rotation matrix, w and al angular velocity and acceleration, skew(w) = w~. An item is called
with its first functional j, coordinate of another body o and multiplier k; that body is "far" or
"other".

Vectors with the index b are in body axes. Derivatives by the n attitude coordinates q are for fixed
step formula of the time integration: dv = c1 dx, da = c2 dx.
"""

import numpy as np

from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames.attitude import Free, attitude
from sparsemor.core import Amplitude, FloatArray, Table
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.separable import amplitudes_along


class Motion:
    """State of one body frame in space. y: rigid coordinates and multipliers, v: their rates; R
    (m): position; turn: attitude (attitude.py), whose coordinates are at `at` in y; A: its rotation
    matrix; w, al: angular velocity and acceleration in body axes with derivatives dw, dal (3, n) by
    q; acc: R'' and acc_b = A^T R'' with dacc_b (3, n); c1, c2: dv = c1 dy, da = c2 dy of the time
    integration; t: s. elastic: True if the body deforms; then s, s1, s2 (p,): functionals of u, u',
    u'', and forms (3 g,): u.M_g u, u.M_g u', u.M_g u'' (set by the frame)."""

    __slots__ = ("A", "R", "acc", "acc_b", "al", "at", "c1", "c2", "dacc_b", "dal", "dw",
                 "elastic", "forms", "s", "s1", "s2", "t", "turn", "v", "w", "y")

    forms: FloatArray
    s: FloatArray
    s1: FloatArray
    s2: FloatArray
    acc_b: FloatArray
    dacc_b: FloatArray

    def __init__(
        self, size: int, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        t: float, derivatives: bool = True,
    ) -> None:
        """size: number of own rigid coordinates, the first in y, v, a (b,), position first; turn:
        attitude with coordinates q = y[at]; derivatives: compute those of w, al by q; not needed
        for prescribed motion."""
        self.y, self.v, self.c1, self.c2, self.t, self.elastic = y, v, c1, c2, t, False
        self.at = at = slice(3, size)
        self.R, self.acc, self.turn = y[:3], a[:3], attitude(y[at])
        self.A = self.turn.A
        if derivatives:
            self.w, self.al, self.dw, self.dal = self.turn.rates(v[at], a[at], c1, c2)
        else:
            self.w, self.al = self.turn.turning(v[at], a[at])

    def in_body(self, f: FloatArray) -> FloatArray:
        """(3,) components A^T f in body axes of a vector f in space axes."""
        return np.asarray(self.A.T.dot(f))

    def factor(self, amplitude: Amplitude) -> float:
        return amplitude(self.t)

    def tabled(self, table: Table) -> FloatArray:
        """(j,) values of a table at the time t."""
        return table.at(self.t)


class Sums:
    """Views of a FrameWork's arrays, and torques in body axes, to which items add.

    rows (b,): residual of the b rigid coordinates and multipliers; H (b, b): its matrix with the
    diagonal (b,); sigma (p,): factors of the p functionals in the elastic equations; sigma_y (b,
    p): derivatives of sigma by y, tau (b, p): of rows by the functionals; coefficients (2 g + 1,):
    factors kappa of M_g u, mu of M_g u', and 1; kappa_y, mu_y (b, g): derivatives of kappa, mu by
    y; quad (b, 3, g): of rows by u.M_g u, u.M_g u', u.M_g u''. torque (3,), about the frame origin,
    is accumulated separately until `finish` converts it to the attitude coordinates; torque_y (3,
    size) and torque_s (3, p) are its derivatives.
    """

    __slots__ = ("H", "border", "coefficients", "diagonal", "kappa_y", "motion", "mu_y", "quad",
                 "rows", "sigma", "sigma_y", "tau", "torque", "torque_s", "torque_y")

    motion: Motion
    """Motion of the last evaluation, used again by the exact Jacobian."""

    def __init__(self, work: FrameWork, size: int) -> None:
        self.border, self.tau = work.border, work.tau
        self.H, self.rows = work.border[:, :-1], work.border[:, -1]
        self.diagonal = np.einsum("ii->i", self.H)  # a view
        self.sigma, self.sigma_y = work.sigma[-1], work.sigma[:-1]
        self.coefficients, self.kappa_y = work.coefficients, work.kappa_y
        self.mu_y, self.quad = work.mu_y, work.quad
        self.torque, self.torque_y = np.zeros(3), np.zeros((3, size))
        self.torque_s = np.zeros((3, self.tau.shape[1]))

    def clear(self) -> None:
        """Sets to zero what items add to; the other arrays they overwrite."""
        self.border.fill(0.0)
        self.torque.fill(0.0)
        self.torque_y.fill(0.0)

    def finish(self, m: Motion) -> None:
        """Converts the torque and its derivatives to generalized forces on the attitude
        coordinates."""
        self.motion = m
        lever, at = m.turn.lever(), m.at
        self.rows[at] += lever.dot(self.torque)
        self.H[at, : at.stop] += lever.dot(self.torque_y)
        self.H[at, at] += m.turn.of_lever(self.torque)
        if m.elastic:
            self.tau[at] += lever.dot(self.torque_s)


class MotionAtTimes:
    """Prescribed motion of a frame in space at T times, with the interface of `Motion`: A (T, 3,
    3), body axes to space axes; w, al (T, 3), angular velocity and acceleration in body axes; acc
    (T, 3) = R'', m/s^2. Its attitude is a quaternion (`_freely`) or an angle about z
    (`_about_z`)."""

    __slots__ = ("A", "acc", "al", "c1", "times", "w")

    def __init__(
        self, size: int, y: FloatArray, v: FloatArray, a: FloatArray, times: FloatArray
    ) -> None:
        """y, v, a (T, b): rigid coordinates and multipliers with their rates, position first; size:
        number of rigid coordinates."""
        self.times, self.acc, at = times, a[:, :3], slice(3, size)
        attitudes = _freely if size - 3 == Free.size else _about_z
        self.A, self.w, self.al = attitudes(y[:, at], v[:, at], a[:, at])

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
    E, G = (np.moveaxis(T(p.T), -1, 0) for T in (rot.to_space, rot.to_body))  # (T, 3, 4)
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
