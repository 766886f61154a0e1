"""Steps of a reduced model as functions on arrays (model_arrays.py), which numba compiles.

The equations are those of predictor.py, thermal_block.py, reduced_equations.py and newton_loop.py;
tests compare both. Nothing here evaluates a Jacobian: a step that needs a new one, or does not
converge at once, is left to these (`LEFT`).
"""

from math import inf

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.core.protocols.integrator import same_time
from sparsemor.core.protocols.poses import steered, tangent
from sparsemor.reducers.step.compiled.dense_products import add_operator, add_products
from sparsemor.reducers.step.compiled.local_terms import LocalArrays, rows_of
from sparsemor.reducers.step.compiled.model_arrays import (
    EquationArrays,
    HeatArrays,
    ModelArrays,
    OperatorArrays,
    PrescribedArrays,
    RunArrays,
    StepArrays,
)
from sparsemor.reducers.step.compiled.reduced_equations import LEFT, motion, remember, solve
from sparsemor.reducers.step.convergence_test import estimated_error
from sparsemor.reducers.step.thermal_block import RENEWED, SLOW, TINY

ROUND_OFF = same_time(1.0)
"""Largest second difference that is round-off, relative to the unknown."""


def advance(
    m: ModelArrays, heat: tuple[HeatArrays, ...], eq: EquationArrays, w: StepArrays, run: RunArrays,
    timed: FloatArray, base: FloatArray, bounds: FloatArray, ahead: FloatArray, states: FloatArray,
    effort: FloatArray,
) -> int:
    """Takes up to len(timed) steps and returns how many were solved; `run` is then at the last of
    these.

    timed (T, q): amplitudes, tables and prescribed motion in each step; base (T, n): the part of
    the residual that depends on time alone; bounds (T,): proved contraction of each step, inf for
    none; ahead (3, T, n): working array; states (T, q, n), effort (T, 2): states, and numbers of
    iterations with the estimated errors that they leave.
    """
    n, first, last = len(w.d), m.first[0], m.first[1]
    T_ahead, d_ahead, rows = ahead[0], ahead[1], ahead[2]
    heat_known = heat_ahead(m, heat, eq.prescribed, w, run.z, timed, base, T_ahead, d_ahead)
    if heat_known:
        with_thermal(eq.thermal, T_ahead, base, rows)
    for i in range(len(timed)):
        predicted(m, run, w)
        count, heat_error = 1, 0.0
        if heat_known:
            for j in range(first, last):
                w.d[j] = d_ahead[i, j]
            motion(m, w)
        else:
            count, heat_error = solve_all_heat(
                m, heat, w, timed[i], base[i], run.ring[run.at[0], :n])
            for j in range(first, last):
                T_ahead[i, j] = w.X[0, j]
            now = slice(i, i + 1)
            with_thermal(eq.thermal, T_ahead[now], base[now], rows[now])
        run.remaining[0] = 0.0
        if eq.moves and count != LEFT:
            count = solve(m, eq, w, run, rows[i], timed[i], bounds[i])
        if count == LEFT:
            return i
        run.remaining[0] = max(run.remaining[0], heat_error)
        motion(m, w)
        size = 0.0
        for j in range(n):
            size += (w.X[0, j] * m.sanity[j]) ** 2
        if not size <= 1.0:
            return i
        accept(m, run, w)
        if len(heat) > 0:
            for h in heat:
                h.ready[0] %= 2
        for r in range(len(run.z)):
            for j in range(n):
                states[i, r, j] = run.z[r, j]
        effort[i, 0], effort[i, 1] = count, run.remaining[0]
        if run.effort[1] >= eq.price:
            run.effort[2] = 1
            return i + 1
    return len(timed)


