"""Springs and dampers between two frames in the plane, in complex numbers (notation:
plane_items.py; the same in space, and where these are created: springs.py)."""

from cmath import exp

from sparsemor.bodies.frames.plane_motion import Numbers, PlaneMotion, Total, Views


def spring(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Force f = stiffness l + damping l' + g along the line between two points at the distance l.

    numbers: own point (m, 2 numbers), point of the other body (2), stiffness, N/m, damping, N s/m,
    1 where the other body's coordinates are unknowns, else 0, and its coordinates (3).
    """
    rz, b = m.e * complex(numbers[0], numbers[1]), complex(numbers[2], numbers[3])
    stiffness, damping, moves = numbers[4], numbers[5], numbers[6] > 0.0
    x, y, angle, v, turn = numbers[7], numbers[8], numbers[9], 0j, 0.0
    if moves:
        x, y, angle, turn = m.y[o], m.y[o + 1], m.y[o + 2], m.v[o + 2]
        v = complex(m.v[o], m.v[o + 1])
    rb = exp(1j * angle) * b
    gap = m.r + rz - complex(x, y) - rb
    speed = complex(m.v[0], m.v[1]) + 1j * m.w * rz - v - 1j * turn * rb
    length = abs(gap)
    n = gap / length
    across = speed - n * (n.conjugate() * speed).real
    f = stiffness * length + damping * (n.conjugate() * speed).real + g
    F = f * n
    arm = rz.conjugate() * F
    total[0] += F
    total[3] += arm.imag
    # derivatives of gap by own, then by the other body's coordinates; of speed at fixed rates
    by = (1.0 + 0j, 1j, 1j * rz, -1.0 + 0j, -1j, -1j * rb)
    by_turn = (0j, 0j, -m.w * rz, 0j, 0j, turn * rb)
    H = out.H
    for i in range(6 if moves else 3):
        along, at = (n.conjugate() * by[i]).real, i if i < 3 else o + i - 3
        of_f = stiffness * along + damping * (
            (across.conjugate() * by[i]).real / length
            + (n.conjugate() * (m.c1 * by[i] + by_turn[i])).real)
        d = of_f * n + f * (by[i] - n * along) / length
        d2 = (by[2].conjugate() * d).real
        if i == 0:
            total[4], total[2] = total[4] + d, total[2] + d2
        elif i == 1:
            total[5], total[2] = total[5] + d, total[2] + 1j * d2
        elif i == 2:
            total[1], total[3] = total[1] + d, total[3] + 1j * (d2 - arm.real)
        else:
            H[0, at], H[1, at], H[2, at] = d.real, d.imag, d2
        if moves:
            H[o, at], H[o + 1, at] = -d.real, -d.imag
            H[o + 2, at] = (by[5].conjugate() * d).real
    if moves:
        rows = out.rows
        rows[o], rows[o + 1], rows[o + 2] = -F.real, -F.imag, -(rb.conjugate() * F).imag
        H[o + 2, o + 2] += (rb.conjugate() * F).real


def rotational_spring(
    numbers: Numbers, g: float, m: PlaneMotion, j: int, o: int, k: int, total: Total, out: Views
) -> None:
    """Moment stiffness phi + damping phi' + g that acts against the relative angle phi of two
    frames, rad. numbers: stiffness, N m/rad, damping, N m s/rad, 1 where the other body's
    coordinates are unknowns, else 0, and its angle at rest, rad."""
    stiffness, damping, moves = numbers[0], numbers[1], numbers[2] > 0.0
    phi, rate = m.y[2] - numbers[3], m.w
    if moves:
        phi, rate = m.y[2] - m.y[o + 2], m.w - m.v[o + 2]
    moment, slope = stiffness * phi + damping * rate + g, stiffness + damping * m.c1
    total[3] += complex(moment, slope)
    if moves:
        out.rows[o + 2] = -moment
        out.H[2, o + 2] = out.H[o + 2, 2] = -slope
        out.H[o + 2, o + 2] = slope
