"""Parts of a planar frame's equations in complex numbers: inertia, forces, attachments,
constraints.

Each is a function of its constant `numbers`, the present value g of its amplitude, and the motion.
It adds its force and torque to `total` (`plane_motion.write`) and writes its own columns: pairs of
functionals from number j on, coordinates of another body from o on, multipliers from k on. The data
are those of the classes of the same names in frame_items.py, inertia.py, springs.py and
constraints.py, whose `in_plane` creates them; notation: plane_motion.py. The functions are also
compiled (core/protocols/body_frame.py): they use numbers and arrays only.
"""

from cmath import exp
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from sparsemor.bodies.frames.plane_motion import (
    FORCE,
    FORCE_BY_ANGLE,
    FORCE_BY_X,
    FORCE_BY_Y,
    SUMS,
    TORQUE,
    TORQUE_BY_PLACE,
    Numbers,
    PlaneMotion,
    Total,
    Views,
    write,
)
from sparsemor.bodies.frames.plane_springs import (
    relative,
    rotational_spring,
    spring,
)
from sparsemor.core import Amplitude, FloatArray, IntArray, Table

PlaneFunction: TypeAlias = Callable[
    [Numbers, float, PlaneMotion, int, int, int, Total, Views], None]
"""Part of the equations, function(numbers, g, m, j, o, k, total, out): its constants, amplitude,
motion, and first pair of functionals, coordinate of another body and multiplier (module docstring).
In m.y and in rows of `out` 0, 1, 2 are x, y and the angle of the own body."""


class PlanePart(NamedTuple):
    """Part of a planar frame's equations: a function with its numbers and amplitude (None: constant
    1)."""

    function: PlaneFunction
    numbers: tuple[float, ...]
    amplitude: Amplitude | None = None


