"""Mechanical equations of one step as functions on arrays (arrays.py): those of
elastic_block.py, with the acceptance of acceptance.py. Each function goes through all
bodies."""

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.acceptance import estimated_error, reference
from sparsemor.reducers.step.compiled.arrays import (
    BodyArrays,
    BodyTerms,
    MechanicsWork,
    ModelArrays,
    RunArrays,
)
from sparsemor.reducers.step.compiled.dense import add_product, add_rates, norm, solve_in_place
from sparsemor.reducers.step.compiled.local import local_rows, rows_of, variables

SLOW = 0.2
"""Ratio of consecutive changes above which a step is left to the uncompiled solver."""
LEFT = -1
"""Instead of a number of iterations: the step is left to the uncompiled solver."""


def begin(
    m: ModelArrays, b: BodyArrays, w: MechanicsWork, timed: FloatArray, x: FloatArray,
    v: FloatArray, a: FloatArray, d: FloatArray, free: FloatArray, rate: FloatArray
) -> None:
    """Constants of the displacements in a step, from the prediction (elastic_block.py). M_g times
    accelerations is needed by the forms only, not times D^-1."""
    w.d[:] = 0.0
    w.change[:] = 0.0
    w.past[:] = 0.0
    for i in range(len(b.k)):
        k, s, kt, u, inputs = b.k[i], b.s[i], b.kt[i], b.u[i], w.inputs[i]
        size, turned = s + b.p[i], b.g[i] * (s + b.p[i])
        v_at = 2 * k + kt + b.j[i]
        for j in range(k - s):
            o = b.idle[i, j]
            d[o] = -free[o]
            x[o], v[o], a[o] = 0.0, rate[o] + m.c1 * d[o], m.c2 * d[o]
        for j in range(k):
            inputs[j], inputs[k + j], inputs[v_at + j] = x[u + j], a[u + j], v[u + j]
        for j in range(kt):
            inputs[2 * k + j] = x[b.T[i] + j]
        for j in range(b.j[i]):
            inputs[2 * k + kt + j] = timed[b.amplitude[i] + j]
        for j in range(size):
            w.h[i, j] = b.base[i, j]
            if b.table[i] >= 0:
                w.h[i, j] -= timed[b.table[i] + j]
        add_product(b.H[i], inputs, w.h[i], b.inputs[i], size)
        add_rates(b.products[i], inputs, inputs[v_at:], inputs[k:], w.past[i], k, turned,
                  b.g[i] * s + b.p[i])
        for j in range(s):
            w.u[i, j] = x[b.active[i, j]]


def begin_local(
    m: ModelArrays, b: BodyArrays, w: MechanicsWork, t: BodyTerms, timed: FloatArray,
    x: FloatArray, v: FloatArray
) -> None:
    """Local terms at the prediction: those that depend on temperatures alone are final."""
    i = t.number
    u, k, T, kt, s = b.u[i], b.k[i], b.T[i], b.kt[i], b.s[i]
    if len(t.still.terms):
        w.h[i, : s + b.p[i]] += rows_of(t.still, timed, x[T : T + kt], v[T : T + kt])
    if len(t.local.terms):
        inputs = np.concatenate((x[u : u + k], x[T : T + kt]))
        rates = np.concatenate((v[u : u + k], v[T : T + kt]))
        variables(t.local, timed, inputs, rates, t.values, t.rates)


def add_local(
    m: ModelArrays, b: BodyArrays, w: MechanicsWork, t: BodyTerms, timed: FloatArray
) -> None:
    """Adds the local terms that depend on displacements to z."""
    i = t.number
    if len(t.local.terms):
        s = b.s[i]
        w.z[i, : s + b.p[i]] += local_rows(
            t.local, timed, t.values, t.rates, t.rates, m.c1, 0.0, w.d[i, :s])


def functionals(m: ModelArrays, b: BodyArrays, w: MechanicsWork, iteration: int) -> None:
    """Products of the displacements with P and M_g at the increments w.d, which are 0 in the first
    iteration."""
    for i in range(len(b.k)):
        g, s, p = b.g[i], b.s[i], b.p[i]
        P = g * (2 * s + p)
        if iteration > 1:
            for j in range(P + p):
                w.change[i, j] = 0.0
            add_product(b.step_products[i], w.d[i], w.change[i], s, P + p)
        for j in range(p):
            w.s[i, 0, j] = w.past[i, 0, P + j] + w.change[i, P + j]
            w.s[i, 1, j] = w.past[i, 1, P + j] + m.c1 * w.change[i, P + j]
            w.s[i, 2, j] = w.past[i, 2, P + j] + m.c2 * w.change[i, P + j]
        for f in range(g):
            at, x, v, a, d = g * (s + p) + f * s, 0.0, 0.0, 0.0, 0.0
            for j in range(s):
                u = w.u[i, j] + w.d[i, j]
                x += w.past[i, 0, at + j] * u
                v += w.past[i, 1, at + j] * u
                a += w.past[i, 2, at + j] * u
                d += w.change[i, at + j] * u
            w.forms[i, f] = x + d
            w.forms[i, g + f] = v + m.c1 * d
            w.forms[i, 2 * g + f] = a + m.c2 * d


