"""Motion data of one evaluation of a planar frame, and complex views of its result arrays.

The plane is the complex plane: a position is x + i y, the frame rotation e = exp(i theta), and each
pair of directions (f, J f), J a quarter turn, is one complex vector with one complex factor. Real
and imaginary parts are interleaved in the real arrays, so `array.view(complex)` copies nothing.
Python's complex numbers are several times faster than NumPy's scalars, and a step has only dozens
of them.
"""

import cmath

import numpy as np
from numpy.typing import NDArray

from sparsemor.core import FloatArray, FrameWork

ComplexArray = NDArray[np.complex128]


class Motion:
    """State of one body in the plane. y: rigid coordinates and multipliers; r (m), e = exp(i
    theta), ec its conjugate; w, al: angular velocity and acceleration (1/s, 1/s^2); acc: R''
    (m/s^2); s, s1, s2: functionals of u, u' and u'', one complex number per pair;
    forms: quadratic forms of u (see `BodyFrame.evaluate`)."""

    __slots__ = ("acc", "al", "c1", "c2", "e", "ec", "forms", "r", "s", "s1", "s2", "t",
                 "w", "y")

    def __init__(
        self, y: list[float], w: float, acc: complex, al: float, c1: float, c2: float, t: float
    ) -> None:
        self.y, self.w, self.acc, self.al = y, w, acc, al
        self.c1, self.c2, self.t = c1, c2, t
        self.r, self.e = complex(y[0], y[1]), cmath.exp(1j * y[2])
        self.ec = self.e.conjugate()
        self.s: list[complex] = []
        self.s1: list[complex] = []
        self.s2: list[complex] = []
        self.forms: list[float] = []


class Views:
    """Complex views of a FrameWork's arrays, created once.

    sigma (pairs,), sigma_y and tau (b, pairs): a derivative row tau means d row = Re(conj(tau) ds),
    so a complex equation d = a ds has tau = conj(a) in its real row and i conj(a) in its imaginary
    one. H (b, b), rows (b,): matrix and residual of the b rigid coordinates and multipliers.
    """

    __slots__ = ("H", "coefficients", "kappa_y", "mu_y", "quad", "rows", "sigma", "sigma_y", "tau")

    def __init__(self, work: FrameWork) -> None:
        sigma: ComplexArray = work.sigma.view(np.complex128)
        self.sigma, self.sigma_y = sigma[-1], sigma[:-1]
        self.tau: ComplexArray = work.tau.view(np.complex128)
        self.H: FloatArray = work.border[:, :-1]
        self.rows: FloatArray = work.border[:, -1]
        self.coefficients, self.kappa_y = work.coefficients, work.kappa_y
        self.mu_y, self.quad = work.mu_y, work.quad

    def write(self, total: list[float]) -> None:
        """Writes the sums over all items: rows 0-2, then H02, H12, H20, H21, H22, H00 = H11."""
        rows, H = self.rows, self.H
        rows[0], rows[1], rows[2] = total[0], total[1], total[2]
        H[0, 2], H[1, 2], H[2, 0], H[2, 1] = total[3], total[4], total[5], total[6]
        H[2, 2] = total[7]
        H[0, 0] = H[1, 1] = total[8]