def inertia(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Inertia of a body (`PlaneFunction`). numbers: mass, kg, sum m X (2), kg m, X.M X, kg m^2,
    about the frame origin.

    Two pairs of functionals: S = m 1 (first moment) and M X (equations.md, section 1). Adds the
    inertia force A sum(M acc) and torque sum z x M acc with z = X + u and, in complex numbers,
    acc = conj(e) R'' + (i al - w^2) z + 2 i w u' + u''.
    """
    mass, second = numbers[0], numbers[3]
    e, ec, w, al, c1, c2 = m.e, m.ec, m.w, m.al, m.c1, m.c2
    spin = complex(-w * w, al)
    # first moments of z, u', u''; second moments z.M z, z.M u', (i z).M u''
    p, p1, p2 = complex(numbers[1], numbers[2]), 0j, 0j
    zz, zv, za = second, 0.0, 0.0
    if m.elastic:
        p, p1, p2 = p + m.s[j], m.s1[j], m.s2[j]
        n = len(m.forms) // 3  # forms: n of values, n of rates, n of second rates
        zz += 2 * m.s[j + 1].real + m.forms[0]
        zv, za = m.s1[j + 1].real + m.forms[n], m.s2[j + 1].imag - m.forms[2 * n + 1]
    swing = e * (spin * p + 2j * w * p1 + p2)
    f = mass * m.acc + swing
    lever = p.conjugate() * ec
    arm = lever * m.acc
    total[FORCE] += f
    total[TORQUE] += complex(
        arm.imag + al * zz + 2 * w * zv + za, c2 * zz + 2 * c1 * zv - arm.real)
    acc_b = ec * m.acc  # A^T R''
    if m.elastic:
        out.sigma[j], out.sigma[j + 1] = acc_b, spin
        on_u = out.coefficients  # kappa = (-w^2, al), mu = (0, 2 w), and a 1
        on_u[0], on_u[1], on_u[len(on_u) // 2 + 1] = -w * w, al, 2 * w
    if not m.fresh:
        return
    spin_by = complex(-2 * w * c1, c2)  # by the angle
    total[FORCE_BY_ANGLE] += 1j * swing + e * (spin_by * p + 2j * c1 * p1)
    total[TORQUE_BY_PLACE] += 1j * c2 * lever.conjugate()
    total[FORCE_BY_X] += mass * c2
    total[FORCE_BY_Y] += 1j * mass * c2
    if m.elastic:
        sy, tau, acc_by_angle, acc_by_x = out.sigma_y, out.tau, -1j * acc_b, c2 * ec
        sy[0, j], sy[1, j], sy[2, j], sy[2, j + 1] = (
            acc_by_x, 1j * acc_by_x, acc_by_angle, spin_by)
        # of the force by u, with u' and u'': e (spin + 2 i w c1 + c2), tau its conjugate (`Views`)
        nu = (e * (spin - 1j * spin_by)).conjugate()
        tau[0, j], tau[1, j], tau[2, j] = nu, 1j * nu, acc_by_angle
        tau[2, j + 1] = complex(2 * al + 2 * w * c1, c2)


def body_force(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Load that rotates with the body (`PlaneFunction`). numbers: sum f (2), N, sum X x f, N m.

    Pair j of functionals: the load itself, sum u . f (real part), and sum u x f (imaginary part).
    g: factor of the load at time t; o, k: not used. Loads are subtracted on the left-hand side:
    sigma, factors of the pairs in the elastic rows, is -g, and tau, where d row = Re(conj(tau) ds),
    gives d torque = -g Im ds. The real part of total[TORQUE] is the torque.
    """
    f = m.e * complex(numbers[0], numbers[1]) * g
    arm = numbers[2] + (m.s[j].imag if m.elastic else 0.0)
    total[FORCE] -= f
    total[FORCE_BY_ANGLE] -= 1j * f
    total[TORQUE] -= g * arm
    if m.elastic:
        out.sigma[j] = -g
        out.tau[2, j] = -1j * g


def space_force(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Nodal weights times one force in space axes (`PlaneFunction`). numbers: sum w, sum w X (2),
    force per unit weight (2), N. g: factor of the force at time t; j: pair of functionals sum w u;
    o, k: not used. Loads are subtracted; sigma: factors of the pairs in the elastic rows, sigma_y:
    d sigma / dy, tau: d rows / ds (`Views`); m.fresh: derivatives are to be written."""
    f = g * complex(numbers[3], numbers[4])
    fb = m.ec * f  # in body axes
    arm = complex(numbers[1], numbers[2]) + (m.s[j] if m.elastic else 0j)
    total[FORCE] -= numbers[0] * f
    # torque -Im(conj(arm) fb), and i times its derivative by the angle, Re(conj(arm) fb)
    total[TORQUE] += 1j * arm.conjugate() * fb
    if m.elastic:
        out.sigma[j] = -fb
        if m.fresh:
            out.sigma_y[2, j] = out.tau[2, j] = 1j * fb


def moment(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Moment on a body or on the mean rotation of a set (`PlaneFunction`). numbers: moment, N m; 1
    where the set turns, 0 for the body itself."""
    total[TORQUE] -= g * numbers[0]
    if m.elastic and numbers[1] > 0.0:
        out.sigma[j] = -g * numbers[0]


def attachment(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Position r + e z of the mean point z of a set as two constraint rows, and the force of their
    multipliers on it (`PlaneFunction`). numbers: z = sum w X (2), m, with sum w = 1.

    j: pair of functionals, the mean displacement; k: first of two multipliers; g, o: not used.
    sigma: factors of pairs in the elastic rows, sigma_y: d sigma / dy; tau: d row = Re(conj(tau)
    ds).
    """
    ec, y = m.ec, m.y
    z = complex(numbers[0], numbers[1]) + (m.s[j] if m.elastic else 0j)
    f = complex(y[k], y[k + 1])
    fb, rz = ec * f, m.e * z
    at = m.r + rz
    total[FORCE] += f
    # torque Im(conj(z) fb), and i times its derivative by the angle
    total[TORQUE] -= 1j * z.conjugate() * fb
    rows, H = out.rows, out.H
    rows[k], rows[k + 1] = at.real, at.imag
    if m.elastic:
        out.sigma[j] = fb
    if not m.fresh:
        return
    H[0, k] = H[1, k + 1] = H[k, 0] = H[k + 1, 1] = 1.0
    H[2, k] = H[k, 2] = -rz.imag
    H[2, k + 1] = H[k + 1, 2] = rz.real
    if m.elastic:
        sy, tau = out.sigma_y, out.tau
        sy[k, j] = tau[k, j] = ec
        sy[k + 1, j] = tau[k + 1, j] = 1j * ec
        sy[2, j] = tau[2, j] = -1j * fb


def rotation(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Rotation theta of a body, plus the mean rotation of a set, as a constraint row; its
    multiplier is a moment, N m (`PlaneFunction`).

    numbers: 1 where the set turns, 0 for the body itself; mean rotation in the shape from which
    displacements are measured, rad. The mean rotation of displacements is the real part of the pair
    j of functionals, whose imaginary part is 0; k: the multiplier; g, o: not used. sigma: factors
    of pairs in the elastic rows, sigma_y: d sigma / dy, tau: d rows / ds.
    """
    turns, start = numbers[0] > 0.0, numbers[1]
    theta, moment, deforms = m.y[2], m.y[k], turns and m.elastic
    total[TORQUE] += moment
    out.rows[k] = theta + start + (m.s[j].real if deforms else 0.0)
    out.H[2, k] = out.H[k, 2] = 1.0
    if deforms:
        out.sigma[j] = moment
        out.sigma_y[k, j] = out.tau[k, j] = 1.0


def slide(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Point-on-line constraint Re(conj(n) (r + e z - r_o)) - base = 0, n = e_o line, with the force
    lambda n on the own point z (`PlaneFunction`).

    numbers: z (2), m; in the other body's axes unit normal `line` (2) and offset `base`, m, of the
    line; 1 where the other body's coordinates are unknowns, else 0; its coordinates (3) at rest. j:
    pair of functionals, the displacement of z; o: first coordinate of the other body; k: the
    multiplier lambda; g: not used. m: inputs y (own coordinates first), r = x + i y, e = exp(i
    angle) and its conjugate ec, pairs of functionals s as complex numbers. total: force, and torque
    + i times its derivative by the angle; the caller makes the own rows 0 to 2 of them. sigma:
    factors of pairs in the elastic rows, sigma_y: d sigma / dy, tau: d row = Re(conj(tau) ds); all
    H = d rows / dy from the potential lambda times constraint.
    """
    z, line, base = complex(numbers[0], numbers[1]), complex(numbers[2], numbers[3]), numbers[4]
    z, lam = z + (m.s[j] if m.elastic else 0j), m.y[k]
    moves = numbers[5] > 0.0
    x, y, angle = numbers[6], numbers[7], numbers[8]
    if moves:
        x, y, angle = m.y[o], m.y[o + 1], m.y[o + 2]
    n, rz = exp(1j * angle) * line, m.e * z
    gap, f, fb = m.r + rz - complex(x, y), lam * n, lam * m.ec * n
    # the torque is its imaginary part, minus the real one the derivative by the own angle
    torque = z.conjugate() * fb
    total[FORCE] += f
    total[TORQUE] -= 1j * torque
    rows, H, pull = out.rows, out.H, n.conjugate() * gap
    rows[k] = pull.real - base
    H[k, 0], H[k, 1], H[k, 2] = n.real, n.imag, (rz.conjugate() * n).imag
    H[0, k], H[1, k], H[2, k] = H[k, 0], H[k, 1], H[k, 2]
    if moves:
        along = torque.real  # lam Re(conj(e z) n)
        rows[o], rows[o + 1], rows[o + 2] = -f.real, -f.imag, lam * pull.imag
        H[k, o], H[k, o + 1], H[k, o + 2] = -n.real, -n.imag, pull.imag
        H[0, o + 2], H[1, o + 2], H[2, o + 2] = -f.imag, f.real, along
        H[o, o + 2], H[o + 1, o + 2] = f.imag, -f.real
        for i in (k, 0, 1, 2, o, o + 1):
            H[o + 2, i] = H[i, o + 2]
        H[o, k], H[o + 1, k] = H[k, o], H[k, o + 1]
        H[o + 2, o + 2] = -lam * pull.real
    if m.elastic:
        sy, tau = out.sigma_y, out.tau
        out.sigma[j] = fb
        sy[k, j] = tau[k, j] = m.ec * n
        sy[2, j] = tau[2, j] = -1j * fb
        if moves:
            sy[o + 2, j] = tau[o + 2, j] = 1j * fb


def compliance(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Minus the compliance of a constraint times its multiplier (`PlaneFunction`). numbers: the
    compliance, m/N or rad/(N m)."""
    out.rows[k] = -numbers[0] * m.y[k]
    out.H[k, k] = -numbers[0]


@dataclass(frozen=True, slots=True, eq=False)
class PlaneReaction:
    """Prescribed joint force (N) and, with `turns`, moment (N m) in space axes, table `forces_at`
    (T, 3), on displacements alone: a `PlaneFunction` that is not compiled. Pairs of functionals: j
    the mean displacement, j + 1 the mean rotation; sigma: their factors on the left-hand side of
    the elastic rows, with the sign of multipliers; the other arguments are not used."""

    forces_at: Table
    turns: bool

    def __call__(
        self, numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total,
        out: Views
    ) -> None:
        if m.elastic:
            x, y, moment = self.forces_at.at(m.t).tolist()
            out.sigma[j] = m.ec * complex(x, y)
            if self.turns:
                out.sigma[j + 1] = moment


def stiffening(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Factors of geometric stiffness, those of all loads (`frame_items.Stiffening`), of which it is
    the last part (`PlaneFunction`). numbers: count of functionals, of inertia matrices."""
    first = int(numbers[1])
    for i in range(int(numbers[0]) // 2):
        out.coefficients[first + 2 * i] = out.sigma[i].real
        out.coefficients[first + 2 * i + 1] = out.sigma[i].imag


FUNCTIONS: tuple[PlaneFunction, ...] = (
    inertia, body_force, space_force, attachment, rotation, slide, moment, spring,
    rotational_spring, relative, compliance, stiffening)
"""Functions of parts; the position is the kind of part in `evaluate_parts`."""
NUMBERS = 17
"""Largest number of constants of a part."""


def evaluate_parts(
    kinds: IntArray, numbers: FloatArray, starts: IntArray, gains: FloatArray, y: FloatArray,
    v: FloatArray, a: FloatArray, c1: float, c2: float, s: FloatArray, forms: FloatArray,
    sigma: FloatArray, tau: FloatArray, border: FloatArray, coefficients: FloatArray,
    sums: FloatArray
) -> None:
    """Equations of a frame in the plane from arrays (`FrameFunction` in
    core/protocols/body_frame.py); without derivatives where c2 is 0."""
    b, elastic = len(y), s.shape[1] > 0
    e, c, columns = exp(1j * y[2]), s.view(np.complex128), sigma.view(np.complex128)
    # in the order of the fields of both, with time 0, as amplitudes are in `gains`
    m = PlaneMotion(
        y, v, complex(y[0], y[1]), e, e.conjugate(), v[2], a[2], complex(a[0], a[1]), c1, c2, 0.0,
        elastic, c[0], c[1], c[2], forms, c2 != 0.0)
    out = Views(columns[b], columns[:b], tau.view(np.complex128), border[:, :b], border[:, b],
                coefficients)
    total = sums.view(np.complex128)
    total[:SUMS] = 0.0
    for i in range(len(kinds)):
        kind, own, g = kinds[i], numbers[i], gains[i]
        j, o, k = starts[i, 0] // 2, starts[i, 1], starts[i, 2]
        if kind == 0:
            inertia(own, g, m, j, o, k, total, out)
        elif kind == 1:
            body_force(own, g, m, j, o, k, total, out)
        elif kind == 2:
            space_force(own, g, m, j, o, k, total, out)
        elif kind == 3:
            attachment(own, g, m, j, o, k, total, out)
        elif kind == 4:
            rotation(own, g, m, j, o, k, total, out)
        elif kind == 5:
            slide(own, g, m, j, o, k, total, out)
        elif kind == 6:
            moment(own, g, m, j, o, k, total, out)
        elif kind == 7:
            spring(own, g, m, j, o, k, total, out)
        elif kind == 8:
            rotational_spring(own, g, m, j, o, k, total, out)
        elif kind == 9:
            relative(own, g, m, j, o, k, total, out)
        elif kind == 10:
            compliance(own, g, m, j, o, k, total, out)
        else:
            stiffening(own, g, m, j, o, k, total, out)
    write(total, m.fresh, out)