def combine(m: ModelArrays, b: BodyArrays, w: MechanicsWork) -> None:
    """z = D^-1 (h + sum_g kappa_g M_g u + mu_g M_g u') and P^T z, after `functionals`."""
    for i in range(len(b.k)):
        g, size = b.g[i], b.s[i] + b.p[i]
        for j in range(size):
            w.z[i, j] = w.h[i, j]
        for f in range(g):
            kappa, mu, at = w.coefficients[i, f], w.coefficients[i, g + f], f * size
            of_change = kappa + mu * m.c1
            for j in range(size):
                w.z[i, j] += (kappa * w.past[i, 0, at + j] + mu * w.past[i, 1, at + j]
                              + of_change * w.change[i, at + j])


def frames(
    m: ModelArrays, b: BodyArrays, w: MechanicsWork, timed: FloatArray, delta: FloatArray
) -> None:
    """Equations of the frames at the border increments `delta` (N,)."""
    for i in range(len(b.k)):
        for r in range(3):
            for j in range(w.now.shape[2]):
                w.now[i, r, j] = w.pose[i, r, j]
        for j in range(b.entries[i]):
            row, moved = b.rows[i, j], b.values[i, j] * delta[b.columns[i, j]]
            w.now[i, 0, row] += moved
            w.now[i, 1, row] += m.c1 * moved
            w.now[i, 2, row] += m.c2 * moved
        n = b.items[i]
        for j in range(n):
            w.gains[i, j] = 1.0 if b.gains[i, j] < 0 else timed[b.gains[i, j]]
        evaluate_frame(
            b.kinds[i][:n], b.numbers[i], b.starts[i], w.gains[i], w.now[i, 0], w.now[i, 1],
            w.now[i, 2], m.c1, m.c2, w.s[i] if b.k[i] else w.nothing, w.forms[i], w.sigma[i],
            w.tau[i], w.border[i], w.coefficients[i], w.sums)


def evaluate_frame(
    kinds: IntArray, numbers: FloatArray, starts: IntArray, gains: FloatArray, y: FloatArray,
    v: FloatArray, a: FloatArray, c1: float, c2: float, s: FloatArray, forms: FloatArray,
    sigma: FloatArray, tau: FloatArray, border: FloatArray, coefficients: FloatArray,
    sums: FloatArray
) -> None:
    """Function of the frames (`FrameArrays`), with which the steps are compiled."""


def solve_mechanics(
    m: ModelArrays, b: BodyArrays, terms: Sequence[BodyTerms], w: MechanicsWork, run: RunArrays,
    timed: FloatArray, targets: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray,
    d: FloatArray, free: FloatArray, rate: FloatArray
) -> int:
    """Solves the mechanical equations and adds their increments to d; returns
    the number of iterations, or LEFT."""
    nr, count, N, last = m.rigid, len(b.k), len(w.dy), inf
    for i in range(N):
        w.delta[i] = 0.0
        w.predicted[i] = x[i] if i < nr else x[m.algebraic[0] + i - nr]
    size = reference(max(1.0, norm(x, nr)), run.acceleration[0], m.c2, m.remaining)
    begin(m, b, w, timed, x, v, a, d, free, rate)
    for t in terms:
        begin_local(m, b, w, t, timed, x, v)
    pose(b, w, nr, v, a, timed)
    w.before[:] = inf
    for i in range(count):
        w.elastic[i] = run.elastic[i]
        w.scale[i] = magnitude(m, run, w, i)
    for iteration in range(1, m.max_iterations + 1):
        functionals(m, b, w, iteration)
        frames(m, b, w, timed, w.delta)
        combine(m, b, w)
        for t in terms:
            add_local(m, b, w, t, timed)
        w.A[:] = 0.0
        for i in range(N):
            w.dy[i] = -targets[i]
        add_reduced(b, w)
        solve_in_place(w.A, w.dy)
        if not norm(w.dy, N) < inf:
            return LEFT
        for i in range(N):
            w.delta[i] -= w.dy[i]
        w.changes[0] = norm(w.dy, nr) / size
        displaced(m, b, w, run, d)
        change, error = 0.0, 0.0
        for i in range(count + 1):
            if not w.changes[i] < inf:
                return LEFT
            change = max(change, w.changes[i])
            error = max(error, estimated_error(w.changes[i], w.before[i]))
            w.before[i] = w.changes[i]
        if error <= m.remaining:
            for i in range(N):
                d[i if i < nr else m.algebraic[0] + i - nr] += w.delta[i]
            for i in range(count):
                run.elastic[i] = w.elastic[i]
            run.remaining[0] = error
            return iteration
        if change > SLOW * last:
            return LEFT
        last = change
    return LEFT


