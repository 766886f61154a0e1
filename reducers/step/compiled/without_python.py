"""Steps without Python: the kernel with a Jacobian by differences, as functions for numba.

Everywhere else a step that needs a new Jacobian is left to NumPy (newton_loop.py,
thermal_block.py). Here J is made of central differences of the residual at the guess of the step,
with a departure of SMALL times the largest value of each block: the equations are polynomials of
second order but for sines and local terms, so that its error is round-off. An approximate Jacobian
changes the number of iterations, not what they converge to.
"""

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.core.protocols.poses import LEFT
from sparsemor.reducers.step.compiled.kernel import advance, predicted, solve_all_heat
from sparsemor.reducers.step.compiled.local_terms import LocalArrays, rows_of
from sparsemor.reducers.step.compiled.model_arrays import (
    EquationArrays,
    HeatArrays,
    ModelArrays,
    RunArrays,
    StepArrays,
)
from sparsemor.reducers.step.compiled.reduced_equations import begin, motion, residual
from sparsemor.reducers.step.convergence_test import EPS
from sparsemor.reducers.step.newton_loop import UNKNOWN

SMALL = 1e-6
"""Departure in differences, relative to the largest value of its block."""


def take(
    m: ModelArrays, heat: tuple[HeatArrays, ...], eq: EquationArrays, w: StepArrays, run: RunArrays,
    timed: FloatArray, base: FloatArray, bounds: FloatArray, ahead: FloatArray, states: FloatArray,
    effort: FloatArray, J: FloatArray
) -> int:
    """Takes one step; returns 1, or 0 where it does not converge. J (s, s): working array; others:
    as in `kernel.advance`, with the functions of time (1, q) and the rows (1, n) that depend on
    these alone in `timed` and `base`. h.ready[0]: 1 where a thermal block has a Jacobian;
    run.effort[2]: 1 where the mechanics need a new one; run.ring[run.at[0]]: the last state."""
    last = run.ring[run.at[0], : len(w.d)]
    for attempt in range(2):
        if attempt:  # from the last state, in case that the extrapolation led astray
            run.at[1] = min(run.at[1], 1)
            run.by_departure[:] = False
        if attempt or run.effort[2] or lacks_jacobian(heat):
            predicted(m, run, w)
            if len(heat) > 0:
                for h in heat:
                    if len(h.inverse) and (attempt or not h.ready[0]):
                        differences_of_heat(h, h.local, m, w, timed[0], last)
                        h.ready[0] = 1
            solve_all_heat(m, heat, w, timed[0], base[0], last)
            if eq.moves and (attempt or run.effort[2]):
                differences(m, eq, w, run, base[0], timed[0], J)
            run.effort[2] = 0
        if advance(m, heat, eq, w, run, timed, base, bounds, ahead, states, effort):
            return 1
    return 0


def lacks_jacobian(heat: tuple[HeatArrays, ...]) -> bool:
    """True if a thermal block with local terms has no Jacobian."""
    if len(heat) > 0:
        for h in heat:
            if len(h.inverse) and not h.ready[0]:
                return True
    return False


