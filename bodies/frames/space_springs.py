"""Springs and dampers between two frames in space, as functions on arrays (notation and arguments:
`SpaceFunction` in space_items.py; their equations and where these are created: springs.py).

Loops over i number the rigid coordinates of both bodies, the own ones first; for a rotational
spring the attitude coordinates alone.
"""

from math import atan2, cos, floor, pi, sin, sqrt
from typing import TypeAlias

from sparsemor.bodies.frames.space_motion import (
    NONE,
    SpaceMotion,
    SpaceSums,
    add_bend,
    bend,
    cross,
    dot,
    plus,
    put,
    times,
    turn,
    turn_rate,
    vector,
)
from sparsemor.core import FloatArray

Quaternion: TypeAlias = tuple[float, float, float, float]


def space_spring(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Force f = stiffness l + damping l' + g along the line between two points at the distance l.

    numbers: n, own point (3), point of the other body, in space for one at rest (3), stiffness,
    N/m, damping, N s/m, number of attitude coordinates of the other body, 0 at rest.
    """
    point, base, stiffness, damping = vector(numbers, 1), vector(numbers, 4), numbers[7], numbers[8]
    others, own = int(numbers[9]), 3 + m.n
    size = own + (3 + others if others > 0 else 0)
    # gap between the points; derivatives of the gap and of the force F = f n by coordinate i
    gap, gap_by, F_by = plus(m.R, 1.0, times(m.A, point)), m.pairs[:, 0], m.pairs[:, 1]
    turn_rate(m.v, 3, m.n, m.A, m.rest)
    if others > 0:
        turn(m.y, o + 3, others, m.far)
        gap = plus(plus(gap, -1.0, vector(m.y, o)), -1.0, times(m.far[0], base))
    else:
        gap = plus(gap, -1.0, base)
    speed = NONE
    for i in range(size):  # derivatives of the gap; c: number of the coordinate in its body
        c = i if i < own else i - own
        sign = 1.0 if i < own else -1.0
        if c < 3:
            put(gap_by[i], (sign * (c == 0), sign * (c == 1), sign * (c == 2)))
        elif i < own:
            put(gap_by[i], times(m.D[c - 3], point))
        else:
            put(gap_by[i], plus(NONE, -1.0, times(m.far[c - 2], base)))
        speed = plus(speed, m.v[i if i < own else o + i - own], vector(gap_by[i], 0))
    length = sqrt(dot(gap, gap))
    n = (gap[0] / length, gap[1] / length, gap[2] / length)
    rate = dot(n, speed)
    f, across = stiffness * length + damping * rate + g, plus(speed, -rate, n)
    if others > 0 and m.c2 != 0.0:  # then only the rates of its derivatives are needed
        turn_rate(m.v, o + 3, others, m.far[0], m.far)
    for i in range(size if m.c2 != 0.0 else 0):
        b = vector(gap_by[i], 0)
        along, of_speed = dot(n, b), 0.0  # n . derivative of the speed at fixed rates
        if 3 <= i < own:
            of_speed = dot(n, times(m.rest[i - 2], point))
        elif i >= own + 3:
            of_speed = -dot(n, times(m.far[i - own - 2], base))
        f_by = stiffness * along + damping * (
            dot(across, b) / length + m.c1 * along + of_speed)
        put(F_by[i], plus(plus(NONE, f_by, n), f / length, plus(b, -along, n)))
    F = (f * n[0], f * n[1], f * n[2])
    for i in range(size):
        row = i if i < own else o + i - own
        out.rows[row] += dot(F, vector(gap_by[i], 0))
        for c in range(size if m.c2 != 0.0 else 0):
            out.H[row, c if c < own else o + c - own] += dot(
                vector(gap_by[i], 0), vector(F_by[c], 0))
    if m.c2 == 0.0:
        return
    add_bend(out.H, 3, m.n, m.A, 1.0, F, point)
    if others > 0:
        turn(m.y, o + 3, others, m.far)
        add_bend(out.H, o + 3, others, m.far[0], -1.0, F, base)


def quaternion(q: FloatArray, i: int, n: int) -> Quaternion:
    """Quaternion of an attitude with n coordinates from number i of q on."""
    if n == 1:
        return (cos(0.5 * q[i]), 0.0, 0.0, sin(0.5 * q[i]))
    return (q[i], q[i + 1], q[i + 2], q[i + 3])


def overlap(p: Quaternion, f: Quaternion, a: FloatArray, i: int) -> float:
    """p . (f b), the scalar product of a quaternion p with the product of f and b, the four entries
    of `a` from number i on."""
    w, b = a[i], vector(a, i + 1)
    e = (f[1], f[2], f[3])
    product = plus(plus(cross(e, b), f[0], b), w, e)
    scalar: float = f[0] * w - dot(e, b)
    return p[0] * scalar + dot((p[1], p[2], p[3]), product)


def counted_angle(
    numbers: FloatArray, m: SpaceMotion, o: int, others: int, c: float, s: float, relaxed: float
) -> float:
    """Angle atan2(s, c), rad, of a rotational spring plus the whole turns since the start
    (`springs.Angle.nearly` and `counted`); numbers: those of `space_rotational_spring`, with the
    axis n = e_1 x e_2, e_1 at 4 and e_2 at 7; o, others: first rigid coordinate and number of
    attitude coordinates of the other body, 0 at rest; relaxed: its angle without deflection, rad.
    Quaternions determine the angle but for 4 pi: it is the one nearest to `relaxed`."""
    raw, near = atan2(s, c), 0.0
    if m.n == 1 and others <= 1:  # angles about z; numbers[21]: their difference at the start
        about = cross(vector(numbers, 4), vector(numbers, 7))[2]
        near = about * (m.y[3] - (m.y[o + 3] if others > 0 else 0.0) - numbers[21])
    else:
        p, f = quaternion(m.y, 3, m.n), (1.0, 0.0, 0.0, 0.0)
        if others > 0:
            f = quaternion(m.y, o + 3, others)
        # r_0 and (0, axis) r_0 begin at numbers 13 and 17; overlap: p . (f r), the cosine and sine
        # of half the angle
        near = 2.0 * atan2(overlap(p, f, numbers, 17), overlap(p, f, numbers, 13))
        near += 4.0 * pi * floor((relaxed - near) / (4.0 * pi) + 0.5)
    return raw + 2.0 * pi * floor((near - raw) / (2.0 * pi) + 0.5)


def space_rotational_spring(
    numbers: FloatArray, g: float, m: SpaceMotion, j: int, o: int, k: int, out: SpaceSums
) -> None:
    """Moment stiffness phi + damping phi' + g against the relative angle phi about an axis, or
    stiffness (phi - g) + damping phi' where g is the relaxed angle.

    numbers: n, own direction d (3), directions e_1, e_2 of the other body, in space for one at rest
    (6), stiffness, N m/rad, damping, N m s/rad, number of attitude coordinates of the other body, 0
    at rest; quaternions r_0 and (0, e_1 x e_2) r_0 (8), with the relative quaternion r_0 at the
    start, times that of a body at rest; relative angle about z at the start, rad; 1 where g is the
    relaxed angle, rad, 0 where it is a moment, N m.
    """
    own, first, second = vector(numbers, 1), vector(numbers, 4), vector(numbers, 7)
    stiffness, damping, others = numbers[10], numbers[11], int(numbers[12])
    size, Ad, fc, fs = m.n + others, times(m.A, own), first, second
    # derivatives by coordinate i of c = A d . A_o e_1, s = A d . A_o e_2, phi = atan2(s, c) and of
    # the moment
    cosine, sine, along, slope = m.pairs[:, 0, 0], m.pairs[:, 0, 1], m.pairs[:, 0, 2], (
        m.pairs[:, 1, 0])
    if others > 0:
        turn(m.y, o + 3, others, m.far)
        fc, fs = times(m.far[0], first), times(m.far[0], second)
    c, s = dot(Ad, fc), dot(Ad, fs)
    square, rate = c * c + s * s, 0.0
    for i in range(size):
        if i < m.n:
            Ad_by = times(m.D[i], own)
            cosine[i], sine[i] = dot(fc, Ad_by), dot(fs, Ad_by)
        else:
            X = m.far[1 + i - m.n]
            cosine[i], sine[i] = dot(Ad, times(X, first)), dot(Ad, times(X, second))
        along[i] = (c * sine[i] - s * cosine[i]) / square
        rate += along[i] * m.v[3 + i if i < m.n else o + 3 + i - m.n]
    relaxed = g * numbers[22]  # 0 where g is a moment: then g - relaxed below is that moment
    phi = counted_angle(numbers, m, o, others, c, s, relaxed)
    moment = stiffness * (phi - relaxed) + damping * rate + (g - relaxed)
    for i in range(size if m.c2 != 0.0 else 0):
        slope[i] = (stiffness + damping * m.c1) * along[i]
        for r in range(size):  # second derivatives of c, s and phi (`attitude.of_angle`)
            if i < m.n and r < m.n:
                c_ir, s_ir = bend(m.n, m.A, fc, own, i, r), bend(m.n, m.A, fs, own, i, r)
            elif i >= m.n and r >= m.n:
                c_ir = bend(others, m.far[0], Ad, first, i - m.n, r - m.n)
                s_ir = bend(others, m.far[0], Ad, second, i - m.n, r - m.n)
            else:
                X, Ad_by = m.far[1 + max(i, r) - m.n], times(m.D[min(i, r)], own)
                c_ir, s_ir = dot(Ad_by, times(X, first)), dot(Ad_by, times(X, second))
            m.square[i, r] = (
                sine[i] * cosine[r] - cosine[i] * sine[r] + c * s_ir - s * c_ir
                - along[i] * 2.0 * (c * cosine[r] + s * sine[r])) / square
            slope[i] += damping * m.square[i, r] * m.v[
                3 + r if r < m.n else o + 3 + r - m.n]
    for i in range(size):
        row = 3 + i if i < m.n else o + 3 + i - m.n
        out.rows[row] += moment * along[i]
        for r in range(size if m.c2 != 0.0 else 0):
            out.H[row, 3 + r if r < m.n else o + 3 + r - m.n] += (
                along[i] * slope[r] + moment * m.square[i, r])
