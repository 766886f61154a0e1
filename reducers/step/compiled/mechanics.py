"""Mechanical equations of one step as functions on arrays (arrays.py): those of
condensed_newton.py and elastic_block.py, with the same acceptance."""

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.acceptance import estimated_error, reference
from sparsemor.reducers.step.compiled.arrays import BodyArrays, BodyWork, ModelArrays, RunArrays
from sparsemor.reducers.step.compiled.local import local_rows, variables
from sparsemor.reducers.step.condensed_newton import SLOW

LEFT = -1
"""Instead of a number of iterations: the step is left to the uncompiled solver."""


def begin(
    m: ModelArrays, b: BodyArrays, w: BodyWork, timed: FloatArray, x: FloatArray, v: FloatArray,
    a: FloatArray, d: FloatArray, free: FloatArray, rate: FloatArray
) -> None:
    """Constants of a body's displacements in a step, from the prediction (elastic_block.py)."""
    for i in b.idle:
        d[i] = -free[i]
        x[i], v[i], a[i] = 0.0, rate[i] + m.c1 * d[i], m.c2 * d[i]
    k, u = b.k, w.inputs
    u[:k] = x[b.u : b.u + k]
    u[k : 2 * k] = v[b.u : b.u + k]
    u[2 * k : 3 * k] = a[b.u : b.u + k]
    u[3 * k :] = x[b.T : b.T + b.kt]
    np.dot(b.H, u, w.h)
    for i in range(len(w.h)):
        w.h[i] += b.base[i]
        for j in range(b.loads.shape[1]):
            w.h[i] += b.loads[i, j] * timed[b.amplitude + j]
        if b.table >= 0:
            w.h[i] -= timed[b.table + i]
    np.dot(u[: 3 * k].reshape(3, k), b.products_t, w.past)
    for j in range(len(b.active)):
        w.u[j] = x[b.active[j]]
    w.d[:] = 0.0
    w.change[:] = 0.0
    if len(b.still.terms) or len(b.local.terms):
        begin_local(m, b, w, timed, x, v)


def begin_local(
    m: ModelArrays, b: BodyArrays, w: BodyWork, timed: FloatArray, x: FloatArray, v: FloatArray
) -> None:
    """Local terms at the prediction: those that depend on temperatures alone are final."""
    inputs = np.concatenate((x[b.u : b.u + b.k], x[b.T : b.T + b.kt]))
    rates = np.concatenate((v[b.u : b.u + b.k], v[b.T : b.T + b.kt]))
    if len(b.still.terms):
        values, by_time = np.empty(len(b.still.offset)), np.empty(len(b.still.offset))
        variables(b.still, timed, inputs, rates, values, by_time)
        w.h[:] += local_rows(b.still, timed, values, by_time, m.c1, w.d)
    if len(b.local.terms):
        variables(b.local, timed, inputs, rates, w.values, w.rates)


def functionals(m: ModelArrays, b: BodyArrays, w: BodyWork, iteration: int) -> None:
    """Products of the displacements with P and M_g at the increment w.d, which is 0 in the first
    iteration."""
    g, s, p = b.g, len(b.active), b.Gt.shape[0]
    forms, P = g * (s + p), g * (2 * s + p)
    if iteration > 1:
        np.dot(b.step_products, w.d, w.change)
    c = (1.0, m.c1, m.c2)
    for r in range(3):
        for i in range(p):
            w.s[r, i] = w.past[r, P + i] + c[r] * w.change[P + i]
    for i in range(g):
        at, x, v, a, d = forms + i * s, 0.0, 0.0, 0.0, 0.0
        for j in range(s):
            u = w.u[j] + w.d[j]
            x += w.past[0, at + j] * u
            v += w.past[1, at + j] * u
            a += w.past[2, at + j] * u
            d += w.change[at + j] * u
        w.forms[i] = x + d
        w.forms[g + i] = v + m.c1 * d
        w.forms[2 * g + i] = a + m.c2 * d


def combine(m: ModelArrays, b: BodyArrays, w: BodyWork) -> None:
    """z = D^-1 (h + sum_g kappa_g M_g u + mu_g M_g u') and P^T z, after `functionals`."""
    g, n = b.g, len(w.h)
    w.z[:] = w.h
    for i in range(g):
        kappa, mu, at = w.coefficients[i], w.coefficients[g + i], i * n
        of_change = kappa + mu * m.c1
        for j in range(n):
            w.z[j] += (kappa * w.past[0, at + j] + mu * w.past[1, at + j]
                       + of_change * w.change[at + j])


