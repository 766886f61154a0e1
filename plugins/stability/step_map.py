"""Time-step map of a step solver with its integrator, linearised by finite differences.

A step takes z = (x, v, a, integrator memory) to the next z in three stages: `formula` gives w =
(r1, r2), `solve` gives the new x, `advance` gives the new z. Formula and advance are affine in z
and in x, so unit differences of them are exact: dw = R dz, dz' = P dz + Q dx'. Only the solver's
response dx' = S dw is nonlinear; it is differenced, column by column, in the reduced unknowns. The
map is P + Q S R. It needs `solve` only, and so exists for every reducer and integrator, third-party
ones included. Solvers that have an exact response return it: it costs one
factorization instead of a solve for each unknown, and penetrations of 1e-7 m in contact are too
small for differences. Multipliers carry no state.

Perturbation sizes belong to the kinds of fields: the eigenvalue 1 of rigid
unknowns is nearly defective, so their columns need an error below 1e-10: four points. All other
unknowns enter almost linearly, and one-sided differences suffice; smaller perturbations would show
the solver's stopping error (1e-13). Formula and advance are not affine in unit quaternions
(core/protocols/poses.py), whose columns are central differences of them, too.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from sparsemor.core import Integrator, State, StepFormula, StepMemory, StepOutcome, StepSolver
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.status import SolveFailed, Status

QUATERNION_CHANGE = 3e-4
"""Size of the changes of a unit quaternion for differences."""


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """Affine map of the integrator: dw = R dz, dz' = P dz + Q dx', w = [r1; r2].

    R (2 n, N), P (N, N), Q (N, n), with n unknowns and N entries of z.
    """

    R: FloatArray
    P: FloatArray
    Q: FloatArray

    @classmethod
    def from_step(
        cls, integrator: Integrator, layout: Layout, state: State, h: float, solution: FloatArray
    ) -> "Affine":
        """Map from unit changes of each entry of z = [x; v; a; memory] and of x, which are exact,
        and from small ones of quaternions about the state and the solution (n,) of its step; h:
        step size, s. w = [r1; r2] are the history terms of v = c1 x + r1, a = c2 x + r2."""
        n, z, rules = layout.size, packed(state), integrator.rules(h)
        base = step_formula(rules, layout, state, h)

        def next_state(state: State, formula: StepFormula, x: FloatArray) -> FloatArray:
            outcome = StepOutcome(x, Status.DONE, 1)
            return packed(advanced(rules, layout, state, formula, outcome))

        after = next_state(state, base, state.x)
        R, P, Q = np.zeros((2 * n, len(z))), np.zeros((len(z), len(z))), np.zeros((len(z), n))
        for i in range(len(z)):
            moved = unpacked(z + _unit(len(z), i), state)
            f = step_formula(rules, layout, moved, h)
            R[:n, i], R[n:, i] = f.r1 - base.r1, f.r2 - base.r2
            P[:, i] = next_state(moved, f, state.x) - after
        for i in range(n):
            x = state.x + _unit(n, i)
            Q[:, i] = next_state(state, base, x) - after

        def changed(i: int, by: float) -> FloatArray:
            """r1, r2 and the next z where entry i of z changes by `by`."""
            moved = unpacked(z + by * _unit(len(z), i), state)
            f = step_formula(rules, layout, moved, h)
            return np.concatenate([f.r1, f.r2, next_state(moved, f, solution)])

        def solved(i: int, by: float) -> FloatArray:
            return next_state(state, base, solution + by * _unit(n, i))

        # for each column of z (x, v, a, memory): the change that moves a quaternion in the step by
        # at most QUATERNION_CHANGE; rows of `old`: factors of these columns in x, v of free motion
        old, (c1, c2, _) = np.abs(rules.second.old), rules.factors
        sizes = QUATERNION_CHANGE / np.maximum(np.maximum(old[0], old[1] / c1), 1.0 / c2)
        for i in (start + k for start in layout.quaternions for k in range(4)):
            for j, size in enumerate(sizes.tolist()):
                column = _central(partial(changed, i + j * n), size)
                R[:, i + j * n], P[:, i + j * n] = column[: 2 * n], column[2 * n :]
            Q[:, i] = _central(partial(solved, i), QUATERNION_CHANGE)
        return cls(R, P, Q)


@dataclass(frozen=True, slots=True, eq=False)
class StepMap:
    """Linearised time step dz' = matrix dz, z = [x; v; a; integrator memory] of the active
    unknowns.

    solver: step solver that was linearised; supports: active atoms of the blocks that select them;
    layout: the n active unknowns; matrix (N, N); response (n, 2 n): dx' from changes [dr1; dr2] of
    the step formula; formula: that of the linearised step; integrator: its parts R, P, Q of
    [dr1; dr2] = R dz, dz' = P dz + Q dx'; scale (n,): size of each unknown.
    """

    solver: StepSolver
    supports: Mapping[str, BoolArray]
    layout: Layout
    matrix: FloatArray
    response: FloatArray
    formula: StepFormula
    integrator: Affine
    scale: FloatArray

    def components(self, name: str) -> IntArray:
        """Positions in z of one block's x, v, a and integrator memory."""
        n = self.layout.size
        at = np.arange(n)[self.layout[name]]
        return np.concatenate([at + j * n for j in range(len(self.matrix) // n)])

    def own(self, name: str) -> FloatArray:
        """Diagonal submatrix of one block: the others start unperturbed, but respond within the
        step."""
        here = self.components(name)
        return np.asarray(self.matrix[np.ix_(here, here)])

    def alone(self, name: str, response: FloatArray) -> FloatArray:
        """Time-step map of one block without the others, whose response to its own [dr1; dr2] is
        `response` (k, 2 k)."""
        n, here, part = self.layout.size, self.components(name), self.integrator
        at = np.arange(n)[self.layout[name]]
        R = part.R[np.ix_(np.concatenate([at, n + at]), here)]
        return np.asarray(part.P[np.ix_(here, here)] + part.Q[np.ix_(here, at)] @ response @ R)

    def block_response(self, name: str) -> FloatArray:
        """Response (k, 2 k) of a block to its own changes: dx' from dr1 and dr2."""
        n, at = self.layout.size, np.arange(self.layout.size)[self.layout[name]]
        return np.asarray(self.response[np.ix_(at, np.concatenate([at, n + at]))])


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def step_map(
    solver: StepSolver, integrator: Integrator, h: float, state: State, memory: StepMemory
) -> StepMap:
    """Time step from `state` (unknowns of the solver, integrator memory set), linearised; h: size,
    s.

    Each solve gets a copy of `memory`. A solver that selects atoms is linearised on the support
    that it selects in this step (`frozen`); inactive coefficients carry no
    state. Raises SolveFailed when the step fails, or every step from states near it.
    """
    formula = step_formula(integrator.rules(h), solver.layout, state, h)
    x, memory = _solve(solver, formula, memory.copy())
    solver, memory = solver.frozen(memory)
    supports = {name: kept.copy() for name, kept in solver.supports(memory).items()}
    active = active_unknowns(solver.layout, supports)
    small = solver.layout.resized(
        {b.name: int(active[solver.layout[b.name]].sum()) for b in solver.layout})
    scale = _sizes(solver.layout, x)
    S = _exact(solver, formula, x)
    if S is None:  # by differences
        S = _response_by_some_change(solver, formula, memory, np.flatnonzero(active), scale)
    inner = State(state.t, state.x[active], state.v[active], state.a[active],
                  state.memory[active])
    part = Affine.from_step(integrator, small, inner, h, x[active])
    matrix = part.P + part.Q @ (S @ part.R)
    if not np.isfinite(matrix).all():
        raise SolveFailed(Status.NOT_FINITE, formula.t)
    return StepMap(solver, supports, small, matrix, S, formula, part, scale[active])


def _exact(
    solver: StepSolver, formula: StepFormula, x: FloatArray
) -> FloatArray | None:
    try:
        return solver.response(formula, x)
    except RuntimeError:
        raise SolveFailed(Status.SINGULAR, formula.t) from None


def _response_by_some_change(
    solver: StepSolver, formula: StepFormula, kept: StepMemory, active: IntArray, scale: FloatArray
) -> FloatArray:
    """Response (n, 2 n) by the usual perturbations, or by smaller ones if a solve near the step
    fails; arguments as of `_response`.

    If the sampled rows do not contain those of a joint, a perturbed frame leads to very large
    coefficients, for which the solver reports a failure or does not converge.
    """
    for shrink in (1.0, 1e-2, 1e-4):
        try:
            return _response(solver, formula, kept, active, shrink * scale)
        except SolveFailed as failure:
            last = failure
    raise last


def active_unknowns(layout: Layout, supports: Mapping[str, BoolArray]) -> BoolArray:
    """Mask (n,): True for every unknown except coefficients of inactive atoms."""
    active = np.ones(layout.size, dtype=np.bool_)
    for name, support in supports.items():
        active[layout[name]] = support
    return active


def packed(state: State) -> FloatArray:
    """Vector z of a state: x, v, a and the columns of the integrator's memory, one after the
    other."""
    return np.concatenate([state.x, state.v, state.a, state.memory.T.ravel()])


def unpacked(z: FloatArray, like: State) -> State:
    """State with the entries of z; like: a state of the same time and sizes."""
    x, v, a, *memory = z.reshape(-1, like.x.size)
    columns = np.stack(memory, axis=1) if memory else np.zeros((like.x.size, 0))
    return State(like.t, x, v, a, columns)


def _response(
    solver: StepSolver, formula: StepFormula, kept: StepMemory, active: IntArray, scale: FloatArray
) -> FloatArray:
    """Response (n, 2 n) by differences: dx' of the n active unknowns from changes of r1 (columns 0
    to n - 1) and r2 (the others) of each of them. kept: memory of the solver before the step;
    active: numbers of the active unknowns; scale: size of every unknown of the solver."""
    layout, n = solver.layout, len(active)
    kind_of = [b.kind for b in layout for _ in range(b.size)]
    S = np.zeros((n, 2 * n))
    base, _ = _solve(solver, formula, kept.copy())

    def moved(which: str, i: int, by: float) -> FloatArray:
        r1, r2 = formula.r1, formula.r2
        (r1 if which == "r1" else r2)[i] += by
        return _solve(solver, formula.with_history(r1, r2), kept.copy())[0]

    for j, i in enumerate(active.tolist()):
        # the layout is in the order second-order, first-order, algebraic unknowns
        if i >= layout.algebraic.start:
            continue
        first = i >= layout.second.stop
        kinds = [("r1", formula.c1_first)] if first else [("r1", formula.c1), ("r2", formula.c2)]
        for shift, (which, c) in enumerate(kinds):
            d = kind_of[i].change * scale[i] * c  # r1 + d is as if x were larger by d / c
            if kind_of[i].central:
                near, far = (moved(which, i, k * d) - moved(which, i, -k * d) for k in (1.0, 2.0))
                column = (8.0 * near - far) / (12.0 * d)
            else:
                column = (moved(which, i, d) - base) / d
            S[:, j + shift * n] = column[active]
    return S


def _solve(
    solver: StepSolver, formula: StepFormula, memory: StepMemory
) -> tuple[FloatArray, StepMemory]:
    outcome, memory = solver.solve(formula, memory)
    if not outcome.status.ok:
        raise SolveFailed(outcome.status, formula.t, outcome.block, outcome.detail)
    return outcome.x, memory


def _sizes(layout: Layout, x: FloatArray) -> FloatArray:
    """Size (n,) of each unknown: largest absolute value in its block, at least `smallest` of its
    kind. Of a pose `smallest`: its change by a step depends neither on the distance from the origin
    nor on the number of turns."""
    sizes = np.ones(layout.size)
    for b in layout:
        top = 0.0 if b.kind.quantity is Quantity.POSE else float(np.abs(x[layout[b.name]]).max())
        sizes[layout[b.name]] = max(top, b.kind.smallest)
    return sizes


def _central(of: Callable[[float], FloatArray], size: float) -> FloatArray:
    """Derivative at 0 by central differences of fourth order."""
    near, far = (of(k * size) - of(-k * size) for k in (1.0, 2.0))
    return np.asarray((8.0 * near - far) / (12.0 * size))


def _unit(n: int, i: int) -> FloatArray:
    e = np.zeros(n)
    e[i] = 1.0
    return e
