"""Springs and dampers between two frames in the plane, in complex numbers (notation and arguments:
`PlaneFunction` in plane_items.py; the same in space, and where these are created: springs.py)."""

from cmath import exp

from sparsemor.bodies.frames.plane_motion import (
    FORCE,
    FORCE_BY_ANGLE,
    FORCE_BY_X,
    FORCE_BY_Y,
    TORQUE,
    TORQUE_BY_PLACE,
    Numbers,
    PlaneMotion,
    Total,
    Views,
)


def spring(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Force f = stiffness l + damping l' + g along the line between two points at the distance l.

    numbers: own point (2), m, point of the other body (2), m, stiffness, N/m, damping, N s/m, 1
    where the other body's coordinates are unknowns, else 0, and its coordinates (3) at rest.
    """
    rz, b = m.e * complex(numbers[0], numbers[1]), complex(numbers[2], numbers[3])
    stiffness, damping, moves = numbers[4], numbers[5], numbers[6] > 0.0
    x, y, angle, v, w_o = numbers[7], numbers[8], numbers[9], 0j, 0.0
    if moves:
        x, y, angle, w_o = m.y[o], m.y[o + 1], m.y[o + 2], m.v[o + 2]
        v = complex(m.v[o], m.v[o + 1])
    rb = exp(1j * angle) * b
    gap = m.r + rz - complex(x, y) - rb
    speed = complex(m.v[0], m.v[1]) + 1j * m.w * rz - v - 1j * w_o * rb
    length = abs(gap)
    n = gap / length
    across = speed - n * (n.conjugate() * speed).real
    f = stiffness * length + damping * (n.conjugate() * speed).real + g
    F = f * n
    arm = rz.conjugate() * F
    total[FORCE] += F
    total[TORQUE] += arm.imag
    # by x, y, angle of the own body (i < 3) and of the other one: of the gap, and of its speed at
    # fixed rates of these coordinates
    gap_by = (1.0 + 0j, 1j, 1j * rz, -1.0 + 0j, -1j, -1j * rb)
    speed_by = (0j, 0j, -m.w * rz, 0j, 0j, w_o * rb)
    H = out.H
    for i in range(6 if moves else 3):
        along, at = (n.conjugate() * gap_by[i]).real, i if i < 3 else o + i - 3
        f_by = stiffness * along + damping * (
            (across.conjugate() * gap_by[i]).real / length
            + (n.conjugate() * (m.c1 * gap_by[i] + speed_by[i])).real)
        F_by = f_by * n + f * (gap_by[i] - n * along) / length
        torque_by = (gap_by[2].conjugate() * F_by).real
        if i == 0:
            total[FORCE_BY_X] = total[FORCE_BY_X] + F_by
            total[TORQUE_BY_PLACE] = total[TORQUE_BY_PLACE] + torque_by
        elif i == 1:
            total[FORCE_BY_Y] = total[FORCE_BY_Y] + F_by
            total[TORQUE_BY_PLACE] = total[TORQUE_BY_PLACE] + 1j * torque_by
        elif i == 2:
            total[FORCE_BY_ANGLE] = total[FORCE_BY_ANGLE] + F_by
            total[TORQUE] = total[TORQUE] + 1j * (torque_by - arm.real)
        else:
            H[0, at], H[1, at], H[2, at] = F_by.real, F_by.imag, torque_by
        if moves:
            H[o, at], H[o + 1, at] = -F_by.real, -F_by.imag
            H[o + 2, at] = (gap_by[5].conjugate() * F_by).real
    if moves:
        rows = out.rows
        rows[o], rows[o + 1], rows[o + 2] = -F.real, -F.imag, -(rb.conjugate() * F).imag
        H[o + 2, o + 2] += (rb.conjugate() * F).real


def rotational_spring(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Moment stiffness phi + damping phi' + g that acts against the relative angle phi of two
    frames, rad. numbers: stiffness, N m/rad, damping, N m s/rad, 1 where the other body's
    coordinates are unknowns, else 0, and the angle that counts as zero, rad. g: drive moment at
    time t, N m; o: first coordinate of the other body; j, k: not used. m.c1: d phi' = c1 d phi."""
    stiffness, damping, moves = numbers[0], numbers[1], numbers[2] > 0.0
    phi, rate = m.y[2] - numbers[3], m.w
    if moves:
        phi, rate = phi - m.y[o + 2], rate - m.v[o + 2]
    moment, slope = stiffness * phi + damping * rate + g, stiffness + damping * m.c1
    total[TORQUE] += complex(moment, slope)  # i times its derivative by the angle
    if moves:
        out.rows[o + 2] = -moment
        out.H[2, o + 2] = out.H[o + 2, 2] = -slope
        out.H[o + 2, o + 2] = slope


def relative_law(
    kind: float, a: float, b: float, c: float, d: float, q: float, rate: float, load: float
) -> tuple[float, float, float, float]:
    """Force f that acts against a relative coordinate q, and its derivatives by q, its rate and the
    magnitude of joint forces `load`.

    kind 0: a q + b q'. 1, a stop: with the depth s beyond a (below) or b (above) c s (1 + d s')
    against it, never less than zero (Hunt and Crossley 1975, doi 10.1115/1.3423596, with the
    exponent 1). 2, friction: (a + b load) w (3 - w^2) / 2, w = q' / c in [-1, 1]. rate: q'; d: s/m
    or s/rad in a stop; c: stiffness of a stop, rate at which friction is full.
    """
    if kind == 0.0:
        return a * q + b * rate, a, b, 0.0
    if kind == 1.0:
        side = 1.0 if q > b else -1.0
        depth = q - b if q > b else a - q
        grip = 1.0 + d * side * rate
        if depth <= 0.0 or grip <= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        return side * c * depth * grip, c * grip, c * d * depth, 0.0
    w, limit = min(1.0, max(-1.0, rate / c)), a + b * load
    share = w * (1.5 - 0.5 * w * w)
    return limit * share, 0.0, limit * 1.5 / c * (1.0 - w * w), b * share


def relative(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Force by a law of a relative coordinate of two frames (springs.py).

    numbers: law (5), sign, 1 for a distance and 0 for an angle, 1 where the other body's
    coordinates are unknowns, number of joint forces that the law reads; own point (2), axis of the
    other body (2), value that counts as zero; coordinates of a body at rest (3).

    q = Re(conj(n) (r + e z - r_o)), n = e_o axis, for a distance, theta - theta_o for an angle. The
    coordinates i of the loops are x, y, angle of the own (0 to 2) and of the other body (3 to 5).
    """
    sign, slides, moves, forces = numbers[5], numbers[6] > 0.0, numbers[7] > 0.0, int(numbers[8])
    x, y, angle, v, w_o = numbers[14], numbers[15], numbers[16], 0j, 0.0
    if moves:
        x, y, angle, w_o = m.y[o], m.y[o + 1], m.y[o + 2], m.v[o + 2]
        v = complex(m.v[o], m.v[o + 1])
    n = exp(1j * angle) * complex(numbers[11], numbers[12])
    if not slides:
        n = 0j
    rz = m.e * complex(numbers[9], numbers[10])
    gap = n.conjugate() * (m.r + rz - complex(x, y))
    arm, turns = n.conjugate() * rz, 0.0 if slides else 1.0
    q = gap.real - numbers[13] + turns * (m.y[2] - angle)
    # derivatives of q by the coordinates of both; second ones by each and by the other's angle:
    # all but one, by the own angle twice, which is -arm.real
    by = (n.real, n.imag, turns - arm.imag, -n.real, -n.imag, gap.imag - turns)
    mixed = (-n.imag, n.real, arm.real, n.imag, -n.real, -gap.real)
    rates = (m.v[0], m.v[1], m.w, v.real, v.imag, w_o)
    rate = 0.0
    for i in range(6):
        rate += by[i] * rates[i]
    square = 0.0
    for i in range(forces):
        square += m.y[k + i] * m.y[k + i]
    load: float = square**0.5
    f, by_q, by_rate, by_load = relative_law(
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], sign * q, sign * rate, load)
    f *= sign
    total[FORCE] += f * complex(by[0], by[1])
    rows, H, size = out.rows, out.H, 6 if moves else 3
    for i in range(3, size):
        rows[o + i - 3] = f * by[i]
    last_rate = 0.0  # derivative of q' by the other's angle: last row of the second ones, times v
    for i in range(6):
        last_rate += mixed[i] * rates[i]
    for i in range(size):
        rate_by = mixed[i] * w_o if i < 5 else last_rate
        if i == 2:
            rate_by -= arm.real * m.w
        slope = (by_q + m.c1 * by_rate) * by[i] + by_rate * rate_by  # of f by coordinate i
        fx, fy, fz = by[0] * slope, by[1] * slope, by[2] * slope
        if i == 2:
            fz -= f * arm.real
        if i == 5:
            fx, fy, fz = fx + f * mixed[0], fy + f * mixed[1], fz + f * mixed[2]
        if i == 0:
            total[FORCE_BY_X] = total[FORCE_BY_X] + complex(fx, fy)
            total[TORQUE_BY_PLACE] = total[TORQUE_BY_PLACE] + fz
        elif i == 1:
            total[FORCE_BY_Y] = total[FORCE_BY_Y] + complex(fx, fy)
            total[TORQUE_BY_PLACE] = total[TORQUE_BY_PLACE] + 1j * fz
        elif i == 2:
            total[FORCE_BY_ANGLE] = total[FORCE_BY_ANGLE] + complex(fx, fy)
            total[TORQUE] = total[TORQUE] + complex(f * by[2], fz)
        else:
            H[0, o + i - 3], H[1, o + i - 3], H[2, o + i - 3] = fx, fy, fz
        for r in range(3, size):
            both = by[r] * slope
            if i == 5:
                both += f * mixed[r]
            elif r == 5:
                both += f * mixed[i]
            H[o + r - 3, i if i < 3 else o + i - 3] = both
    for r in range(forces):
        share = sign * by_load * m.y[k + r] / load if load > 0.0 else 0.0
        rows[k + r] = 0.0  # the law reads these multipliers, and is no constraint
        for i in range(size):
            H[i if i < 3 else o + i - 3, k + r] = share * by[i]
