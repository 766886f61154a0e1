"""Parts of the equations of a frame in space as functions on arrays: forces, attachments,
constraints.

Each is a function of its constant `numbers`, the present value g of its amplitude, and the motion
(space_motion.py). It adds its rows and derivatives to `out`: functionals from number j on,
coordinates of another body from o on, its multiplier k. The first number is that of the own
attitude coordinates. The data are those of the classes of frame_items.py, inertia.py, springs.py
and constraints.py, whose `in_space` creates these parts (tests/laws/bodies/test_spatial_terms.py
compares both). The functions use numbers and arrays only, and create no array: they are compiled
(core/protocols/body_frame.py).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin
from typing import TypeAlias

import numpy as np

from sparsemor.bodies.frames.mass_moments import moments_of
from sparsemor.bodies.frames.space_motion import (
    NONE,
    SpaceMotion,
    SpaceSums,
    Vector,
    add,
    add_bend,
    add_torque,
    back,
    cross,
    dot,
    plus,
    times,
    turn,
    vector,
)
from sparsemor.core import Amplitude, FloatArray
from sparsemor.core.protocols.poses import FREE_POSE, SPINNING_POSE

SpaceFunction: TypeAlias = Callable[
    [FloatArray, float, SpaceMotion, int, int, int, SpaceSums], None]
"""Part of the equations, function(numbers, g, m, j, o, k, out): its constants, amplitude, motion,
and first functional, coordinate of another body and multiplier (module docstring). In m.y and in
rows of `out` the own position begins at 0 and the attitude, with n coordinates, at 3."""


@dataclass(frozen=True, slots=True)
class SpacePart:
    """A function of a part with its numbers and amplitude (None: constant 1); row: number of its
    multiplier among those of its item."""

    function: SpaceFunction
    numbers: tuple[float, ...]
    amplitude: Amplitude | None = None
    row: int = 0


POINT, DIRECTION = 1, 2
"""Vectors of a flexible body: z + s for a point z, d + s x d for a direction d, with the
functionals s of a mean displacement or rotation; 0 for a vector that is constant in body axes."""


ZERO = np.zeros(3)


def moved(kind: int, b: Vector, s: Vector) -> Vector:
    """Vector b of the body, displaced by s."""
    if kind == POINT:
        return plus(b, 1.0, s)
    return plus(b, 1.0, cross(s, b)) if kind == DIRECTION else b


def pull(kind: int, b: Vector, f: Vector) -> Vector:
    """Derivative of f . (b displaced by s) by s."""
    return cross(b, f) if kind == DIRECTION else f


def add_pull(
    m: SpaceMotion, g: float, f: Vector, z: Vector, kind: int, b: Vector, j: int, out: SpaceSums
) -> None:
    """Adds the derivatives of g f . A z by the attitude and by the functionals s of the
    displacements to rows and sigma, and second derivatives to H, sigma_y = d sigma / dy and tau = d
    rows / ds, which are equal, as those of one function. kind: z = b + s for a point (1), b + s x b
    for a direction (2), which a mean rotation s turns, b if it does not deform (0), with the number
    j of the first s; `pull`: derivative of f . z by s. f: in space axes; g: a factor; m.D[k]:
    derivative of A by attitude coordinate k, of n; c2 = 0: without derivatives."""
    for k in range(m.n):
        out.rows[3 + k] += g * dot(f, times(m.D[k], z))
    if m.elastic and kind > 0:
        add(out.sigma, j, g, pull(kind, b, back(m.A, f)))
    if m.c2 == 0.0:
        return
    add_bend(out.H, 3, m.n, m.A, g, f, z)
    if m.elastic and kind > 0:
        for k in range(m.n):
            slope = pull(kind, b, back(m.D[k], f))
            add(out.sigma_y[3 + k], j, g, slope)
            add(out.tau[3 + k], j, g, slope)


def unit_length(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Constraint (p.p - 1) / 2 = 0 of a quaternion p (`SpaceFunction`), coordinates 3 to 6 in y,
    with the multiplier y[k]. numbers: n; g, j, o: not used; c2 = 0: without derivatives H."""
    out.rows[k] -= 0.5
    for i in range(3, 7):
        p = m.y[i]
        out.rows[i] += m.y[k] * p
        out.rows[k] += 0.5 * p * p
        if m.c2 != 0.0:
            out.H[i, k] += p
            out.H[k, i] += p
            out.H[i, i] += m.y[k]


