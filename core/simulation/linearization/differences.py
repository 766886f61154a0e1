"""The time-step map of a step solver with its integrator, linearised by differences.

A step takes z = (x, v, a, integrator memory) to the next z in three stages: `formula` gives
w = (r1, r2), `solve` gives the new x, `advance` gives the new z. Formula and advance are affine in
z and in x, so unit differences of them are exact: dw = R dz, dz' = P dz + Q dx'. Only the solver's
response dx' = S dw is nonlinear; it is differenced, column by column, in the solver's own small
layout. The map is P + Q S R. The solver needs `solve` only, so the map exists for
every reducer and integrator, third-party ones included. A solver may know its response: one with
a contact must, because penetrations of 1e-7 m leave differences no room. Multipliers carry no
state.

Step sizes are those of the blocks' kinds (docs/stability.md): a pair of rigid unknowns is nearly
defective at eigenvalue 1, so its columns need an error below 1e-10: four points. All other
unknowns enter almost linearly, and one-sided differences serve them; smaller ones let the solver's
stopping error (1e-13) through.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import (
    FreezesSupport,
    Integrator,
    RespondsExactly,
    State,
    StepFormula,
    StepMemory,
    StepSolver,
)
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.status import SolveFailed, Status


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """Affine map of the integrator: dw = R dz, dz' = P dz + Q dx', w = [r1; r2].

    R (2 n, N), P (N, N), Q (N, n).
    """

    R: FloatArray
    P: FloatArray
    Q: FloatArray

    @classmethod
    def of(cls, integrator: Integrator, layout: Layout, state: State, h: float) -> "Affine":
        """By unit changes of each entry of z and of x: exact, as both maps are affine."""
        n, z = layout.size, packed(state)
        base = integrator.formula(layout, state, h)
        after = packed(integrator.advance(layout, state, base, state.x, h))
        R, P, Q = np.zeros((2 * n, len(z))), np.zeros((len(z), len(z))), np.zeros((len(z), n))
        for i in range(len(z)):
            moved = unpacked(z + _unit(len(z), i), state)
            f = integrator.formula(layout, moved, h)
            R[:n, i], R[n:, i] = f.r1 - base.r1, f.r2 - base.r2
            P[:, i] = packed(integrator.advance(layout, moved, f, state.x, h)) - after
        for i in range(n):
            x = state.x + _unit(n, i)
            Q[:, i] = packed(integrator.advance(layout, state, base, x, h)) - after
        return cls(R, P, Q)


@dataclass(frozen=True, slots=True, eq=False)
class StepMap:
    """dz' = matrix dz, z = [x; v; a; memory columns] of the active unknowns.

    solver: what was differenced, on the `supports` of its selecting blocks; layout: the active
    unknowns, n of them; matrix (N, N); response (n, 2 n): dx' from [dr1; dr2]; scale (n,): size
    of each unknown.
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
        """Positions in z of one block's x, v, a and memory."""
        n = self.layout.size
        at = np.arange(n)[self.layout[name]]
        return np.concatenate([at + j * n for j in range(len(self.matrix) // n)])

    def own(self, name: str) -> FloatArray:
        """The block's own part of the map: the past of all others is held, not their present."""
        here = self.components(name)
        return np.asarray(self.matrix[np.ix_(here, here)])

    def alone(self, name: str, response: FloatArray) -> FloatArray:
        """The map of one block that answers its own [dr1; dr2] by `response` (k, 2 k)."""
        n, here, part = self.layout.size, self.components(name), self.integrator
        at = np.arange(n)[self.layout[name]]
        R = part.R[np.ix_(np.concatenate([at, n + at]), here)]
        return np.asarray(part.P[np.ix_(here, here)] + part.Q[np.ix_(here, at)] @ response @ R)

    def block_response(self, name: str) -> FloatArray:
        """(k, 2 k): dx' of a block from its own dr1 and dr2."""
        n, at = self.layout.size, np.arange(self.layout.size)[self.layout[name]]
        return np.asarray(self.response[np.ix_(at, np.concatenate([at, n + at]))])


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def step_map(
    solver: StepSolver, integrator: Integrator, h: float, state: State, memory: StepMemory
) -> StepMap:
    """The step from `state` (in the solver's layout, the integrator's memory set), linearised.

    Each solve is given a copy of `memory`. A solver that selects atoms is linearised on the support
    that it selects in this step (`frozen`, where it offers that); other coefficients carry nothing.
    Raises SolveFailed when the step fails, or every step from states near it.
    """
    formula = integrator.formula(solver.layout, state, h)
    x, memory = _solve(solver, formula, memory.copy())
    if isinstance(solver, FreezesSupport):
        solver, memory = solver.frozen(memory)
    supports = {name: kept.copy() for name, kept in solver.supports(memory).items()}
    active = active_unknowns(solver.layout, supports)
    small = solver.layout.resized(
        {b.name: int(active[solver.layout[b.name]].sum()) for b in solver.layout})
    scale = _sizes(solver.layout, x)
    S = _exact(solver, formula, x) if isinstance(solver, RespondsExactly) else (
        _response_by_some_change(solver, formula, memory, np.flatnonzero(active), scale))
    inner = State(state.t, state.x[active], state.v[active], state.a[active],
                  state.memory[active])
    part = Affine.of(integrator, small, inner, h)
    matrix = part.P + part.Q @ (S @ part.R)
    if not np.isfinite(matrix).all():
        raise SolveFailed(Status.NOT_FINITE, formula.t)
    return StepMap(solver, supports, small, matrix, S, formula, part, scale[active])


def _exact(solver: RespondsExactly, formula: StepFormula, x: FloatArray) -> FloatArray:
    try:
        return np.asarray(solver.response(formula, x))
    except RuntimeError:
        raise SolveFailed(Status.SINGULAR, formula.t) from None


def _response_by_some_change(
    solver: StepSolver, formula: StepFormula, kept: StepMemory, active: IntArray, scale: FloatArray
) -> FloatArray:
    """The response by the usual changes; by smaller ones where a solve near the step fails.

    Rows that miss a joint answer a change of the frame by enormous coefficients, which a solver
    refuses or iterates for in vain.
    """
    for shrink in (1.0, 1e-2, 1e-4):
        try:
            return _response(solver, formula, kept, active, shrink * scale)
        except SolveFailed as failure:
            last = failure
    raise last


def active_unknowns(layout: Layout, supports: Mapping[str, BoolArray]) -> BoolArray:
    """(n,) True for every unknown that is no coefficient of an atom out of use."""
    active = np.ones(layout.size, dtype=np.bool_)
    for name, support in supports.items():
        active[layout[name]] = support
    return active


def packed(state: State) -> FloatArray:
    """z: x, v, a and the columns of the integrator's memory, one after the other."""
    return np.concatenate([state.x, state.v, state.a, state.memory.T.ravel()])


def unpacked(z: FloatArray, like: State) -> State:
    """The state whose entries are z."""
    x, v, a, *memory = z.reshape(-1, like.x.size)
    columns = np.stack(memory, axis=1) if memory else np.zeros((like.x.size, 0))
    return State(like.t, x, v, a, columns)


def _response(
    solver: StepSolver, formula: StepFormula, kept: StepMemory, active: IntArray, scale: FloatArray
) -> FloatArray:
    """(n, 2 n) dx' of the active unknowns from changes of their own r1 and r2."""
    layout, n = solver.layout, len(active)
    kind_of = [b.kind for b in layout for _ in range(b.size)]
    S = np.zeros((n, 2 * n))
    base, _ = _solve(solver, formula, kept.copy())

    def moved(which: str, i: int, by: float) -> FloatArray:
        r = np.array(getattr(formula, which))
        r[i] += by
        changed = replace(formula, r1=r) if which == "r1" else replace(formula, r2=r)
        return _solve(solver, changed, kept.copy())[0]

    for j, i in enumerate(active.tolist()):
        if i >= layout.algebraic.start:
            continue
        first = i >= layout.second.stop
        kinds = [("r1", formula.c1_first)] if first else [("r1", formula.c1), ("r2", formula.c2)]
        for shift, (which, c) in enumerate(kinds):
            d = kind_of[i].change * scale[i] * c
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
    """(n,) largest value of each unknown's block, at least the smallest size of its kind."""
    sizes = np.ones(layout.size)
    for b in layout:
        top = float(np.abs(x[layout[b.name]]).max())
        sizes[layout[b.name]] = max(top, b.kind.smallest)
    return sizes


def _unit(n: int, i: int) -> FloatArray:
    e = np.zeros(n)
    e[i] = 1.0
    return e
