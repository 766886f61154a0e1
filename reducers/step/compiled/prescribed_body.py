"""Displacements of a body with prescribed motion in one step, as functions on arrays
(model_arrays.py): the equations of prescribed_body.py, iterated with two products in the leading
modes."""

from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.reducers.step.compiled.dense_products import add_products, product
from sparsemor.reducers.step.compiled.local_terms import rows_of
from sparsemor.reducers.step.compiled.model_arrays import (
    ModelArrays,
    PrescribedArrays,
    RunArrays,
    StepArrays,
)
from sparsemor.reducers.step.compiled.reduced_equations import LEFT, reference_sizes
from sparsemor.reducers.step.convergence_test import LEAST, TRUSTED, estimated_error
from sparsemor.reducers.step.newton_loop import SLOW


def solve_prescribed(
    m: ModelArrays, bodies: tuple[PrescribedArrays, ...], run: RunArrays, w: StepArrays,
    timed: FloatArray, forces: FloatArray
) -> int:
    """Solves the mechanical equations of all bodies and adds their increments to w.d; returns the
    largest number of iterations, or LEFT. timed (q,): functions of time in this step; forces (n,):
    loads by temperatures."""
    most = 1
    w.size[:], run.remaining[0] = 0.0, 0.0
    reference_sizes(m, w, run)
    for b in bodies:
        count = solve_body(m, b, run, timed, forces[b.u : b.u + b.k], w)
        if count == LEFT:
            return LEFT
        most = max(most, count)
    return most


def solve_body(
    m: ModelArrays, b: PrescribedArrays, run: RunArrays, timed: FloatArray, forces: FloatArray,
    w: StepArrays
) -> int:
    """Solves for the displacements of one body with these thermal forces (k,); returns the number
    of iterations, or LEFT."""
    k, g, table = b.k, len(b.G), timed[b.table : b.table + b.width]
    x, v, a = w.X[0], w.X[1], w.X[2]
    u, uv, ua = x[b.u : b.u + k], v[b.u : b.u + k], a[b.u : b.u + k]
    image = table[len(table) - k :] + forces + product(b.inertia, ua) + product(b.stiffness, u)
    if len(b.damping):
        image += product(b.damping, uv)
    inputs = np.concatenate((u, x[b.T : b.T + b.kt]))
    rates = np.concatenate((uv, v[b.T : b.T + b.kt]))
    local, bound = len(b.local.terms) > 0, table[len(table) - k - 1]
    if len(b.of_temperature.terms):
        image -= rows_of(b.of_temperature, timed, inputs[k:], rates[k:], rates[k:])
    if bound == 0.0 and not local:  # nothing turns: that is all
        for j in range(k):
            w.d[b.u + j] += image[j]
        return 1
    now, step = np.zeros(k), np.zeros(k)
    last, before = inf, inf
    for iteration in range(1, m.max_iterations + 1):
        for i in range(g):
            kappa, mu = table[i], table[g + i]
            if kappa != 0.0 or mu != 0.0:
                push = kappa * u + mu * uv if iteration == 1 else (kappa + m.c1 * mu) * step
                image -= np.dot(push, b.G[i])
        new = image.copy()
        if local:
            inputs[:k], rates[:k] = u + now, uv + m.c1 * now
            new -= rows_of(b.local, timed, inputs, rates, rates)
        corrected(m, b, table, now, new)
        squared = 0.0
        for j in range(k):
            step[j] = new[j] - now[j]
            squared += step[j] ** 2
        if not squared < inf:
            return LEFT
        change = sqrt(squared) / w.size[b.block]
        error = estimated_error(change, before, max(bound, LEAST) if local else LEAST)
        if bound < TRUSTED and not local:
            error = change * bound / (1.0 - bound)
        if error <= m.remaining:
            for j in range(k):
                w.d[b.u + j] += new[j]
            run.remaining[0] = max(run.remaining[0], error)
            return iteration
        if change > SLOW * last:
            return LEFT
        last, before = change, change
        now[:] = new
    return LEFT


def corrected(
    m: ModelArrays, b: PrescribedArrays, table: FloatArray, now: FloatArray, new: FloatArray
) -> None:
    """Second product in the leading modes, which contract least."""
    r, g = b.leading.shape[1], len(b.G)
    change = new[:r] - now[:r]
    for i in range(g if r else 0):
        weight = table[i] + m.c1 * table[g + i]
        if weight != 0.0:
            new[:r] -= weight * np.dot(b.leading[i * r : (i + 1) * r], change)


def add_forces(
    bodies: tuple[PrescribedArrays, ...], x: FloatArray, forces: FloatArray, first: int, last: int
) -> None:
    """Thermal terms (T, n) of some steps at the unknowns x (T, n), in forces: those of a body start
    at its first displacement."""
    for b in bodies:
        add_products(b.coupling, x[first:last], b.T, forces[first:last], b.u)