def space_force(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Nodal weights times one force in space axes (`SpaceFunction`). numbers: n, sum w, sum w X
    (3), force per unit weight (3), N."""
    arm, f = vector(numbers, 2), vector(numbers, 5)
    add(out.rows, 0, -g * numbers[1], f)
    z = moved(POINT, arm, vector(m.s, j)) if m.elastic else arm
    add_pull(m, -g, f, z, POINT, arm, j, out)


def body_force(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Load that rotates with the body (`SpaceFunction`). numbers: n, sum f (3), N, sum X x f (3), N
    m. Functionals from j on: the load itself, then sum u x f (3). g: factor of the load at time t;
    o, k: not used; m.D, m.lever: derivatives of A by, and generalized forces per torque on the n
    attitude coordinates; sigma: factors in the elastic rows; tau: d rows / ds; loads have minus."""
    f, arm = vector(numbers, 1), vector(numbers, 4)
    add(out.rows, 0, -g, times(m.A, f))
    for c in range(m.n if m.c2 != 0.0 else 0):
        f_by = times(m.D[c], f)  # derivative of A f
        for i in range(3):
            out.H[i, 3 + c] -= g * f_by[i]
    if m.elastic:
        arm = plus(arm, 1.0, vector(m.s, j + 1))
        out.sigma[j] -= g
        for c in range(m.n if m.c2 != 0.0 else 0):
            add(out.tau[3 + c], j + 1, -g, vector(m.lever[c], 0))
    add_torque(m, (-g * arm[0], -g * arm[1], -g * arm[2]), out)


def moment(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Moment on a body or on the mean rotation of a set (`SpaceFunction`). numbers: n, moment (3),
    N m, 1 where a set turns, else 0, 1 for axes of space, 0 for those of the body. g: its factor at
    time t; j: first functional, the mean rotation of the set; o, k: not used. m.D, m.lever:
    derivatives of A by, and generalized forces per torque on the n attitude coordinates; sigma:
    factors in the elastic rows, sigma_y: d sigma / dy; c2 = 0: without derivatives."""
    M, acts, in_space = vector(numbers, 1), m.elastic and numbers[4] > 0.0, numbers[5] > 0.0
    own = back(m.A, M) if in_space else M
    add_torque(m, (-g * own[0], -g * own[1], -g * own[2]), out)
    if acts:
        add(out.sigma, j, -g, own)
    if in_space and m.c2 != 0.0:
        for c in range(m.n):
            slope = back(m.D[c], M)
            for i in range(m.n):
                out.H[3 + i, 3 + c] -= g * dot(vector(m.lever[i], 0), slope)
            if acts:
                add(out.sigma_y[3 + c], j, -g, slope)


def constraint_numbers(
    own: FloatArray, e: FloatArray, base: float = 0.0, *, others: int = 0, kind: int,
    turned: FloatArray = ZERO, axis: FloatArray = ZERO,
) -> tuple[float, ...]:
    """Numbers of `constraint` after the first: own = z or d (3,), e (3,), and the others as there;
    others: number of rigid coordinates of the other body, 0 at rest; kind: `POINT`, `DIRECTION` or
    0."""
    return (*own.tolist(), *e.tolist(), base, float(kind == POINT), float(max(others - 3, 0)),
            float(kind), *turned.tolist(), *axis.tolist())


def constraint(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Constraint (R + A z - R_o) . n - base for a point, or (A d) . n for a direction, with n = A_o
    e of the other body, or n = e for a body at rest (`SpaceFunction`).

    numbers: n, z or d (3), e (3), base, 1 for a point, else 0, number of attitude coordinates of
    the other body, 0 at rest, kind of vector (`POINT`), mean rotation in the shape from which
    displacements are measured (3), axis about which e is rotated by the angle g (3), 0 for none.
    Adds the constraint in row k, the force lambda n or moment of its multiplier, and derivatives.
    """
    own, e, axis = vector(numbers, 1), vector(numbers, 4), vector(numbers, 14)
    slides, others, kind = numbers[8] > 0.0, int(numbers[9]), int(numbers[10])
    H, lam, s = out.H, m.y[k], vector(numbers, 11)
    if m.elastic and kind > 0:
        s = plus(s, 1.0, vector(m.s, j))
    z = moved(kind, own, s)
    if dot(axis, axis) > 0.0:  # e turned about the unit vector `axis` (Rodrigues)
        c = cos(g)
        around = plus((c * e[0], c * e[1], c * e[2]), sin(g), cross(axis, e))
        e = plus(around, (1.0 - c) * dot(axis, e), axis)
    n, gap = e, times(m.A, z)  # the constraint is n . gap - base
    if others > 0:
        turn(m.y, o + 3, others, m.far)
        n = times(m.far[0], e)
    if slides:
        gap = plus(gap, 1.0, m.R)
        if others > 0:
            gap = plus(gap, -1.0, vector(m.y, o))
            add(out.rows, o, -lam, n)
        add(out.rows, 0, lam, n)
    out.rows[k] += dot(n, gap) - numbers[7]
    add_pull(m, lam, n, z, kind, own, j, out)
    if m.c2 == 0.0:  # no derivatives; m.far[1 + i]: derivative of A_o by its coordinate i
        for i in range(others):
            out.rows[o + 3 + i] += lam * dot(gap, times(m.far[1 + i], e))
        return
    # by positions
    for i in range(3 if slides else 0):
        H[k, i] += n[i]
        H[i, k] += n[i]
        if others > 0:
            H[k, o + i] -= n[i]
            H[o + i, k] -= n[i]
    # by the own attitude and displacements
    for i in range(m.n):
        slope = dot(n, times(m.D[i], z))
        H[k, 3 + i] += slope
        H[3 + i, k] += slope
    acts = m.elastic and kind > 0
    if acts:
        along = pull(kind, own, back(m.A, n))
        add(out.sigma_y[k], j, 1.0, along)
        add(out.tau[k], j, 1.0, along)
    # by the other's attitude, at `at` in y
    if others > 0:
        add_bend(H, o + 3, others, m.far[0], lam, gap, e)
    for i in range(others):
        at, n_by = o + 3 + i, times(m.far[1 + i], e)
        slope = dot(gap, n_by)
        out.rows[at] += lam * slope
        H[k, at] += slope
        H[at, k] += slope
        for c in range(m.n):
            mixed = lam * dot(times(m.D[c], z), n_by)
            H[3 + c, at] += mixed
            H[at, 3 + c] += mixed
        if slides:
            for c in range(3):
                H[c, at] += lam * n_by[c]
                H[at, c] += lam * n_by[c]
                H[o + c, at] -= lam * n_by[c]
                H[at, o + c] -= lam * n_by[c]
        if acts:
            along = pull(kind, own, back(m.A, n_by))
            add(out.sigma_y[at], j, lam, along)
            add(out.tau[at], j, lam, along)


def stiffening(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Factors of geometric stiffness, those of all loads (`frame_items.Stiffening`), of which it is
    the last part (`SpaceFunction`). numbers: n, count of functionals, of inertia matrices."""
    first = int(numbers[2])
    for i in range(int(numbers[1])):
        out.coefficients[first + i] = out.sigma[i]


def compliance(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Minus the compliance of a constraint times its multiplier (`SpaceFunction`). numbers: n,
    compliance, m/N or rad/(N m)."""
    out.rows[k] -= numbers[1] * m.y[k]
    if m.c2 != 0.0:
        out.H[k, k] -= numbers[1]


def _dual(size: int) -> FloatArray:
    """Dual basis T_g (g, 3, 3) for frames with `size` rigid coordinates: T = sum_g (B_g : T) T_g
    (mass_moments.py)."""
    B = moments_of(size).B
    return np.ascontiguousarray(np.linalg.pinv(B.reshape(-1, 9)).T).reshape(B.shape)


FREE, SPINNING = _dual(FREE_POSE), _dual(SPINNING_POSE)


def trace(T: FloatArray) -> float:
    """Trace of T."""
    total: float = T[0, 0] + T[1, 1] + T[2, 2]
    return total


def inert(T: FloatArray, v: Vector) -> Vector:
    """J v = tr T v - T^T v."""
    t = trace(T)
    return plus((t * v[0], t * v[1], t * v[2]), -1.0, back(T, v))


def axial(T: FloatArray) -> Vector:
    """sum z x m y for T = sum m z y^T."""
    return (T[1, 2] - T[2, 1], T[2, 0] - T[0, 2], T[0, 1] - T[1, 0])


def factor(T: FloatArray, a: Vector, b: Vector) -> float:
    """T : (b~ a~) = a . T b - tr T a . b."""
    return dot(a, times(T, b)) - trace(T) * dot(a, b)


def space_inertia(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Inertia of a body (`SpaceFunction`; equations: inertia.py, without matrices here). numbers:
    n, mass, kg, sum m X (3), kg m, X.M_g X (9, or 3 for an attitude about z), kg m^2.

    z, z1, z2: sums m z, m u', m u''; T, T1, T2: sums m z z^T, m z u'^T, m z u''^T, as sums over g
    of N_g, N1_g, N2_g times the dual basis; swing: sum m acc without R''.
    """
    mass, z, c1, c2, w, al = numbers[1], vector(numbers, 2), m.c1, m.c2, m.w, m.al
    half = len(out.coefficients) // 2  # kappa, then mu
    # M_g: the identity, then `skew` skew-symmetric ones, then symmetric ones
    count, dual, skew = (9, FREE, 3) if m.n == 4 else (3, SPINNING, 1)
    H, acc = out.H, back(m.A, m.acc)
    T, T1, T2 = m.rest[0], m.rest[1], m.rest[2]
    m.rest[:] = 0.0
    z1, z2 = NONE, NONE
    if m.elastic:
        z, z1, z2 = plus(z, 1.0, vector(m.s, j)), vector(m.s1, j), vector(m.s2, j)
    for i in range(count):
        N, N1, N2, at = numbers[5 + i], 0.0, 0.0, j + 3 + i
        if m.elastic:
            sign = -1.0 if 1 <= i <= skew else 1.0  # M_g^T = sign M_g
            N += (1.0 + sign) * m.s[at] + m.forms[i]
            N1 = sign * m.s1[at] + m.forms[half + i]
            N2 = sign * m.s2[at] + m.forms[2 * half + i]
        for r in range(3):
            for c in range(3):
                T[r, c] += N * dual[i, r, c]
                T1[r, c] += N1 * dual[i, r, c]
                T2[r, c] += N2 * dual[i, r, c]
    Jw, wz = inert(T, w), cross(w, z)
    swing = plus(plus(plus(cross(w, wz), 1.0, cross(al, z)), 2.0, cross(w, z1)), 1.0, z2)
    torque = plus(plus(plus(inert(T, al), 2.0, inert(T1, w)), 1.0, axial(T2)), 1.0, cross(w, Jw))
    add_torque(m, plus(torque, 1.0, cross(z, acc)), out)
    add(out.rows, 0, mass, m.acc)
    add(out.rows, 0, 1.0, times(m.A, swing))
    if m.elastic:
        add(out.sigma, j, 1.0, acc)
        for f in range(count):
            value = factor(dual[f], w, w) - dot(axial(dual[f]), al)
            out.sigma[j + 3 + f] = out.coefficients[f] = value
            out.coefficients[half + f] = -2.0 * dot(axial(dual[f]), w)
    if c2 == 0.0:
        return
    # derivatives by the position
    for i in range(3):
        H[i, i] += c2 * mass
        arm = cross(z, vector(m.A[i], 0))
        for r in range(m.n):
            H[3 + r, i] += c2 * dot(vector(m.lever[r], 0), arm)
    # by the attitude: of A swing (force), then of the torque
    for i in range(m.n):
        dw, dal, dacc = vector(m.dw[i], 0), vector(m.dal[i], 0), back(m.D[i], m.acc)
        swing_by = plus(plus(cross(dw, wz), 1.0, cross(w, cross(dw, z))), 1.0, cross(dal, z))
        force_by = plus(times(m.D[i], swing), 1.0, times(m.A, plus(swing_by, 2.0, cross(dw, z1))))
        torque_by = plus(plus(cross(z, dacc), 1.0, cross(w, inert(T, dw))), 1.0, cross(dw, Jw))
        torque_by = plus(plus(torque_by, 2.0, inert(T1, dw)), 1.0, inert(T, dal))
        for r in range(3):
            H[r, 3 + i] += force_by[r]
        for r in range(m.n):
            H[3 + r, 3 + i] += dot(vector(m.lever[r], 0), torque_by)
        if m.elastic:
            add(out.sigma_y[3 + i], j, 1.0, dacc)
            add(out.tau[3 + i], j, 1.0, cross(acc, vector(m.lever[i], 0)))
            for f in range(count):
                out.sigma_y[3 + i, j + 3 + f] = (
                    factor(dual[f], dw, w) + factor(dual[f], w, dw) - dot(axial(dual[f]), dal))
    if not m.elastic:
        return
    # of sigma by the position, and of rows by first and second moments
    for i in range(3):
        row = vector(m.A[i], 0)
        add(out.sigma_y[i], j, c2, row)
        # row (w~ w~ + al~ + 2 c1 w~ + c2)
        add(out.tau[i], j, 1.0, plus(
            cross(cross(row, w), w), 1.0, plus(cross(row, plus(al, 2.0 * c1, w)), c2, row)))
    for f in range(count):
        B, at = dual[f], j + 3 + f
        sign, Bw = -1.0 if 1 <= f <= skew else 1.0, inert(B, w)
        arm = plus(NONE, 1.0 + sign, plus(inert(B, al), 1.0, cross(w, Bw)))
        arm = plus(plus(arm, 2.0 * sign * c1, Bw), sign * c2, axial(B))
        for i in range(m.n):
            out.tau[3 + i, at] += dot(vector(m.lever[i], 0), arm)