def predicted(m: ModelArrays, run: RunArrays, w: StepArrays) -> None:
    """Free motion and guessed departure d of the next step, in w; w.guess (2 n,): extrapolated
    unknowns, then extrapolated departures, of which run.by_departure selects one for each
    unknown."""
    n = len(w.d)
    free_motion(m, run.z, w.free, 0, n)
    predict(m, run, w.guess)
    for j in range(n):
        w.d[j] = w.guess[n + j] if run.by_departure[j] else w.guess[j] - w.free[0, j]
    for start in m.quaternions:
        steered(w.d[start : start + 4], w.free[0, start : start + 4])
    motion(m, w)


def heat_ahead(
    m: ModelArrays, heat: tuple[HeatArrays, ...], prescribed: tuple[PrescribedArrays, ...],
    w: StepArrays, z: FloatArray, timed: FloatArray, base: FloatArray, x: FloatArray, d: FloatArray
) -> bool:
    """Temperatures x and their departures d from the free motion (T, n) in all steps from the state
    z, as they depend on no other unknowns; False where there are local terms, and without
    prescribed motion, where blocks of steps stop too often. w.past (q, n): state after each step,
    free + new d."""
    first, last = m.first[0], m.first[1]
    if len(prescribed) == 0:
        return False
    if len(heat) > 0:
        for h in heat:
            if len(h.local) > 0:
                return False
        for r in range(len(z)):
            for j in range(first, last):
                w.past[r, j] = z[r, j]
        for i in range(len(timed)):
            free_motion(m, w.past, w.free, first, last)
            w.d[:] = 0.0
            motion(m, w)
            # the last argument, temperatures before, is for local terms alone
            solve_all_heat(m, heat, w, timed[i], base[i], w.d)
            for j in range(first, last):
                d[i, j], x[i, j] = w.d[j], w.X[0, j]
                for r in range(len(z)):
                    w.past[r, j] = w.free[r, j] + m.new[r, j] * d[i, j]
    return True


def with_thermal(
    thermal: tuple[OperatorArrays, ...], x: FloatArray, base: FloatArray, rows: FloatArray
) -> None:
    """Rows (T, n): base, and the terms of temperatures in the rows of displacements at the unknowns
    x (T, n)."""
    for t in range(len(x)):
        for j in range(x.shape[1]):
            rows[t, j] = base[t, j]
    if len(thermal) > 0:
        for c in thermal:
            add_products(c.A, x, c.columns, rows, c.rows)


def free_motion(m: ModelArrays, z: FloatArray, free: FloatArray, first: int, last: int) -> None:
    """Motion without the new highest rates (core/protocols/integrator.py) of some unknowns."""
    for r in range(len(z)):
        row = free[r][first:last]
        row[:] = 0.0
        for c in range(len(z)):
            old, past = m.old[r, c][first:last], z[c][first:last]
            for i in range(len(row)):
                row[i] += old[i] * past[i]


def predict(m: ModelArrays, run: RunArrays, guess: FloatArray) -> None:
    """Extrapolated unknowns and departures (2 n,)."""
    points = len(run.ring)
    guess[:] = 0.0
    for j in range(run.at[1]):
        weight, row = m.weights[run.at[1], j], run.ring[(run.at[0] - j) % points]
        for i in range(len(guess)):
            guess[i] += weight * row[i]


def accept(m: ModelArrays, run: RunArrays, w: StepArrays) -> None:
    """Stores a solved step: past states for the predictor, reference magnitudes, and the state.
    w.guess (2 n,): what unknowns and departures were extrapolated to; of each block, that which was
    closer is taken in the next step (run.by_departure)."""
    n, points = len(w.d), len(run.ring)
    for k in range(len(m.starts) - 1):
        by_value, by_departure = 0.0, 0.0
        for i in range(m.starts[k], m.starts[k + 1]):
            by_value = max(by_value, abs(w.guess[i] - w.X[0, i]))
            by_departure = max(by_departure, abs(w.guess[n + i] - w.d[i]))
        for i in range(m.starts[k], m.starts[k + 1]):
            run.by_departure[i] = by_departure < by_value
    run.at[0], run.at[1] = (run.at[0] + 1) % points, min(run.at[1] + 1, points)
    row = run.ring[run.at[0]]
    for i in range(n):
        row[i], row[n + i] = w.X[0, i], w.d[i]
    remember(m, w, run)
    for r in range(len(run.z)):
        z, free, new = run.z[r], w.free[r], m.new[r]
        for i in range(n):
            z[i] = free[i] + new[i] * w.d[i]
    for start in m.quaternions:
        tangent(run.z[0, start : start + 4], run.z[1, start : start + 4],
                run.z[2, start : start + 4])