def evaluate(
    m: ModelArrays, b: BodyArrays, w: BodyWork, timed: FloatArray, delta: FloatArray,
    iteration: int
) -> None:
    """Equations of the body's frame at the border increments `delta` (N,)."""
    w.now[:] = w.pose
    for i in range(len(b.rows)):
        row, moved = b.rows[i], b.values[i] * delta[b.columns[i]]
        w.now[0, row] += moved
        w.now[1, row] += m.c1 * moved
        w.now[2, row] += m.c2 * moved
    for i in range(len(b.gains)):
        w.gains[i] = 1.0 if b.gains[i] < 0 else timed[b.gains[i]]
    if b.k:
        functionals(m, b, w, iteration)
    evaluate_frame(
        b.kinds, b.numbers, b.starts, w.gains, w.now[0], w.now[1], w.now[2], m.c1, m.c2, w.s,
        w.forms, w.sigma, w.tau, w.border, w.coefficients)
    if b.k:
        combine(m, b, w)
    if len(b.local.terms):
        w.z[:] += local_rows(b.local, timed, w.values, w.rates, m.c1, w.d)


def evaluate_frame(
    kinds: IntArray, numbers: FloatArray, starts: IntArray, gains: FloatArray, y: FloatArray,
    v: FloatArray, a: FloatArray, c1: float, c2: float, s: FloatArray, forms: FloatArray,
    sigma: FloatArray, tau: FloatArray, border: FloatArray, coefficients: FloatArray
) -> None:
    """Function of the frames (`FrameArrays`), with which the steps are compiled."""


def solve_mechanics(
    m: ModelArrays, bodies: Sequence[BodyArrays], works: Sequence[BodyWork], run: RunArrays,
    timed: FloatArray, targets: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray,
    d: FloatArray, free: FloatArray, rate: FloatArray
) -> int:
    """Solves the mechanical equations (condensed_newton.py) and adds their increments to d; returns
    the number of iterations, or LEFT."""
    N, nr, count = len(targets), m.rigid, len(bodies)
    elastic = run.elastic.copy()
    scale, distance = np.zeros(count), np.zeros(count)
    predicted, delta = np.zeros(N), np.zeros(N)
    predicted[:nr] = x[:nr]
    predicted[nr:] = x[m.algebraic[0] : m.algebraic[1]]
    size = reference(max(1.0, norm(x[:nr])), run.acceleration[0], m.c2, m.remaining)
    changes, before = np.zeros(count + 1), np.full(count + 1, inf)
    last = inf
    A, dy = np.empty((N, N)), np.empty(N)
    for iteration in range(1, m.max_iterations + 1):
        A[:] = 0.0
        dy[:] = -targets
        for i in range(count):
            b, w = bodies[i], works[i]
            if iteration == 1:
                if b.k:
                    begin(m, b, w, timed, x, v, a, d, free, rate)
                pose(b, w, nr, predicted, v, a, timed)
                scale[i] = magnitude(m, run, elastic, i)
                for j in range(b.positions):
                    distance[i] += w.pose[0, j] ** 2
            evaluate(m, b, w, timed, delta, iteration)
            add_reduced(b, w, A, dy)
        solve_in_place(A, dy)
        if not np.all(np.isfinite(dy)):
            return LEFT
        delta -= dy
        changes[0] = norm(dy[:nr]) / size
        for i in range(count):
            b, w = bodies[i], works[i]
            if b.k:
                changes[i + 1] = displaced(m, b, w, dy, d, run, elastic, scale, i, distance[i])
        change = changes.max()
        if not change < inf:
            return LEFT
        error = 0.0
        for i in range(count + 1):
            error = max(error, estimated_error(changes[i], before[i]))
        if error <= m.remaining:
            d[:nr] += delta[:nr]
            d[m.algebraic[0] : m.algebraic[1]] += delta[nr:]
            run.elastic[:] = elastic
            run.remaining[0] = error
            return iteration
        if change > SLOW * last:
            return LEFT
        before[:] = changes
        last = change
    return LEFT


