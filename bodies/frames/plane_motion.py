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
SUMS = 6
"""Number of sums over all items (`write`)."""


class PlaneMotion(NamedTuple):
    """State of one body in the plane.

    y: rigid coordinates and multipliers, v: their rates; r (m), e = exp(i theta), ec its conjugate;
    w, al: angular velocity and acceleration (1/s, 1/s^2); acc: R'' (m/s^2); elastic: True if the
    body deforms, and then s, s1, s2: functionals of u, u' and u'', one complex number per pair, and
    forms: quadratic forms of u (see `BodyFrame.evaluate`). fresh: False where derivatives need not
    be written.
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
    """Complex views of a FrameWork's arrays, created once.

    sigma (pairs,), sigma_y and tau (b, pairs): a derivative row tau means d row = Re(conj(tau) ds),
    so a complex equation d = a ds has tau = conj(a) in its real row and i conj(a) in its imaginary
    one. H (b, b), rows (b,): matrix and residual of the b rigid coordinates and multipliers.
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
    """Writes the sums over all items: force and its derivative by the angle, derivatives of the
    torque by x + i y, torque + i its derivative by the angle, derivatives of the force by x and
    y."""
    rows, H, force, torque = out.rows, out.H, total[0], total[3]
    rows[0], rows[1], rows[2] = force.real, force.imag, torque.real
    if not fresh:
        return
    by_angle, by_place, by_x, by_y = total[1], total[2], total[4], total[5]
    H[0, 2], H[1, 2], H[2, 2] = by_angle.real, by_angle.imag, torque.imag
    H[2, 0], H[2, 1] = by_place.real, by_place.imag
    H[0, 0], H[1, 0], H[0, 1], H[1, 1] = by_x.real, by_x.imag, by_y.real, by_y.imag
