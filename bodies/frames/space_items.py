"""Parts of the equations of a frame in space as functions on arrays: forces, attachments,
constraints.

Each is a function of its constant `numbers`, the present value g of its amplitude, and the motion
(space_motion.py). It adds its rows and derivatives to `out`: functionals from number j on,
coordinates of another body from o on, its multiplier k. The first number is that of the own
attitude coordinates. The data are those of the classes of items.py, inertia.py, springs.py and
constraints.py, whose `in_space` creates these parts (tests/laws/bodies/test_spatial_terms.py
compares both). The functions use numbers and arrays only, and create no array: they are compiled
(core/protocols/body_frame.py).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, sin
from typing import TypeAlias

import numpy as np

from sparsemor.bodies.frames.space_motion import (
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

SpaceFunction: TypeAlias = Callable[
    [FloatArray, float, SpaceMotion, int, int, int, SpaceSums], None]


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
    """Derivatives of g f . A z by the attitude and by the displacements of z, which was b."""
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
    """Constraint (p.p - 1) / 2 = 0 of a quaternion p."""
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
    """Nodal weights times one force in space axes. numbers: n, sum w, sum w X (3), force per unit
    weight (3)."""
    arm, f = vector(numbers, 2), vector(numbers, 5)
    add(out.rows, 0, -g * numbers[1], f)
    z = moved(POINT, arm, vector(m.s, j)) if m.elastic else arm
    add_pull(m, -g, f, z, POINT, arm, j, out)


def body_force(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Load that rotates with the body. numbers: n, sum f (3), sum X x f (3)."""
    f, arm = vector(numbers, 1), vector(numbers, 4)
    add(out.rows, 0, -g, times(m.A, f))
    for c in range(m.n if m.c2 != 0.0 else 0):
        turned = times(m.D[c], f)
        for i in range(3):
            out.H[i, 3 + c] -= g * turned[i]
    if m.elastic:
        arm = plus(arm, 1.0, vector(m.s, j + 1))
        out.sigma[j] -= g
        for c in range(m.n if m.c2 != 0.0 else 0):
            add(out.tau[3 + c], j + 1, -g, vector(m.lever[c], 0))
    add_torque(m, (-g * arm[0], -g * arm[1], -g * arm[2]), out)


def moment(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Moment on a body or on the mean rotation of a set. numbers: n, moment (3), 1 where a set
    turns, 1 for axes of space, else 0."""
    M, acts = vector(numbers, 1), m.elastic and numbers[4] > 0.0
    own = back(m.A, M) if numbers[5] > 0.0 else M
    add_torque(m, (-g * own[0], -g * own[1], -g * own[2]), out)
    if acts:
        add(out.sigma, j, -g, own)
    if numbers[5] > 0.0 and m.c2 != 0.0:
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
    """Numbers of `constraint` after the first; others: number of rigid coordinates of the other
    body."""
    return (*own.tolist(), *e.tolist(), base, float(kind == POINT), float(max(others - 3, 0)),
            float(kind), *turned.tolist(), *axis.tolist())


def constraint(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Constraint (R + A z - R_o) . n - base for a point, or (A d) . n for a direction, with n = A_o
    e of the other body, or n = e for a body at rest.

    numbers: n, z or d (3), e (3), base, 1 for a point, else 0, number of attitude coordinates of
    the other body, 0 at rest, kind of vector (`POINT`), mean rotation in the shape from which
    displacements are measured (3), axis about which e is rotated by the angle g (3), 0 for none.
    """
    own, e, axis = vector(numbers, 1), vector(numbers, 4), vector(numbers, 14)
    slides, others, kind = numbers[8] > 0.0, int(numbers[9]), int(numbers[10])
    H, lam, s = out.H, m.y[k], vector(numbers, 11)
    if m.elastic and kind > 0:
        s = plus(s, 1.0, vector(m.s, j))
    z = moved(kind, own, s)
    if dot(axis, axis) > 0.0:
        c = cos(g)
        around = plus((c * e[0], c * e[1], c * e[2]), sin(g), cross(axis, e))
        e = plus(around, (1.0 - c) * dot(axis, e), axis)
    n, gap = e, times(m.A, z)
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
    if m.c2 == 0.0:
        for i in range(others):
            out.rows[o + 3 + i] += lam * dot(gap, times(m.far[1 + i], e))
        return
    for i in range(3 if slides else 0):
        H[k, i] += n[i]
        H[i, k] += n[i]
        if others > 0:
            H[k, o + i] -= n[i]
            H[o + i, k] -= n[i]
    for i in range(m.n):
        slope = dot(n, times(m.D[i], z))
        H[k, 3 + i] += slope
        H[3 + i, k] += slope
    acts = m.elastic and kind > 0
    if acts:
        along = pull(kind, own, back(m.A, n))
        add(out.sigma_y[k], j, 1.0, along)
        add(out.tau[k], j, 1.0, along)
    if others > 0:
        add_bend(H, o + 3, others, m.far[0], lam, gap, e)
    for i in range(others):
        at, by = o + 3 + i, times(m.far[1 + i], e)
        slope = dot(gap, by)
        out.rows[at] += lam * slope
        H[k, at] += slope
        H[at, k] += slope
        for c in range(m.n):
            both = lam * dot(times(m.D[c], z), by)
            H[3 + c, at] += both
            H[at, 3 + c] += both
        if slides:
            for c in range(3):
                H[c, at] += lam * by[c]
                H[at, c] += lam * by[c]
                H[o + c, at] -= lam * by[c]
                H[at, o + c] -= lam * by[c]
        if acts:
            along = pull(kind, own, back(m.A, by))
            add(out.sigma_y[at], j, lam, along)
            add(out.tau[at], j, lam, along)


def stiffening(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Factors of geometric stiffness: those of all loads (stiffening.py). numbers: n, functionals,
    inertia matrices."""
    first = int(numbers[2])
    for i in range(int(numbers[1])):
        out.coefficients[first + i] = out.sigma[i]


def compliance(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Compliance of a constraint times its multiplier. numbers: n, compliance."""
    out.rows[k] -= numbers[1] * m.y[k]
    if m.c2 != 0.0:
        out.H[k, k] -= numbers[1]
