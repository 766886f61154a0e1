"""Displacements of a body with prescribed motion in one step, as functions on arrays (arrays.py):
the equations of driven.py, iterated with two products in the leading modes."""

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.reducers.step.acceptance import LEAST, TRUSTED, estimated_error
from sparsemor.reducers.step.compiled.arrays import ModelArrays, PrescribedArrays, RunArrays
from sparsemor.reducers.step.compiled.dense import add_products, product
from sparsemor.reducers.step.compiled.local import local_rows, rows_of, variables
from sparsemor.reducers.step.compiled.mechanics import LEFT, SLOW


def solve_prescribed(
    m: ModelArrays, bodies: Sequence[PrescribedArrays], run: RunArrays, timed: FloatArray,
    forces: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, d: FloatArray,
    free: FloatArray, rate: FloatArray
) -> int:
    """Solves the mechanical equations of all bodies and adds their increments to d; returns the
    largest number of iterations, or LEFT."""
    elastic, most = run.elastic.copy(), 1
    run.remaining[0] = 0.0
    for b in bodies:
        for i in b.idle:
            d[i] = -free[i]
            x[i], v[i], a[i] = 0.0, rate[i] + m.c1 * d[i], m.c2 * d[i]
        count = solve_body(
            m, b, run, elastic, timed, forces[b.u : b.u + len(b.active)], x, v, a, d)
        if count == LEFT:
            return LEFT
        most = max(most, count)
    run.elastic[:] = elastic
    return most


def solve_body(
    m: ModelArrays, b: PrescribedArrays, run: RunArrays, elastic: FloatArray, timed: FloatArray,
    forces: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, d: FloatArray
) -> int:
    """Solves for the displacements of one body with these thermal forces (s,); returns the number
    of iterations, or LEFT."""
    k, g, s, table = b.k, len(b.G), len(b.active), timed[b.table : b.table + b.width]
    u, uv, ua = x[b.u : b.u + k], v[b.u : b.u + k], a[b.u : b.u + k]
    image = table[len(table) - s :] + forces + product(b.inertia, ua) + product(b.stiffness, u)
    if len(b.damping):
        image += product(b.damping, uv)
    inputs = np.concatenate((u, x[b.T : b.T + b.kt]))
    rates = np.concatenate((uv, v[b.T : b.T + b.kt]))
    local = len(b.local.terms) > 0
    if len(b.still.terms):
        image -= rows_of(b.still, timed, inputs[k:], rates[k:])
    values, by_time = np.empty(len(b.local.offset)), np.empty(len(b.local.offset))
    if local:
        variables(b.local, timed, inputs, rates, values, by_time)
    bound = table[len(table) - s - 1]
    now, wide = np.zeros(s), np.zeros(k)
    push = np.zeros(k)
    start = np.zeros(s)
    for j in range(s):
        start[j] = x[b.active[j]]
    if bound == 0.0 and not local:  # nothing turns: that is all
        for j in range(s):
            d[b.active[j]] += image[j]
        return 1
    last, before = inf, inf
    for iteration in range(1, m.max_iterations + 1):
        for i in range(g):
            kappa, mu = table[i], table[g + i]
            if kappa != 0.0 or mu != 0.0:
                for j in range(k):
                    push[j] = (kappa * u[j] + mu * uv[j] if iteration == 1 else
                               (kappa + m.c1 * mu) * wide[j])
                image -= np.dot(push, b.G[i])
        rest = image.copy()
        if local:
            rest -= local_rows(b.local, timed, values, by_time, by_time, m.c1, 0.0, now)
        new = rest.copy()
        corrected(m, b, table, rest, now, new)
        moved2, size = 0.0, 0.0
        for j in range(s):
            moved2 += (new[j] - now[j]) ** 2
            size += (start[j] + new[j]) ** 2
            wide[b.active[j] - b.u] = new[j] - now[j]
        if not size < inf:
            return LEFT
        elastic[b.number] = max(elastic[b.number], size)
        change = 0.0
        if elastic[b.number] > 0.0:
            change = sqrt(moved2 / elastic[b.number])
        elif moved2 > 0.0:
            return LEFT
        error = estimated_error(change, before, max(bound, LEAST) if local else LEAST)
        if bound < TRUSTED and not local:
            error = change * bound / (1.0 - bound)
        if error <= m.remaining:
            for j in range(s):
                d[b.active[j]] += new[j]
            run.remaining[0] = max(run.remaining[0], error)
            return iteration
        if change > SLOW * last:
            return LEFT
        last, before = change, change
        now[:] = new
    return LEFT


def corrected(
    m: ModelArrays, b: PrescribedArrays, table: FloatArray, image: FloatArray, now: FloatArray,
    new: FloatArray
) -> None:
    """Second product in the leading modes, which contract least."""
    r, g = b.leading.shape[1], len(b.G)
    if r:
        change = image[:r] - now[:r]
        for i in range(g):
            weight = table[i] + m.c1 * table[g + i]
            if weight != 0.0:
                new[:r] -= weight * np.dot(b.leading[i * r : (i + 1) * r], change)


def thermal_forces(bodies: Sequence[PrescribedArrays], x: FloatArray) -> FloatArray:
    """Thermal terms (T, n) of all steps at the unknowns x (T, n): those of a body start at its
    first displacement."""
    found = np.zeros(x.shape)
    for b in bodies:
        add_products(b.coupling, x, b.T, found, b.u)
    return found
