"""Mechanical equations of one step and their iteration as functions on arrays (model_arrays.py):
those of reduced_equations.py and newton_loop.py, name by name. A step that needs a new Jacobian is
left to these."""

from math import inf

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.compiled.dense_products import add_product
from sparsemor.reducers.step.compiled.local_terms import rows_of
from sparsemor.reducers.step.compiled.model_arrays import (
    BodyArrays,
    BodyWork,
    ModelArrays,
    RunArrays,
    StepArrays,
    TermArrays,
)
from sparsemor.reducers.step.convergence_test import (
    ACCELERATION_ERROR,
    EPS,
    MARGIN,
    NEGLIGIBLE,
    estimated_error,
)
from sparsemor.reducers.step.newton_loop import PATIENCE, SLOW

LEFT = -1
"""Instead of a number of iterations: the step is left to the uncompiled solver."""


def motion(m: ModelArrays, w: StepArrays) -> None:
    """Unknowns with their rates at the departure w.d, in w.X."""
    for r in range(3):
        X, free, new = w.X[r], w.free[r], m.new[r]
        for i in range(len(w.d)):
            X[i] = free[i] + new[i] * w.d[i]


def begin(m: ModelArrays, terms: tuple[TermArrays, ...], w: StepArrays, timed: FloatArray) -> None:
    """Adds to w.base what the free motion and the final temperatures contribute."""
    first = m.atoms[0]
    for of in range(3):
        x = w.X[0][first:] if of == 2 else w.free[of][first:]
        for i in range(m.of_motion.shape[1]):
            row, total = m.of_motion[of, i], 0.0
            for j in range(m.ends[of, i, 0], m.ends[of, i, 1]):
                total += row[j] * x[j]
            w.base[first + i] += total
    add_terms(terms, w, timed, True, w.base)


def add_terms(
    terms: tuple[TermArrays, ...], w: StepArrays, timed: FloatArray, known: bool, r: FloatArray
) -> None:
    """Adds to r the terms that depend on temperatures alone (`known`), or the others."""
    for t in terms:
        if t.known == known:
            found = rows_of(
                t.local, timed, w.X[0][t.columns], w.X[1][t.columns], w.X[2][t.columns])
            for i in range(len(t.rows)):
                r[t.rows[i]] += found[i]


def evaluate(
    b: BodyArrays, own: BodyWork, X: FloatArray, timed: FloatArray
) -> None:
    """Evaluates the frames of all bodies at the unknowns with their rates X (3, n), into `own`
    (arrays of `FrameWork`). Of body i: e first of k displacements u, g inertia matrices, n
    contributions; y (3, b): border unknowns with their rates; s (3, p) = P^T (u, u', u''); forms
    (3 g,) = u.Q_g u of all g, then with u', then with u''."""
    for i in range(len(b.k)):
        e, k, g, p, n = b.e[i], b.k[i], b.g[i], b.P.shape[2], b.items[i]
        y, s, back, forms = own.y[i], own.s[i], own.back[i], own.forms[i]
        y[:] = 0.0
        for j in range(y.shape[1]):
            y[0, j] = b.origin[i, j]
        for j in range(b.entries[i]):
            row, column, value = b.rows[i, j], b.columns[i, j], b.values[i, j]
            for r in range(3):
                y[r, row] += value * X[r, column]
        if b.guide[i] >= 0:
            for r in range(3):
                for j in range(b.rigid[i]):
                    y[r, j] += timed[b.guide[i] + r * b.rigid[i] + j]
        for r in range(3):
            row = s[r]
            row[:] = 0.0
            for j in range(k):
                P, u = b.P[i, j], X[r, e + j]
                for o in range(p):
                    row[o] += u * P[o]
        back[:] = 0.0
        add_product(b.Q[i], X[0][e:], back, k, g * k)
        for f in range(g):
            for r in range(3):
                u, total = X[r][e : e + k], 0.0
                for j in range(k):
                    total += u[j] * back[f * k + j]
                forms[r * g + f] = total
        for j in range(n):
            own.gains[i, j] = 1.0 if b.gains[i, j] < 0 else timed[b.gains[i, j]]
        evaluate_frame(
            b.kinds[i][:n], b.numbers[i], b.starts[i], own.gains[i], y[0], y[1], y[2], 0.0, 0.0,
            s if k else own.nothing, forms[: 3 * g], own.sigma[i], own.tau[i], own.H[i],
            own.coefficients[i, : 2 * g + 1], own.sums)


