"""Motion data of one evaluation of a planar frame, and complex views of its result arrays.

The plane is the complex plane: a position is x + i y, the frame rotation e = exp(i theta), and each
pair of directions (f, J f), J a quarter turn, is one complex vector with one complex factor. Real
and imaginary parts are interleaved in the real arrays, so `array.view(complex)` copies nothing.
Python's complex numbers are several times faster than NumPy's scalars, and a step has only dozens
of them.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sparsemor.core import FloatArray
from sparsemor.core.protocols.body_frame import FrameWork

ComplexArray = NDArray[np.complex128]
Numbers: TypeAlias = Sequence[float] | FloatArray
Total: TypeAlias = list[complex] | ComplexArray
FORCE, FORCE_BY_ANGLE, TORQUE_BY_PLACE, TORQUE, FORCE_BY_X, FORCE_BY_Y = 0, 1, 2, 3, 4, 5
"""Entries of `total`, the sums over all items on the left-hand side: force f_x + i f_y, N, and its
derivatives by the angle, x and y; torque, N m, + i times its derivative by the angle; derivative of
the torque by x + i times that by y."""
SUMS = 6
"""Number of these sums."""


class PlaneMotion(NamedTuple):
    """State of one body in the plane.

    y: rigid coordinates and multipliers, v: their rates; r (m), e = exp(i theta), ec its conjugate;
    w, al: angular velocity and acceleration (1/s, 1/s^2); acc: R'' (m/s^2); elastic: True if the
    body deforms, and then s, s1, s2: functionals of u, u' and u'', one complex number per pair, and
    forms (3 g,): u.M_g u, u.M_g u', u.M_g u''. c1, c2: dv = c1 dy, da = c2 dy of the time
    integration; t: s; fresh: False where derivatives need not be written.
    """

    y: Sequence[float] | FloatArray
    v: Sequence[float] | FloatArray
    r: complex
    e: complex
    ec: complex
    w: float
    al: float
    acc: complex
    c1: float
    c2: float
    t: float
    elastic: bool
    s: Sequence[complex] | ComplexArray
    s1: Sequence[complex] | ComplexArray
    s2: Sequence[complex] | ComplexArray
    forms: Sequence[float] | FloatArray
    fresh: bool


class Views(NamedTuple):
    """Complex views (sigma, sigma_y, tau) and real ones of a FrameWork's arrays, created once.

    A pair is two functionals (P_1.u, P_2.u) of the displacements u as one complex number s; y (b,)
    are rigid coordinates and multipliers. sigma (pairs,): factors of the pairs in the elastic rows,
    which are Re(sigma) P_1 + Im(sigma) P_2; sigma_y (b, pairs): their derivatives by y; tau (b,
    pairs): a derivative row tau means d row = Re(conj(tau) ds), so a complex equation d = a ds has
    tau = conj(a) in its real row and i conj(a) in its imaginary one. H (b, b), rows (b,): matrix d
    rows / dy and residual of the equations of y. coefficients (2 g + 1,) = kappa, mu, 1: factors of
    M_g u and M_g u' in the elastic rows, for the g inertia matrices M_g.
    """

    sigma: ComplexArray
    sigma_y: ComplexArray
    tau: ComplexArray
    H: FloatArray
    rows: FloatArray
    coefficients: FloatArray


def views(work: FrameWork) -> Views:
    """Complex views of the arrays of `work`."""
    sigma: ComplexArray = work.sigma.view(np.complex128)
    return Views(sigma[-1], sigma[:-1], work.tau.view(np.complex128), work.border[:, :-1],
                 work.border[:, -1], work.coefficients)


def write(total: Total, fresh: bool, out: Views) -> None:
    """Writes the sums over all items to the rows of (R_x, R_y, theta) and, if `fresh`, to their
    derivatives H by these. Of complex sums a real and an imaginary part are those of x and y, for
    `total[TORQUE]` the torque and its derivative by theta."""
    rows, H, force, torque = out.rows, out.H, total[FORCE], total[TORQUE]
    rows[0], rows[1], rows[2] = force.real, force.imag, torque.real
    if not fresh:
        return
    by_angle, by_place = total[FORCE_BY_ANGLE], total[TORQUE_BY_PLACE]
    by_x, by_y = total[FORCE_BY_X], total[FORCE_BY_Y]
    H[0, 2], H[1, 2], H[2, 2] = by_angle.real, by_angle.imag, torque.imag
    H[2, 0], H[2, 1] = by_place.real, by_place.imag
    H[0, 0], H[1, 0], H[0, 1], H[1, 1] = by_x.real, by_x.imag, by_y.real, by_y.imag
