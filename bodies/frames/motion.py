"""Motion data of one evaluation of a spatial frame, and the arrays that its items add to.

Vectors with the index b are in body axes. Derivatives by the turning coordinates q (n of them) hold
at fixed histories: v = c1 x + r1, a = c2 x + r2.
"""

import numpy as np

from sparsemor.bodies.frames.attitude import attitude
from sparsemor.core import Amplitude, FloatArray, FrameWork, Table


class Motion:
    """y: border unknowns; R (m) and turn (attitude.py) the frame's coordinates, the latter at
    `at` of y; A its rotation; w, al: angular rates in body axes with derivatives dw, dal (3, n) by
    q; acc: R'' and acc_b = A^T R'' with dacc_b (3, n); s, s1, s2, form, forms: functionals of u
    (see `Frame.evaluate`)."""

    __slots__ = ("A", "R", "acc", "acc_b", "al", "at", "c1", "c2", "dacc_b", "dal", "dw",
                 "elastic", "form", "forms", "s", "s1", "s2", "t", "turn", "w", "y")

    form: FloatArray
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
        """derivatives: by q; left out where q is given."""
        self.y, self.c1, self.c2, self.t, self.elastic = y, c1, c2, t, False
        self.at = at = slice(3, size)
        self.R, self.acc, self.turn = y[:3], a[:3], attitude(y[at])
        self.A = self.turn.A
        if derivatives:
            self.w, self.al, self.dw, self.dal = self.turn.rates(v[at], a[at], c1, c2)
        else:
            self.w, self.al = self.turn.turning(v[at], a[at])

    def in_body(self, f: FloatArray) -> FloatArray:
        """(3,) A^T f of a vector f of space."""
        return np.asarray(self.A.T.dot(f))

    def factor(self, amplitude: Amplitude) -> float:
        return amplitude(self.t)

    def tabled(self, table: Table) -> FloatArray:
        """(j,)"""
        return table.at(self.t)


class Sums:
    """Views of a FrameWork's arrays and torques in body axes, which items add to.

    rows (b,), H (b, b) with its diagonal (b,); sigma (p,), sigma_y and tau (b, p). torque (3,),
    about the frame origin, is a row like the others until `finish` brings it to those of the
    turning coordinates; torque_y (3, size) and torque_s (3, p) are its derivatives.
    """

    __slots__ = ("H", "border", "coefficients", "diagonal", "kappa_y", "motion", "mu_y", "quad",
                 "rows", "sigma", "sigma_y", "tau", "torque", "torque_s", "torque_y")

    motion: Motion
    """Of the last evaluation: the exact Jacobian needs it once more."""

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
        self.border.fill(0.0)
        self.torque.fill(0.0)
        self.torque_y.fill(0.0)

    def finish(self, m: Motion) -> None:
        """The torque's rows become those of the turning coordinates."""
        self.motion = m
        lever, at = m.turn.lever(), m.at
        self.rows[at] += lever.dot(self.torque)
        self.H[at, : at.stop] += lever.dot(self.torque_y)
        self.H[at, at] += m.turn.of_lever(self.torque)
        if m.elastic:
            self.tau[at] += lever.dot(self.torque_s)
