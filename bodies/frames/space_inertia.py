"""Inertia of a body in space as a function on arrays (notation: space_items.py; the equations:
inertia.py).

A second moment T = sum m z y^T (3, 3) is T = sum_g N_g T_g of its numbers N_g = z.M_g y, with the
dual basis T_g of the matrices B_g (moments.py). Its moment of inertia is J = tr T 1 - T^T.
"""

import numpy as np

from sparsemor.bodies.frames.moments import moments_of
from sparsemor.bodies.frames.space_motion import (
    NONE,
    SpaceMotion,
    SpaceSums,
    Vector,
    add,
    add_torque,
    back,
    cross,
    dot,
    plus,
    times,
    vector,
)
from sparsemor.core import FloatArray
from sparsemor.core.protocols.poses import FREE_POSE, SPINNING_POSE


def _dual(size: int) -> FloatArray:
    """Dual basis T_g (g, 3, 3) for frames with `size` rigid coordinates."""
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
    """Inertia of a body. numbers: n, mass, kg, sum m X (3), kg m, X.M_g X (9, or 3 for an attitude
    about z), kg m^2."""
    mass, z, c1, c2, w, al = numbers[1], vector(numbers, 2), m.c1, m.c2, m.w, m.al
    half = len(out.coefficients) // 2  # kappa, then mu
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
    for i in range(3):
        H[i, i] += c2 * mass
        arm = cross(z, vector(m.A[i], 0))
        for r in range(m.n):
            H[3 + r, i] += c2 * dot(vector(m.lever[r], 0), arm)
    for i in range(m.n):
        dw, dal, dacc = vector(m.dw[i], 0), vector(m.dal[i], 0), back(m.D[i], m.acc)
        turned = plus(plus(cross(dw, wz), 1.0, cross(w, cross(dw, z))), 1.0, cross(dal, z))
        pull = plus(times(m.D[i], swing), 1.0, times(m.A, plus(turned, 2.0, cross(dw, z1))))
        turned = plus(plus(cross(z, dacc), 1.0, cross(w, inert(T, dw))), 1.0, cross(dw, Jw))
        turned = plus(plus(turned, 2.0, inert(T1, dw)), 1.0, inert(T, dal))
        for r in range(3):
            H[r, 3 + i] += pull[r]
        for r in range(m.n):
            H[3 + r, 3 + i] += dot(vector(m.lever[r], 0), turned)
        if m.elastic:
            add(out.sigma_y[3 + i], j, 1.0, dacc)
            add(out.tau[3 + i], j, 1.0, cross(acc, vector(m.lever[i], 0)))
            for f in range(count):
                out.sigma_y[3 + i, j + 3 + f] = (
                    factor(dual[f], dw, w) + factor(dual[f], w, dw) - dot(axial(dual[f]), dal))
    if not m.elastic:
        return
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