def evaluate_frame(
    kinds: IntArray, numbers: FloatArray, starts: IntArray, gains: FloatArray, y: FloatArray,
    v: FloatArray, a: FloatArray, c1: float, c2: float, s: FloatArray, forms: FloatArray,
    sigma: FloatArray, tau: FloatArray, border: FloatArray, coefficients: FloatArray,
    sums: FloatArray
) -> None:
    """Function of the frames (`FrameArrays`), with which the steps are compiled."""


def residual(
    m: ModelArrays, b: BodyArrays, terms: tuple[TermArrays, ...], w: StepArrays, own: BodyWork,
    timed: FloatArray
) -> None:
    """Residual at the departure w.d, in w.r."""
    motion(m, w)
    evaluate(b, own, w.X, timed)
    add_bodies(m, b, w, own)
    add_terms(terms, w, timed, False, w.r)


def add_bodies(m: ModelArrays, b: BodyArrays, w: StepArrays, own: BodyWork) -> None:
    """Rows of all bodies after `evaluate`, in w.r: base + d, rows of the frames, and their forces
    on the displacements (e first of k displacements of a body, g inertia matrices G_g)."""
    for i in range(len(w.r)):
        w.r[i] = w.base[i]
    for i in range(m.atoms[0], m.atoms[1]):
        w.r[i] += w.d[i]
    last = own.H.shape[1]
    for i in range(len(b.k)):
        e, k, g = b.e[i], b.k[i], b.g[i]
        # rows of the frame, in the last column of H, to those of rigid coordinates and joint forces
        for j in range(b.entries[i]):
            w.r[b.columns[i, j]] += b.values[i, j] * own.H[i, b.rows[i, j], last]
        # sum_g G_g (kappa_g u + mu_g u') + E sigma to the rows of displacements
        r, turned = w.r[e : e + k], own.turned[i]
        for f in range(g):
            kappa, mu = own.coefficients[i, f], own.coefficients[i, g + f]
            for j in range(k):
                turned[f * k + j] = kappa * w.X[0, e + j] + mu * w.X[1, e + j]
        add_product(b.G[i], turned, r, g * k, k)
        for o in range(b.E.shape[1]):
            sigma, E = own.sigma[i, last, o], b.E[i, o]
            for j in range(k):
                r[j] += sigma * E[j]


def solve(
    m: ModelArrays, b: BodyArrays, terms: tuple[TermArrays, ...], w: StepArrays, own: BodyWork,
    run: RunArrays, timed: FloatArray
) -> int:
    """Solves for the departure w.d with the kept Jacobian; returns the number of iterations, or
    LEFT. Of blocks: w.relative, w.before: this change and the one before, relative to w.size;
    w.absolute, w.earlier: the same in units of the unknowns. run.effort: least number of iterations
    with this Jacobian, iterations beyond it, 1 if a new one is due."""
    begin(m, terms, w, timed)
    turns(m, w, run)
    least, last, stall = inf, inf, 0
    w.size[:], w.before[:], w.earlier[:] = 0.0, inf, inf
    reference_sizes(m, w, run)
    run.effort[2] = 1  # unless the step ends
    for iteration in range(1, m.max_iterations + 1):
        residual(m, b, terms, w, own, timed)
        if not solution(m, w, run) < inf:
            return LEFT
        if relative_changes(m, w, run) > 1.0:  # first motion of a block that was zero so far
            motion(m, w)
            reference_sizes(m, w, run)
            relative_changes(m, w, run)
        change, remaining, rounded = 0.0, 0.0, True
        for k in range(len(m.judged)):
            error, noise = estimated_error(w.relative[k], w.before[k]), MARGIN * run.noise[k]
            if error <= NEGLIGIBLE * run.noise[k] / w.size[k]:
                error = 0.0
            small = w.absolute[k] <= noise and w.earlier[k] <= noise
            rounded = rounded and (error <= m.remaining or small)
            change, remaining = max(change, w.relative[k]), max(remaining, error)
            w.before[k], w.earlier[k] = w.relative[k], w.absolute[k]
        if remaining <= m.remaining or (rounded and change >= SLOW * last):
            run.remaining[0] = remaining
            run.effort[0] = min(run.effort[0], iteration)
            run.effort[1] += iteration - run.effort[0]
            run.effort[2] = 0
            return iteration
        # a change may be larger than the one before: errors of positions reach joint forces one
        # iteration later
        stall = 0 if change < 0.5 * least else stall + 1
        least, last = min(least, change), change
        if stall > PATIENCE:
            return LEFT
    return LEFT


