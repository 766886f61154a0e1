"""Steps of a reduced model as functions on arrays (arrays.py), which numba compiles.

The equations are those of predictor.py, thermal_block.py and elastic_block.py; tests compare
both. A step that does not converge at once is left to these (`LEFT`): they have the estimate of
round-off, acceleration, and the full Newton iteration.
"""

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.core.protocols.integrator import same_time
from sparsemor.core.protocols.poses import steered, tangent
from sparsemor.reducers.step.acceptance import estimated_error
from sparsemor.reducers.step.blocks.thermal_block import RENEWED, SLOW, TINY
from sparsemor.reducers.step.compiled.arrays import (
    BodyArrays,
    BodyTerms,
    HeatArrays,
    KeptHeat,
    MechanicsWork,
    ModelArrays,
    PrescribedArrays,
    RunArrays,
)
from sparsemor.reducers.step.compiled.dense import product
from sparsemor.reducers.step.compiled.local import (
    bends,
    evaluate_points,
    factor_in_place,
    local_rows,
    solve_factored,
    variables,
)
from sparsemor.reducers.step.compiled.mechanics import LEFT, solve_mechanics
from sparsemor.reducers.step.compiled.prescribed import solve_prescribed, thermal_forces

ROUND_OFF = same_time(1.0)
"""Largest second difference that is round-off, relative to the unknown."""