def pose(
    b: BodyArrays, w: MechanicsWork, nr: int, v: FloatArray, a: FloatArray, timed: FloatArray
) -> None:
    """Border unknowns of the bodies at the prediction, with their rates, and squared distances from
    the origin."""
    w.pose[:] = 0.0
    for i in range(len(b.k)):
        for j in range(w.pose.shape[2]):
            w.pose[i, 0, j] = b.origin[i, j]
        for j in range(b.entries[i]):
            r, c, value = b.rows[i, j], b.columns[i, j], b.values[i, j]
            w.pose[i, 0, r] += value * w.predicted[c]
            if c < nr:
                w.pose[i, 1, r] += value * v[c]
                w.pose[i, 2, r] += value * a[c]
        if b.guide[i] >= 0:
            for r in range(3):
                for j in range(b.rigid[i]):
                    w.pose[i, r, j] += timed[b.guide[i] + r * b.rigid[i] + j]
        w.distance[i] = 0.0
        for j in range(b.positions[i]):
            w.distance[i] += w.pose[i, 0, j] ** 2


def add_reduced(b: BodyArrays, w: MechanicsWork) -> None:
    """Adds the bodies' parts of the Schur complement, border minus tau D^-1 (elastic columns and
    residual), to the matrix A (N, N) and the residual dy (N,) of the border unknowns."""
    n = w.tau.shape[1]
    w.Gs[:] = 0.0
    for i in range(len(b.k)):
        p, s = b.p[i], b.s[i]
        P = b.g[i] * (2 * s + p)
        for c in range(n + 1):
            for o in range(p):
                sigma = w.sigma[i, c, o]
                if sigma != 0.0:
                    for j in range(p):
                        w.Gs[i, j, c] += sigma * b.G[i, o, j]
        for j in range(p):
            w.Gs[i, j, n] += w.change[i, P + j] + w.z[i, s + j]
        for r in range(n):
            for c in range(n + 1):
                w.reduced[i, r, c] = w.border[i, r, c]
            for j in range(p):
                tau = w.tau[i, r, j]
                if tau != 0.0:
                    for c in range(n + 1):
                        w.reduced[i, r, c] -= tau * w.Gs[i, j, c]
        for k in range(b.entries[i]):
            row, column, value = b.rows[i, k], b.columns[i, k], b.values[i, k]
            w.dy[column] += value * w.reduced[i, row, n]
            for j in range(b.entries[i]):
                w.A[column, b.columns[i, j]] += (
                    value * b.values[i, j] * w.reduced[i, row, b.rows[i, j]])


def displaced(
    m: ModelArrays, b: BodyArrays, w: MechanicsWork, run: RunArrays, d: FloatArray
) -> None:
    """New increments of the displacements, also in d, after a change dy of the border unknowns, and
    their relative changes."""
    n = w.tau.shape[1]
    for i in range(len(b.k)):
        w.changes[i + 1] = 0.0
        if not b.k[i]:
            continue
        s, p = b.s[i], b.p[i]
        for j in range(b.entries[i]):
            row, change = b.rows[i, j], b.values[i, j] * w.dy[b.columns[i, j]]
            for o in range(p):
                w.sigma[i, n, o] -= change * w.sigma[i, row, o]
        for o in range(p):
            sigma = w.sigma[i, n, o]
            for j in range(s):
                w.z[i, j] += sigma * b.E[i, o, j]
        moved2, size = 0.0, 0.0
        for j in range(s):
            new = -w.z[i, j]
            moved = new - w.d[i, j]
            moved2 += moved**2
            size += (w.u[i, j] + new) ** 2
            d[b.active[i, j]] += moved
            w.d[i, j] = new
        if size > w.elastic[i]:
            w.elastic[i] = size
            w.scale[i] = magnitude(m, run, w, i)
        if not moved2 <= run.floor[i] * w.distance[i]:
            w.changes[i + 1] = sqrt(moved2) / w.scale[i] if (
                w.scale[i] > 0.0 and moved2 < inf) else inf


def magnitude(m: ModelArrays, run: RunArrays, w: MechanicsWork, i: int) -> float:
    """Reference magnitude of changes of the displacements of body i."""
    return reference(sqrt(w.elastic[i]), sqrt(run.bending[i]), m.c2, m.remaining)