def pose(
    b: BodyArrays, w: BodyWork, nr: int, predicted: FloatArray, v: FloatArray, a: FloatArray,
    timed: FloatArray
) -> None:
    """Border unknowns of a body at the prediction, with their rates."""
    w.pose[0] = b.origin
    w.pose[1:] = 0.0
    for i in range(len(b.rows)):
        r, c, value = b.rows[i], b.columns[i], b.values[i]
        w.pose[0, r] += value * predicted[c]
        if c < nr:
            w.pose[1, r] += value * v[c]
            w.pose[2, r] += value * a[c]
    if b.guide >= 0:
        for i in range(3):
            for j in range(b.rigid):
                w.pose[i, j] += timed[b.guide + i * b.rigid + j]


def add_reduced(b: BodyArrays, w: BodyWork, A: FloatArray, r: FloatArray) -> None:
    """Adds a body's part of the Schur complement, border minus tau D^-1 (elastic columns and
    residual), to the matrix A (N, N) and the residual r (N,) of the border unknowns."""
    n, p, s = len(b.origin), b.Gt.shape[0], len(b.active)
    reduced, Gs, P = w.border.copy(), np.zeros(p), b.g * (2 * s + p)
    for k in range(n + 1):
        Gs[:] = 0.0
        for o in range(p):
            if w.sigma[k, o] != 0.0:
                for j in range(p):
                    Gs[j] += w.sigma[k, o] * b.Gt[o, j]
        if k == n:
            for j in range(p):
                Gs[j] += w.change[P + j] + w.z[s + j]
        for q in range(n):
            total = 0.0
            for j in range(p):
                total += w.tau[q, j] * Gs[j]
            reduced[q, k] -= total
    for k in range(len(b.rows)):
        row, column, value = b.rows[k], b.columns[k], b.values[k]
        r[column] += value * reduced[row, n]
        for j in range(len(b.rows)):
            A[column, b.columns[j]] += value * b.values[j] * reduced[row, b.rows[j]]


def solve_in_place(A: FloatArray, r: FloatArray) -> None:
    """Solves A x = r by elimination with partial pivoting: r becomes x, nan where A is singular."""
    n = len(r)
    for k in range(n):
        p, most = k, abs(A[k, k])
        for i in range(k + 1, n):
            if abs(A[i, k]) > most:
                p, most = i, abs(A[i, k])
        if not 0.0 < most < inf:
            r[:] = np.nan
            return
        if p != k:
            for j in range(k, n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
            r[k], r[p] = r[p], r[k]
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            if f != 0.0:
                for j in range(k + 1, n):
                    A[i, j] -= f * A[k, j]
                r[i] -= f * r[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            r[k] -= A[k, j] * r[j]
        r[k] /= A[k, k]


def displaced(
    m: ModelArrays, b: BodyArrays, w: BodyWork, dy: FloatArray, d: FloatArray, run: RunArrays,
    elastic: FloatArray, scale: FloatArray, i: int, distance: float
) -> float:
    """New increments of a body's displacements, also in d, after a change dy of the border
    unknowns; returns their relative change."""
    n, s = len(b.origin), len(b.active)
    sigma = w.sigma[n]
    for j in range(len(b.rows)):
        row, moved = b.rows[j], b.values[j] * dy[b.columns[j]]
        for o in range(len(sigma)):
            sigma[o] -= moved * w.sigma[row, o]
    moved2, size = 0.0, 0.0
    for j in range(s):
        new = w.z[j]
        for o in range(len(sigma)):
            new += b.E[j, o] * sigma[o]
        moved = -new - w.d[j]
        moved2 += moved**2
        size += (w.u[j] - new) ** 2
        d[b.active[j]] += moved
        w.d[j] = -new
    if size > elastic[i]:
        elastic[i] = size
        scale[i] = magnitude(m, run, elastic, i)
    if moved2 <= run.floor[i] * distance:
        return 0.0
    return sqrt(moved2) / scale[i] if scale[i] > 0.0 and moved2 < inf else inf


def magnitude(m: ModelArrays, run: RunArrays, elastic: FloatArray, i: int) -> float:
    """Reference magnitude of changes of the displacements of body i."""
    return reference(sqrt(elastic[i]), sqrt(run.bending[i]), m.c2, m.remaining)


def norm(x: FloatArray) -> float:
    """Euclidean norm."""
    total = 0.0
    for i in range(len(x)):
        total += x[i] * x[i]
    return sqrt(total)
