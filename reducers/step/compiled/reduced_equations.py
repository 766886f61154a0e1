"""Mechanical equations of one step and their iteration as functions on arrays (model_arrays.py):
those of reduced_equations.py, prescribed_body.py and newton_loop.py, name by name. A step that
needs a new Jacobian is left to these.

Parts of a model are tuples; `if len(parts) > 0` tells numba at compile time that a model has none.
Loops run over slices: numba looks for negative numbers in an index that does not begin at zero.
"""

from math import inf, sqrt

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.compiled.dense_products import add_operator, add_product
from sparsemor.reducers.step.compiled.local_terms import rows_of
from sparsemor.reducers.step.compiled.model_arrays import (
    EquationArrays,
    ModelArrays,
    OperatorArrays,
    PrescribedArrays,
    RunArrays,
    StackArrays,
    StepArrays,
    TermArrays,
)
from sparsemor.reducers.step.convergence_test import (
    ACCELERATION_ERROR,
    EPS,
    MARGIN,
    NEGLIGIBLE,
    TRUSTED,
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


def begin(
    m: ModelArrays, eq: EquationArrays, w: StepArrays, base: FloatArray, timed: FloatArray
) -> None:
    """The rows without what each iteration adds to them, in w.base: `base` (n,), which depends on
    time and final temperatures, with constant operators of the free motion, and terms that depend
    on temperatures alone. The rows d + base of temperatures, which are known, are zero."""
    for i in range(len(base)):
        w.base[i] = base[i]
    for i in range(m.first[0], m.first[1]):
        w.base[i] = -w.d[i]
    add_operators(eq.constants, w)
    add_terms(eq.known, w, timed, w.base)


def add_operators(constants: tuple[OperatorArrays, ...], w: StepArrays) -> None:
    """Adds constant operators of the free motion to w.base."""
    if len(constants) > 0:
        for c in constants:
            add_operator(c.A, w.free[c.of][c.columns :], w.base[c.rows :])


def add_terms(
    terms: tuple[TermArrays, ...], w: StepArrays, timed: FloatArray, r: FloatArray
) -> None:
    """Adds these terms to r."""
    if len(terms) > 0:
        for t in terms:
            found = rows_of(
                t.local, timed, w.X[0][t.columns], w.X[1][t.columns], w.X[2][t.columns])
            for i in range(len(t.rows)):
                r[t.rows[i]] += found[i]


def add_rotations(
    bodies: tuple[PrescribedArrays, ...], X: FloatArray, timed: FloatArray, r: FloatArray
) -> None:
    """Adds sum_g G_g (kappa_g u + mu_g u') of bodies with prescribed motion to r."""
    if len(bodies) > 0:
        for b in bodies:
            for g in range(len(b.G)):
                kappa, mu = timed[b.table + g], timed[b.table + len(b.G) + g]
                if kappa != 0.0 or mu != 0.0:
                    end = b.at + len(b.inertia)
                    u, v = X[0][b.at : end], X[1][b.at : end]
                    for j in range(len(b.inertia)):
                        b.inertia[j] = kappa * u[j] + mu * v[j]
                    add_product(b.G[g], b.inertia, r[b.at : end])


def add_bodies(
    stacks: tuple[StackArrays, ...], X: FloatArray, timed: FloatArray, r: FloatArray
) -> None:
    """Adds the rows of frames, and their forces on displacements, to r."""
    if len(stacks) > 0:
        for b in stacks:
            add_stack(b, X, timed, r)


def add_stack(b: StackArrays, X: FloatArray, timed: FloatArray, r: FloatArray) -> None:
    """Adds the rows of the frames of a stack at the unknowns with their rates X (3, n), and sum_g
    G_g (kappa_g u + mu_g u') + E sigma in the rows of its displacements, to r."""
    y, s, products, size, last = b.y, b.s, b.products, b.P.shape[1], len(b.H)
    for i in range(len(b.bodies)):
        n, at, k, g, guide, rigid, first, end = b.bodies[i]
        y[:] = 0.0
        for j in range(last):
            y[0, j] = b.origin[i, j]
        for j in range(first, end):
            row, column, value = b.rows[j], b.columns[j], b.values[j]
            for c in range(3):
                y[c, row] += value * X[c, column]
        if guide >= 0:
            for c in range(3):
                for j in range(rigid):
                    y[c, j] += timed[guide + c * rigid + j]
        s[:], products[:] = 0.0, 0.0
        for c in range(3):
            add_product(b.P[i][:k], X[c][at:], s[c])
        add_product(b.Q[i][:k], X[0][at:], products)
        for f in range(g):
            for c in range(3):
                x, product, total = X[c][at : at + k], products[f * size : f * size + k], 0.0
                for j in range(len(x)):
                    total += x[j] * product[j]
                b.forms[c * g + f] = total
        for j in range(n):
            b.gained[j] = 1.0 if b.gains[i, j] < 0 else timed[b.gains[i, j]]
        b.sigma[last], b.H[:] = 0.0, 0.0
        evaluate_frame(
            b.kinds[i][:n], b.numbers[i], b.starts[i], b.gained, y[0], y[1], y[2], 0.0, 0.0,
            s if k else b.nothing, b.forms[: 3 * g], b.sigma, b.tau, b.H,
            b.coefficients[: 2 * g + 1], b.sums)
        for j in range(first, end):
            r[b.columns[j]] += b.values[j] * b.H[b.rows[j], last]
        for f in range(g):
            kappa, mu, product = b.coefficients[f], b.coefficients[g + f], products[f * size :]
            u, v = X[0][at : at + k], X[1][at : at + k]
            for j in range(len(u)):
                product[j] = kappa * u[j] + mu * v[j]
        add_product(b.G[i][: g * size], products, r[at : at + k])
        add_product(b.E[i], b.sigma[last], r[at : at + k])


def evaluate_frame(
    kinds: IntArray, numbers: FloatArray, starts: IntArray, gains: FloatArray, y: FloatArray,
    v: FloatArray, a: FloatArray, c1: float, c2: float, s: FloatArray, forms: FloatArray,
    sigma: FloatArray, tau: FloatArray, border: FloatArray, coefficients: FloatArray,
    sums: FloatArray
) -> None:
    """Function of the frames (`FrameArrays`), with which the steps are compiled."""


def residual(
    m: ModelArrays, eq: EquationArrays, w: StepArrays, timed: FloatArray
) -> None:
    """Residual at the departure w.d, in w.r: base + d + rotations, frames and terms."""
    motion(m, w)
    for i in range(len(w.r)):
        w.r[i] = w.base[i]
    for i in eq.identity:
        w.r[i] += w.d[i]
    add_rotations(eq.prescribed, w.X, timed, w.r)
    add_bodies(eq.stacks, w.X, timed, w.r)
    add_terms(eq.iterated, w, timed, w.r)


def solve(
    m: ModelArrays, eq: EquationArrays, w: StepArrays, run: RunArrays, base: FloatArray,
    timed: FloatArray, bound: float
) -> int:
    """Solves for the departure w.d with the kept Jacobian; returns the number of iterations, or
    LEFT. bound: proved contraction (`StepEquations.contraction`). Of blocks: w.relative, w.before:
    this change and the one before, relative to w.size; w.absolute, w.earlier: the same in units of
    the unknowns. run.effort: least number of iterations with this Jacobian, iterations beyond it, 1
    if a new one is due."""
    begin(m, eq, w, base, timed)
    turns(m, w, run)
    least, last, stall = inf, inf, 0
    w.size[:], w.before[:], w.earlier[:] = 0.0, inf, inf
    reference_sizes(m, w, run)
    run.effort[2] = 1  # unless the step ends
    for iteration in range(1, m.max_iterations + 1):
        residual(m, eq, w, timed)
        if not solution(m, eq, w, run) < inf:
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
        if bound < TRUSTED:
            remaining = min(remaining, proved_error(m, w, bound))
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


def solution(
    m: ModelArrays, eq: EquationArrays, w: StepArrays, run: RunArrays
) -> float:
    """Change L J^-1 L^T w.r, in w.dx, which is subtracted from w.d; J is the identity but for the
    unknowns `solved`. Returns the sum of its magnitudes."""
    turned(m, w, w.r, True)
    for i in range(len(w.r)):
        w.dx[i] = w.r[i]
    for i in range(len(eq.solved)):
        w.own[i] = w.r[eq.solved[i]]
    for i in range(len(eq.solved)):
        first, last, total = run.spans[i, 0], run.spans[i, 1], 0.0
        row, own = run.inverse[i][first:last], w.own[first:last]
        for j in range(len(row)):
            total += row[j] * own[j]
        w.dx[eq.solved[i]] = total
    turned(m, w, w.dx, False)
    size = 0.0
    for i in range(len(w.dx)):
        w.d[i] -= w.dx[i]
        size += abs(w.dx[i])
    return size


def proved_error(m: ModelArrays, w: StepArrays, bound: float) -> float:
    """Bound |change| q / (1 - q) of the error after a change, relative to the size of each block,
    for a proved contraction q."""
    largest = 0.0
    for k in range(len(m.judged)):
        squared = 0.0
        for i in range(m.starts[k], m.starts[k + 1]):
            squared += w.dx[i] ** 2
        largest = max(largest, sqrt(squared) / w.size[k])
    return bound / (1.0 - bound) * largest


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