def turns(m: ModelArrays, w: StepArrays, run: RunArrays) -> None:
    """Matrices w.L by which attitudes have turned since the kept Jacobian."""
    for k in range(len(m.quaternions)):
        for i in range(4):
            for j in range(4):
                w.L[k, i, j] = 0.0
                for c in range(4):
                    p = w.free[0, m.quaternions[k] + c] + w.d[m.quaternions[k] + c]
                    w.L[k, i, j] += p * run.attitudes[k, c, i, j]


def turned(m: ModelArrays, w: StepArrays, x: FloatArray, back: bool) -> None:
    """The quaternions of x (n,) become L x, or L^T x to turn them `back`."""
    for k in range(len(m.quaternions)):
        q, L = x[m.quaternions[k] : m.quaternions[k] + 4], w.L[k]
        before = q[0], q[1], q[2], q[3]
        for i in range(4):
            q[i] = 0.0
            for j in range(4):
                q[i] += (L[j, i] if back else L[i, j]) * before[j]


def solution(m: ModelArrays, w: StepArrays, run: RunArrays) -> float:
    """Change L J^-1 L^T w.r of the unknowns `solved`, in w.dx, which is subtracted from w.d;
    returns the sum of its magnitudes."""
    size = 0.0
    turned(m, w, w.r, True)
    for i in range(len(m.solved)):
        w.own[i] = w.r[m.solved[i]]
    for i in range(len(m.solved)):
        row, total = run.inverse[i], 0.0
        for j in range(len(row)):
            total += row[j] * w.own[j]
        w.dx[m.solved[i]] = total
    turned(m, w, w.dx, False)
    for i in range(len(w.dx)):
        w.d[i] -= w.dx[i]
        size += abs(w.dx[i])
    return size


def relative_changes(m: ModelArrays, w: StepArrays, run: RunArrays) -> float:
    """Size of the change w.dx, in w.absolute, and relative to that of each block, in w.relative;
    returns the largest of these."""
    change = 0.0
    for k in range(len(m.judged)):
        absolute = 0.0
        for i in range(m.starts[k], m.starts[k + 1]):
            absolute = max(absolute, abs(w.dx[i]))
        w.absolute[k] = absolute
        w.relative[k] = 0.0 if absolute <= NEGLIGIBLE * run.noise[k] else absolute / w.size[k]
        change = max(change, w.relative[k])
    return change


def reference_sizes(m: ModelArrays, w: StepArrays, run: RunArrays) -> None:
    """Magnitudes w.size (blocks,) to which changes are relative; zero in a new step, otherwise
    those of blocks that were zero so far grow with the present unknowns w.X. run.top, run.rate:
    largest value of each block so far, and of its highest rates; infinite sizes: multipliers, which
    need not converge."""
    for k in range(len(m.judged)):
        top, rate = run.top[k], run.rate[k]
        if w.size[k] > 0.0 and top == 0.0:
            for i in range(m.starts[k], m.starts[k + 1]):
                top, rate = max(top, abs(w.X[0, i])), max(rate, abs(w.d[i]) * m.c2)
        size = top
        if m.second[k]:
            size = min(top, max(ACCELERATION_ERROR * rate / m.c2, 4 * EPS / m.remaining * top))
        w.size[k] = max(w.size[k], size, 1e-300) if m.judged[k] else inf


def remember(m: ModelArrays, w: StepArrays, run: RunArrays) -> None:
    """Takes the magnitudes of an accepted step into account."""
    for k in range(len(m.judged)):
        top, departure = 0.0, 0.0
        for i in range(m.starts[k], m.starts[k + 1]):
            top, departure = max(top, abs(w.X[0, i])), max(departure, abs(w.d[i]))
        run.top[k] = max(run.top[k], top)
        run.rate[k] = max(run.rate[k], departure * m.c2)