def differences(
    m: ModelArrays, eq: EquationArrays, w: StepArrays, run: RunArrays, base: FloatArray,
    timed: FloatArray, J: FloatArray
) -> None:
    """The inverse Jacobian of the mechanical equations at the guess of a step, with what rounding
    changes, in `run`. base (n,): rows that depend on time alone; what the temperatures add to these
    is the same in all differences."""
    motion(m, w)
    begin(m, eq, w, base, timed)
    s = len(eq.solved)
    for k in range(len(m.starts) - 1):
        top = run.top[k]
        for j in range(m.starts[k], m.starts[k + 1]):
            top = max(top, abs(w.X[0, j]))
        small = SMALL if m.judged[k] else 1.0  # joint forces act linearly
        for j in range(m.starts[k], m.starts[k + 1]):
            w.guess[j] = small * top if top > 0.0 else small
    for c in range(s):
        j = eq.solved[c]
        d, e = w.d[j], w.guess[j]
        w.d[j] = d + e
        residual(m, eq, w, timed)
        for i in range(s):
            J[i, c] = w.r[eq.solved[i]]
        w.d[j] = d - e
        residual(m, eq, w, timed)
        for i in range(s):
            J[i, c] = (J[i, c] - w.r[eq.solved[i]]) / (2.0 * e)
        w.d[j] = d
    motion(m, w)
    for i in range(s):  # signs as in a vector of random ones
        total = 0.0
        for c in range(s):
            total += abs(J[i, c]) * abs(w.X[0, eq.solved[c]])
        w.own[i] = EPS * total * (1.0 if (i * 2654435761) % 4294967296 < 2147483648 else -1.0)
    inverted(J, run.inverse)
    for k in range(len(m.starts) - 1):
        run.noise[k] = 0.0
    for i in range(s):
        total, k = 0.0, 0
        for c in range(s):
            total += run.inverse[i, c] * w.own[c]
        while m.starts[k + 1] <= eq.solved[i]:
            k += 1
        run.noise[k] = max(run.noise[k], abs(total))
    for k in range(len(m.quaternions)):
        turns_from_here(w.X[0], m.quaternions[k], run.attitudes[k])
    run.effort[0], run.effort[1] = UNKNOWN, 0


def differences_of_heat(
    h: HeatArrays, local: tuple[LocalArrays, ...], m: ModelArrays, w: StepArrays, timed: FloatArray,
    last: FloatArray
) -> None:
    """The inverse Jacobian of a thermal block with `local` terms at the guess of a step, in
    h.inverse: of 1 + the derivative of the terms by T, with dT' = c1 dT and dT'' = c2 dT. last
    (n,): unknowns of the last step."""
    if len(local) == 0:
        return
    x, v = w.X[0][h.at], w.X[1][h.at]
    k, top = len(x), 0.0
    bend = (2.0 / m.h**2) * ((last[h.at] - x) + m.h * v) if m.c2_first != 0.0 else np.zeros(k)
    for j in range(k):
        top = max(top, abs(x[j]))
    J, e = np.zeros((k, k)), SMALL * top if top > 0.0 else SMALL
    for c in range(k):
        d = np.zeros(k)
        d[c] = e
        up = rows_of(local[0], timed, x + d, v + m.c1_first * d, bend + m.c2_first * d)
        down = rows_of(local[0], timed, x - d, v - m.c1_first * d, bend - m.c2_first * d)
        for i in range(k):
            J[i, c] = (up[i] - down[i]) / (2.0 * e) + (1.0 if i == c else 0.0)
    inverted(J, h.inverse)


def turns_from_here(x: FloatArray, at: int, T: FloatArray) -> None:
    """`turns_from` the quaternion of x (n,) with first unknown `at`, in T (4, 4, 4): the matrices
    LEFT_c (sum_b q_b LEFT_b)^T."""
    for c in range(4):
        for i in range(4):
            for j in range(4):
                T[c, i, j] = 0.0
                for k in range(4):
                    for b in range(4):
                        T[c, i, j] += LEFT[c, i, k] * x[at + b] * LEFT[b, j, k]


def inverted(A: FloatArray, inverse: FloatArray) -> None:
    """The inverse of A (s, s), which is destroyed, by Gauss-Jordan elimination with pivots by
    columns. An unknown whose pivot is round-off, such as a joint force that nothing determines,
    does not change."""
    s = len(A)
    for i in range(s):
        for j in range(s):
            inverse[i, j] = 1.0 if i == j else 0.0
    for c in range(s):
        pivot, largest = c, 0.0
        for i in range(c):
            largest = max(largest, abs(A[i, c]))
        for i in range(c + 1, s):
            if abs(A[i, c]) > abs(A[pivot, c]):
                pivot = i
        if pivot != c:
            for j in range(s):
                A[c, j], A[pivot, j] = A[pivot, j], A[c, j]
                inverse[c, j], inverse[pivot, j] = inverse[pivot, j], inverse[c, j]
        size = A[c, c]
        if abs(size) <= 1e3 * EPS * largest or size == 0.0:
            for j in range(s):
                A[c, j], A[j, c], inverse[c, j] = 0.0, 0.0, 0.0
            continue
        for j in range(s):
            A[c, j] /= size
            inverse[c, j] /= size
        for i in range(s):
            factor = A[i, c]
            if i != c and factor != 0.0:
                for j in range(s):
                    A[i, j] -= factor * A[c, j]
                    inverse[i, j] -= factor * inverse[c, j]