def solve_all_heat(
    m: ModelArrays, heat: tuple[HeatArrays, ...], w: StepArrays, timed: FloatArray,
    base: FloatArray, last: FloatArray,
) -> tuple[int, float]:
    """Solves the thermal blocks (thermal_block.py), in place; returns the largest number of
    iterations, or LEFT, and the estimated error. last (n,): unknowns of the last step. Increments
    without local terms are by_rate T' + by_value T - base, with the prediction T, T' and the rows
    `base` (n,) that depend on time alone."""
    most, error = 1, 0.0
    if len(heat) > 0:
        for h in heat:
            for j in range(len(h.at)):
                i = h.at[j]
                h.x[j], h.v[j], h.r[j] = w.X[0, i], w.X[1, i], -base[i]
            add_operator(h.by_rate, h.v, h.r)
            add_operator(h.by_value, h.x, h.r)
            count, left = iterate_heat(h, h.local, m, timed, last)
            if count == LEFT:
                return LEFT, 0.0
            most, error = max(most, count), max(error, left)
            for j in range(len(h.at)):
                i = h.at[j]
                w.d[i] += h.r[j]
                w.X[0, i] += h.r[j]
                w.X[1, i] += m.c1_first * h.r[j]
    return most, error


def iterate_heat(
    h: HeatArrays, local: tuple[LocalArrays, ...], m: ModelArrays, timed: FloatArray,
    last: FloatArray,
) -> tuple[int, float]:
    """Increments of a thermal block with `local` terms by Newton's method with the kept Jacobian,
    in h.r, which has those without local terms; returns the number of iterations, or LEFT, and the
    estimated relative error. h.x, h.v: temperatures at the prediction, with rates; last (n,):
    unknowns of the last step."""
    if len(local) == 0 or len(h.inverse) == 0:
        return 1, 0.0
    x, v, r, c1, c2 = h.x, h.v, h.r, m.c1_first, m.c2_first
    far, top, bend = 0.0, 0.0, np.zeros(len(x))
    for i in range(len(x)):
        before = last[h.at[i]]
        far, top = max(far, abs(x[i] - before)), max(top, abs(before))
        bend[i] = (before - x[i]) + m.h * v[i]
        if c2 == 0.0 or abs(bend[i]) <= ROUND_OFF * abs(x[i]):
            bend[i] = 0.0
        bend[i] *= 2.0 / m.h**2
    if far > 0.1 * top or not h.ready[0]:
        return LEFT, 0.0
    d, before, first = np.zeros(len(x)), inf, 0.0
    for iteration in range(1, h.iterations + 1):
        step = np.dot(
            h.inverse, d - r + rows_of(local[0], timed, x + d, v + c1 * d, bend + c2 * d))
        change, size, total = 0.0, 0.0, 0.0
        for j in range(len(d)):
            change, total = max(change, abs(step[j])), total + abs(step[j])
            size = max(size, abs(x[j] + d[j]))
        if not total < inf:
            return LEFT, 0.0
        d -= step
        error = estimated_error(change, before)
        if iteration == 2:
            first = change / before
        if error <= h.rtol * size:
            for j in range(len(d)):
                r[j] = d[j]
            if not first <= RENEWED:
                h.ready[0] = 2
            return iteration, error / max(size, TINY)
        if change > SLOW * before:
            return LEFT, 0.0
        before = change
    return LEFT, 0.0
