"""Steps of a reduced model as functions on arrays (arrays.py), which numba compiles.

The equations are those of predictor.py, thermal_block.py and condensed_newton.py; tests compare
both. A step that does not converge at once is left to these (`LEFT`): they have the estimate of
round-off, acceleration, and the full Newton iteration.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.compiled.arrays import (
    BodyArrays,
    HeatArrays,
    MechanicsWork,
    ModelArrays,
    PrescribedArrays,
    RunArrays,
)
from sparsemor.reducers.step.compiled.mechanics import LEFT, solve_mechanics
from sparsemor.reducers.step.compiled.prescribed import solve_prescribed


def advance(
    m: ModelArrays, heat: Sequence[HeatArrays], bodies: BodyArrays, work: MechanicsWork,
    prescribed: Sequence[PrescribedArrays], run: RunArrays, timed: FloatArray, targets: FloatArray,
    states: FloatArray, effort: FloatArray,
) -> int:
    """Takes up to len(timed) steps and returns how many were solved; `run` is then at the last of
    these.

    timed (T, q): amplitudes, tables and prescribed motion in each step; targets (T, N): prescribed
    values of the constraints; states (T, 3 + j, n), effort (T, 2): states, and numbers of
    iterations with the estimated errors that they leave.
    """
    n = run.z.shape[1]
    free, rate, d = np.zeros(n), np.zeros(n), np.zeros(n)
    x, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    guess = np.zeros(2 * n)
    for i in range(len(timed)):
        free_motion(m, run.z, free, rate)
        predict(m, run, guess)
        for j in range(n):
            d[j] = guess[n + j] if run.by_departure[j] else guess[j] - free[j]
        at_departure(m, d, free, rate, x, v, a)
        for h in heat:
            heated(h, m.c1_first, timed[i], x, v, d)
        if len(bodies.k):
            count = solve_mechanics(
                m, bodies, work, run, timed[i], targets[i], x, v, a, d, free, rate)
        else:
            count = solve_prescribed(m, prescribed, run, timed[i], x, v, a, d, free, rate)
        if count == LEFT:
            return i
        at_departure(m, d, free, rate, x, v, a)
        size = 0.0
        for j in range(n):
            size += (x[j] * m.sanity[j]) ** 2
        if not size <= 1.0:
            return i
        accept(m, run, guess, x, v, a, d)
        states[i] = run.z
        effort[i, 0], effort[i, 1] = count, run.remaining[0]
    return len(timed)


def free_motion(m: ModelArrays, z: FloatArray, free: FloatArray, rate: FloatArray) -> None:
    """Motion without the new highest rates (core/protocols/integrator.py)."""
    free[:] = 0.0
    rate[:] = 0.0
    for c in range(len(z)):
        of_x, of_v = m.second_old[0, c], m.second_old[1, c]
        for i in range(m.second[0], m.second[1]):
            free[i] += of_x * z[c, i]
            rate[i] += of_v * z[c, i]
        of_x = m.first_old[0, c]
        for i in range(m.first[0], m.first[1]):
            free[i] += of_x * z[c, i]


def at_departure(
    m: ModelArrays, d: FloatArray, free: FloatArray, rate: FloatArray, x: FloatArray,
    v: FloatArray, a: FloatArray
) -> None:
    """Unknowns x and rates v, a at the departure d from the free motion."""
    x[:] = free + d
    v[:] = 0.0
    a[:] = 0.0
    for i in range(m.second[0], m.second[1]):
        v[i] = rate[i] + m.c1 * d[i]
        a[i] = m.c2 * d[i]
    for i in range(m.first[0], m.first[1]):
        v[i] = m.c1_first * d[i]


def predict(m: ModelArrays, run: RunArrays, guess: FloatArray) -> None:
    """Extrapolated unknowns and departures (2 n,)."""
    points = len(run.ring)
    guess[:] = 0.0
    for j in range(run.at[1]):
        weight, past = m.weights[run.at[1], j], run.ring[(run.at[0] - j) % points]
        for i in range(len(guess)):
            guess[i] += weight * past[i]


def accept(
    m: ModelArrays, run: RunArrays, guess: FloatArray, x: FloatArray, v: FloatArray,
    a: FloatArray, d: FloatArray
) -> None:
    """Stores a solved step: past states for the predictor, reference magnitudes, and the state."""
    n, points = len(x), len(run.ring)
    for k in range(len(m.starts) - 1):
        by_value, by_departure = 0.0, 0.0
        for i in range(m.starts[k], m.starts[k + 1]):
            by_value = max(by_value, abs(guess[i] - x[i]))
            by_departure = max(by_departure, abs(guess[n + i] - d[i]))
        run.by_departure[m.starts[k] : m.starts[k + 1]] = by_departure < by_value
    newest = (run.at[0] + 1) % points
    run.ring[newest, :n] = x
    run.ring[newest, n:] = d
    run.at[0], run.at[1] = newest, min(run.at[1] + 1, points)
    for i in range(len(m.displacements)):
        size = 0.0
        for j in range(m.displacements[i, 0], m.displacements[i, 1]):
            size += a[j] * a[j]
        run.bending[i] = max(run.bending[i], size)
    size = 0.0
    for j in range(m.rigid):
        size += a[j] * a[j]
    run.acceleration[0] = max(run.acceleration[0], sqrt(size))
    new_state(m, run.z, x, v, a)


def new_state(
    m: ModelArrays, z: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray
) -> None:
    """State after the step, overwriting the one before."""
    rows = len(z)
    new = np.zeros(rows)
    for i in range(m.second[0], m.second[1]):
        for r in range(3, rows):
            new[r] = m.second_new[r] * a[i]
            for c in range(rows):
                new[r] += m.second_old[r, c] * z[c, i]
        for r in range(3, rows):
            z[r, i] = new[r]
    for i in range(m.first[0], m.first[1]):
        for r in range(2, rows):
            new[r] = m.first_new[r] * v[i]
            for c in range(rows):
                new[r] += m.first_old[r, c] * z[c, i]
        a[i] = new[2]
        for r in range(3, rows):
            z[r, i] = new[r]
    z[0] = x
    z[1] = v
    z[2] = a


def heated(
    h: HeatArrays, c1: float, timed: FloatArray, x: FloatArray, v: FloatArray, d: FloatArray
) -> None:
    """Solves a thermal block (thermal_block.py), in place."""
    for i in h.idle:
        v[i] -= c1 * x[i]
        d[i] -= x[i]
        x[i] = 0.0
    r = h.base.copy()
    for j in range(len(h.loads)):
        r += h.loads[j] * timed[h.amplitude + j]
    if h.table >= 0:
        r += timed[h.table : h.table + len(r)]
    add_product(h.by_rate, v, h.at, r)
    add_product(h.by_value, x, h.at, r)
    for j in range(len(r)):
        i = h.active[j]
        d[i] += r[j]
        x[i] += r[j]
        v[i] += c1 * r[j]


def add_product(A: FloatArray, x: FloatArray, at: IntArray, y: FloatArray) -> None:
    """Adds A x[at] to y (s,) for the transpose (k, s) of a matrix A, or (1, k) for a diagonal."""
    if len(A) == 1:
        for j in range(len(y)):
            y[j] += A[0, j] * x[at[j]]
    else:
        for c in range(len(A)):
            for j in range(len(y)):
                y[j] += A[c, j] * x[at[c]]