def given(
    values: FloatArray, numbers: IntArray, table: FloatArray, changes: FloatArray,
    by_input: FloatArray, timed: FloatArray, base: FloatArray
) -> None:
    """Functions of time timed (1, q), and rows base (1, n) that depend on these alone, in a step:
    constant `values` (q + n,), those with these numbers replaced by the row `table` of a table, and
    what the inputs' changes (i,) from their first values add, by_input (i, q + n)."""
    q = timed.shape[1]
    for j in range(len(values)):
        total = values[j]
        for i in range(len(changes)):
            total += changes[i] * by_input[i, j]
        if j < q:
            timed[0, j] = total
        else:
            base[0, j - q] = total
    for c in range(len(numbers)):
        j = numbers[c]
        if j < q:
            timed[0, j] += table[c] - values[j]
        else:
            base[0, j - q] += table[c] - values[j]


def outputs(
    z: FloatArray, about: IntArray, numbers: FloatArray, weights: FloatArray, values: FloatArray
) -> None:
    """Values (o,) of outputs of the state z (q, n).

    about (o, 8): kind, then by kind. 0: row and column of z. 1, temperature or displacement: first
    unknown, their number k, first of k `weights`. 2, component c of a position: c, dimension d,
    first rigid coordinate or -1, their number, first unknown, number k of displacements, first of k
    d weights. numbers (o, 10): 1: constant part; 2: coordinates (3,) of the point, and a fixed pose
    (7,).
    """
    for o in range(len(about)):
        kind, a = about[o, 0], about[o]
        if kind == 0:
            values[o] = z[a[1], a[2]]
            continue
        if kind == 1:
            total = numbers[o, 0]
            for j in range(a[2]):
                total += weights[a[3] + j] * z[0, a[1] + j]
            values[o] = total
            continue
        c, d, rigid, size, first, k, at = a[1], a[2], a[3], a[4], a[5], a[6], a[7]
        # pose: position, then an angle or a unit quaternion, by which the point (x, y, u) is turned
        p = numbers[o, 3:10] if rigid < 0 else z[0, rigid : rigid + size]
        x, y, u = numbers[o, 0], numbers[o, 1], numbers[o, 2]
        for j in range(k):
            own = z[0, first + j]
            x += own * weights[at + j * d]
            y += own * weights[at + j * d + 1]
            if d == 3:
                u += own * weights[at + j * d + 2]
        if size < 7:
            cos, sin = np.cos(p[size - 1]), np.sin(p[size - 1])
            if c == 0:
                values[o] = p[0] + cos * x - sin * y
            elif c == 1:
                values[o] = p[1] + sin * x + cos * y
            else:
                values[o] = p[2] + u
            continue
        e0, e1, e2, e3 = p[3], p[4], p[5], p[6]
        scale, along = e0**2 - e1**2 - e2**2 - e3**2, e1 * x + e2 * y + e3 * u
        if c == 0:
            values[o] = p[0] + scale * x + 2 * e1 * along + 2 * e0 * (e2 * u - e3 * y)
        elif c == 1:
            values[o] = p[1] + scale * y + 2 * e2 * along + 2 * e0 * (e3 * x - e1 * u)
        else:
            values[o] = p[2] + scale * u + 2 * e3 * along + 2 * e0 * (e1 * y - e2 * x)