def advance(
    m: ModelArrays, heat: Sequence[HeatArrays], kept: Sequence[KeptHeat], bodies: BodyArrays,
    terms: Sequence[BodyTerms], work: MechanicsWork, prescribed: Sequence[PrescribedArrays],
    run: RunArrays, timed: FloatArray, targets: FloatArray, states: FloatArray, effort: FloatArray,
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
    guess, new = np.zeros(2 * n), np.zeros((len(run.z), n))
    warm, warmed = np.zeros((len(timed), n)), np.zeros((len(timed), n))
    linear = True
    for h in heat:
        linear = linear and not len(h.local.terms)
    if linear:
        heat_ahead(m, heat, kept, run.z.copy(), timed, warm, warmed, new)
    forces = thermal_forces(prescribed, warm)
    for i in range(len(timed)):
        free_motion(m, run.z, free, rate)
        predict(m, run, guess)
        for j in range(n):
            d[j] = guess[n + j] if run.by_departure[j] else guess[j] - free[j]
        for start in m.quaternions:
            steered(d[start : start + 4], free[start : start + 4])
        if linear:
            for j in range(m.first[0], m.first[1]):
                d[j] = warmed[i, j]
        at_departure(m, d, free, rate, x, v, a)
        most, hot = 1, 0.0
        if not linear:
            for g in range(len(heat)):
                taken, left = heated(
                    heat[g], kept[g], i, m, timed[i], run.ring[run.at[0], :n], x, v, d)
                if taken == LEFT:
                    return i
                most, hot = max(most, taken), max(hot, left)
            forces[i] = thermal_forces(prescribed, x.reshape(1, n))[0]
        if len(bodies.k):
            count = solve_mechanics(
                m, bodies, terms, work, run, timed[i], targets[i], x, v, a, d, free, rate)
        else:
            count = solve_prescribed(
                m, prescribed, run, timed[i], forces[i], x, v, a, d, free, rate)
        if count == LEFT:
            return i
        run.remaining[0] = max(run.remaining[0], hot)
        if not len(bodies.k) and not len(prescribed):
            count = most
        at_departure(m, d, free, rate, x, v, a)
        size = 0.0
        for j in range(n):
            size += (x[j] * m.sanity[j]) ** 2
        if not size <= 1.0:
            return i
        accept(m, run, guess, x, v, a, d, new)
        states[i] = run.z
        effort[i, 0], effort[i, 1] = count, run.remaining[0]
    return len(timed)


def heat_ahead(
    m: ModelArrays, heat: Sequence[HeatArrays], kept: Sequence[KeptHeat], z: FloatArray,
    timed: FloatArray, x: FloatArray, d: FloatArray, new: FloatArray
) -> None:
    """Temperatures x and their departures d from the free motion (T, n) in all steps from the state
    z, which is overwritten, without local terms: they depend on no other unknowns. new: working
    array."""
    v = np.zeros(len(new[0]))
    for i in range(len(timed)):
        free_first(m, z, x[i])
        v[:] = 0.0
        for g in range(len(heat)):
            heated(heat[g], kept[g], i, m, timed[i], x[i], x[i], v, d[i])
        new_first(m, z, x[i], d[i], new)


def free_motion(m: ModelArrays, z: FloatArray, free: FloatArray, rate: FloatArray) -> None:
    """Motion without the new highest rates (core/protocols/integrator.py)."""
    free[:] = 0.0
    rate[:] = 0.0
    start, end = m.second[0], m.second[1]
    x, v = free[start:end], rate[start:end]
    for c in range(len(z)):
        of_x, of_v, past = m.second_old[0, c], m.second_old[1, c], z[c][start:end]
        for i in range(len(x)):
            x[i] += of_x * past[i]
            v[i] += of_v * past[i]
    free_first(m, z, free)


def free_first(m: ModelArrays, z: FloatArray, free: FloatArray) -> None:
    """Free motion of the unknowns of first order."""
    start, end = m.first[0], m.first[1]
    x = free[start:end]
    x[:] = 0.0
    for c in range(len(z)):
        of_x, past = m.first_old[0, c], z[c][start:end]
        for i in range(len(x)):
            x[i] += of_x * past[i]


def at_departure(
    m: ModelArrays, d: FloatArray, free: FloatArray, rate: FloatArray, x: FloatArray,
    v: FloatArray, a: FloatArray
) -> None:
    """Unknowns x and rates v, a at the departure d from the free motion."""
    for i in range(len(x)):
        x[i] = free[i] + d[i]
    v[:] = 0.0
    a[:] = 0.0
    start, end = m.second[0], m.second[1]
    v2, a2, d2, past = v[start:end], a[start:end], d[start:end], rate[start:end]
    for i in range(len(d2)):
        v2[i] = past[i] + m.c1 * d2[i]
        a2[i] = m.c2 * d2[i]
    start, end = m.first[0], m.first[1]
    v1, d1 = v[start:end], d[start:end]
    for i in range(len(d1)):
        v1[i] = m.c1_first * d1[i]


def predict(m: ModelArrays, run: RunArrays, guess: FloatArray) -> None:
    """Extrapolated unknowns and departures (2 n,)."""
    points = len(run.ring)
    guess[:] = 0.0
    for j in range(run.at[1]):
        weight, row = m.weights[run.at[1], j], (run.at[0] - j) % points
        for i in range(len(guess)):
            guess[i] += weight * run.ring[row, i]


def accept(
    m: ModelArrays, run: RunArrays, guess: FloatArray, x: FloatArray, v: FloatArray,
    a: FloatArray, d: FloatArray, new: FloatArray
) -> None:
    """Stores a solved step: past states for the predictor, reference magnitudes, and the state."""
    n, points = len(x), len(run.ring)
    for k in range(len(m.starts) - 1):
        by_value, by_departure = 0.0, 0.0
        for i in range(m.starts[k], m.starts[k + 1]):
            by_value = max(by_value, abs(guess[i] - x[i]))
            by_departure = max(by_departure, abs(guess[n + i] - d[i]))
        for i in range(m.starts[k], m.starts[k + 1]):
            run.by_departure[i] = by_departure < by_value
    newest = (run.at[0] + 1) % points
    for i in range(n):
        run.ring[newest, i], run.ring[newest, n + i] = x[i], d[i]
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
    new_state(m, run.z, x, v, a, d, new)


def new_state(
    m: ModelArrays, z: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, d: FloatArray,
    new: FloatArray
) -> None:
    """State after the step, overwriting the one before; new: working array."""
    update(z, m.second, m.second_old, m.second_new, 3, a, new)
    new_first(m, z, x, d, new)
    n, start, end = len(x), m.first[0], m.first[1]
    for i in range(n):
        z[0, i], z[1, i] = x[i], v[i]
    for i in range(n):
        if not start <= i < end:
            z[2, i] = a[i]
    for start in m.quaternions:
        tangent(z[0, start : start + 4], z[1, start : start + 4], z[2, start : start + 4])


def new_first(
    m: ModelArrays, z: FloatArray, x: FloatArray, d: FloatArray, new: FloatArray
) -> None:
    """New unknowns of first order in the state z, at x and the departure d; new: working array."""
    rates, start, end = new[1], m.first[0], m.first[1]
    for i in range(len(d)):
        rates[i] = m.c1_first * d[i]
    update(z, m.first, m.first_old, m.first_new, 2, rates, new)
    x1, v1, new_x, new_v = x[start:end], rates[start:end], z[0][start:end], z[1][start:end]
    for i in range(len(x1)):
        new_x[i], new_v[i] = x1[i], v1[i]


def update(
    z: FloatArray, ends: IntArray, old: FloatArray, own: FloatArray, first: int, q: FloatArray,
    new: FloatArray
) -> None:
    """Rows from number `first` on of the new state, by a rule (`UpdateRule`) for the unknowns
    between `ends` with the highest rates q; new: working array."""
    start, end = ends[0], ends[1]
    for r in range(first, len(z)):
        row, of_q = new[r][start:end], q[start:end]
        for i in range(len(row)):
            row[i] = own[r] * of_q[i]
        for c in range(len(z)):
            factor, past = old[r, c], z[c][start:end]
            for i in range(len(row)):
                row[i] += factor * past[i]
    for r in range(first, len(z)):
        row, past = new[r][start:end], z[r][start:end]
        for i in range(len(row)):
            past[i] = row[i]


def heated(
    h: HeatArrays, kept: KeptHeat, number: int, m: ModelArrays, timed: FloatArray,
    last: FloatArray, x: FloatArray, v: FloatArray, d: FloatArray
) -> tuple[int, float]:
    """Solves a thermal block (thermal_block.py) in step `number`, in place; returns the number of
    iterations, or LEFT, and the estimated error. last (n,): unknowns of the last step."""
    c1 = m.c1_first
    for i in h.idle:
        v[i] -= c1 * x[i]
        d[i] -= x[i]
        x[i] = 0.0
    r = h.base.copy()
    for j in range(h.loads.shape[1]):
        r += h.loads[:, j] * timed[h.amplitude + j]
    if h.table >= 0:
        r += timed[h.table : h.table + len(r)]
    r += product(h.by_rate, v[h.at]) + product(h.by_value, x[h.at])
    count, error = 1, 0.0
    if len(h.local.terms):
        count, error = iterate_heat(h, kept, number, m, timed, last, x, v, r)
        if count == LEFT:
            return LEFT, 0.0
    for j in range(len(r)):
        i = h.active[j]
        d[i] += r[j]
        x[i] += r[j]
        v[i] += c1 * r[j]
    return count, error


def renewed(
    h: HeatArrays, kept: KeptHeat, c1: float
) -> bool:
    """Evaluates and factorizes the Jacobian at `kept.at`; False where it is singular."""
    a, J = h.local, kept.J
    z, w, u = np.empty(len(a.offset)), np.empty(len(a.offset)), np.empty(len(a.offset))
    variables(a, kept.timed, kept.at[0], kept.at[1], z, w)
    bends(a, kept.timed, kept.at[2], u)
    flux, slope = np.empty(a.L.shape[1]), np.empty((a.L.shape[1], len(J)))
    evaluate_points(a, kept.timed, z, w, u, c1, flux, slope)
    np.dot(a.L, slope, J)
    for i in range(len(J)):
        J[i, i] += 1.0
    kept.state[0] = 2 if factor_in_place(J, kept.pivots) else 0
    return bool(kept.state[0] > 0)


def iterate_heat(
    h: HeatArrays, kept: KeptHeat, number: int, m: ModelArrays, timed: FloatArray,
    last: FloatArray, x: FloatArray, v: FloatArray, r: FloatArray
) -> tuple[int, float]:
    """Increments of a thermal block with local terms by Newton's method, in r, which has those
    without local terms; returns the number of iterations, or LEFT, and the estimated relative
    error."""
    a, T, s, c1, c2 = h.local, x[h.at], len(r), m.c1_first, m.c2_first
    far, top = 0.0, 0.0
    for i in h.at:
        far, top = max(far, abs(x[i] - last[i])), max(top, abs(last[i]))
    if far > 0.1 * top:
        return LEFT, 0.0
    if len(h.active) < len(h.at):  # others may be active in the next step
        kept.state[0] = 0
    if kept.state[0] == 1 and not renewed(h, kept, c1):
        return LEFT, 0.0
    z, w = np.empty(len(a.offset)), np.empty(len(a.offset))
    variables(a, timed, T, v[h.at], z, w)
    bend, u = np.zeros(len(T)), np.zeros(len(a.offset))
    if c2 != 0.0:
        for j in range(len(T)):
            i = h.at[j]
            bend[j] = (last[i] - x[i]) + m.h * v[i]
            if abs(bend[j]) <= ROUND_OFF * abs(x[i]):
                bend[j] = 0.0
            bend[j] *= 2.0 / m.h**2
    bends(a, timed, bend, u)
    d, before, first = np.zeros(s), inf, 0.0
    for iteration in range(1, h.iterations + 1):
        step = d - r + local_rows(a, timed, z, w, u, c1, c2, d)
        if kept.state[0] == 0:
            now, rates, second = x.copy(), v.copy(), np.zeros(len(x))
            second[h.at] = bend
            for j in range(s):
                now[h.active[j]] += d[j]
                rates[h.active[j]] += c1 * d[j]
                second[h.active[j]] += c2 * d[j]
            kept.at[0, :], kept.at[1, :], kept.at[2, :] = now[h.at], rates[h.at], second[h.at]
            kept.timed[:] = timed
            kept.state[1] = number
            if not renewed(h, kept, c1):
                return LEFT, 0.0
        solve_factored(kept.J, kept.pivots, step)
        change, size = 0.0, 0.0
        for j in range(s):  # others are zero
            change = max(change, abs(step[j]))
            size = max(size, abs(x[h.active[j]] + d[j]))
        if not np.all(np.isfinite(step)):
            return LEFT, 0.0
        d -= step
        error = estimated_error(change, before)
        if iteration == 2:
            first = change / before
        if error <= h.rtol * size:
            r[:] = d
            if not first <= RENEWED:
                kept.state[0] = 0
            return iteration, error / max(size, TINY)
        if change > SLOW * before:
            kept.state[0], before = 0, inf
        else:
            before = change
    return LEFT, 0.0
