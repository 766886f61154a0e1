"""Online estimate of the error of a whole reduced model: its equations on the spaces of the errors
of all blocks, with rigid coordinates and multipliers.

The error e = x_full - x_reduced satisfies R(x_reduced + e, ..) = 0 with the residual R of the
full-order equations, and the formulas of the integrator like each of the runs. R is projected on
the spaces of errors (error_space.py) and solved by Newton's method from the free motion of e, so
that properties which depend on temperature, radiation, contact, and the reaction of rigid
coordinates and joint forces act on the error as they act on the run. Terms that are not linear are
evaluated on the whole mesh, once or twice at each step of this equation and at no other time.

The equation takes one step from one estimate to the next (`error_rules`), but shorter ones, through
states of the run in between, where frames turn far meanwhile: a long step follows neither the
turning directions that joints leave to e nor the residual, which turns with them. Estimates whose
number is fixed by their cost (`turn` infinite) do without.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sparsemor.core import (
    FloatArray,
    Integrator,
    Layout,
    Note,
    Quantity,
    State,
    Status,
    StepFormula,
    StepOutcome,
    advanced,
    step_formula,
)
from sparsemor.core.model.equations import rate_factors
from sparsemor.core.protocols.poses import FREE_POSE
from sparsemor.core.protocols.step_amplitude import Substep, substep
from sparsemor.reducers.estimation.bordered_modes import BorderedModes
from sparsemor.reducers.estimation.error_space import ErrorSpace
from sparsemor.reducers.estimation.modal_steps import begins, error_rules, error_start
from sparsemor.reducers.estimation.reduced_states import StateMap, ranges
from sparsemor.reducers.step.jacobian_factors import Factor
from sparsemor.reducers.step.reduced_equations import Reduced

ITERATIONS = 5
"""Largest number of iterations with one Jacobian at an estimate, if it has the run's own steps."""
ACCURACY = 1e-3
"""Relative change of the errors of each block at which the iteration ends."""


@dataclass(frozen=True, slots=True, eq=False)
class ReducedBlock:
    """A reduced block with the space of its errors; states: map of its coefficients to the modes;
    offset (n,): that of its trial basis."""

    name: str
    space: ErrorSpace
    offset: FloatArray
    states: StateMap


class StateAt(NamedTuple):
    """Unknowns x with rates v and a (n,) at t, s."""

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CoupledErrors:
    """Estimator of errors (`ErrorEstimator`) by the equations of the whole model on the spaces of
    errors. every: steps between two estimates, over which the error equation takes one step of
    size h, s, or several so that frames turn at most by `turn`, rad, in each; full, reduced:
    layouts of the full-order and of the reduced model; first: number of first steps with an
    estimate each (`begins`); margin: factor of the estimates;
    blocks: those with an estimate, displacements, temperatures and rigid coordinates;
    varying: True if the tangents of the equations are not nearly those of the spaces; passes:
    Newton iterations of a long step."""

    every: int
    h: float
    spaces: tuple[ReducedBlock, ...]
    equations: Reduced
    full: Layout
    reduced: Layout
    integrator: Integrator
    turn: float
    first: int
    margin: float
    varying: bool
    passes: int
    notes: tuple[Note, ...]

    @property
    def blocks(self) -> tuple[str, ...]:
        return tuple(b.name for b in self.equations.layout.differential)

    def due(self, step: int) -> bool:
        return step % self.every == 0 or begins(step, self.every, self.first)

    def start(self, full: State, reduced: State) -> dict[str, FloatArray]:
        """Memory of the estimate at the start of a run: errors (s, n), full less reduced, of the
        initial state with their rates and the integrator's history, and the state itself (3, n)
        with its time, in the coordinates of the error spaces, measured from the offsets of the
        trial bases. Keys: `_memory`."""
        layout, (known, outside) = self.equations.layout, self.projected([reduced])[0]
        spaces, e = {b.name: b for b in self.spaces}, np.zeros((3, layout.size))
        for block in layout:
            at, b = layout[block.name], spaces.get(block.name)
            for i, whole in enumerate((full.x, full.v, full.a)):
                x = whole[self.full[block.name]]
                if b is not None:
                    x = b.space.coefficients(x - b.offset if i == 0 else x)
                e[i, at] = x - (known.x, known.v, known.a)[i][at]
        x, v, a = e
        error = State(full.t, x, v, a, np.zeros((layout.size, 0)))
        return self._memory(error_start(
            self.integrator, 1, layout, error), known, outside, count=0)

    def corrected(self, full: State, memory: Mapping[str, FloatArray]) -> State:
        """A state of the full model plus the estimated errors and their rates: those in the error
        spaces, and minus the part of the reduced state outside of these ("outside")."""
        x, v, a = full.x.copy(), full.v.copy(), full.a.copy()
        spaces = {b.name: b.space.modes for b in self.spaces}
        for block in self.equations.layout:
            at, there = self.equations.layout[block.name], self.full[block.name]
            for part, e in zip((x, v, a), memory["errors"][:3, at], strict=True):
                part[there] += spaces[block.name] @ e if block.name in spaces else e
        for name, at in self._outside.items():
            for part, rest in zip((x, v, a), memory["outside"][:, at], strict=True):
                part[self.full[name]] -= rest
        return State(full.t, x, v, a, full.memory)

    def present(self, memory: Mapping[str, FloatArray]) -> dict[str, float]:
        """Estimated error norm of each block at present."""
        return self._norms(memory["errors"][0], memory["outside"][0])

    def advance(
        self, paths: Sequence[Sequence[State]], memory: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Estimated error norms (j,) of each block at the ends of j successive paths of `every`
        states of the run; `memory` is brought to the last. self.h: time between two estimates, s,
        so that self.h / self.every is a step of the run."""
        if not paths:
            return {n: np.zeros(0) for n in self.blocks}
        stride = self._last_stride(memory)
        chosen: list[Sequence[State]] = []
        for path in paths:  # every `stride`-th state, the last one included
            stride = self._stride(path[-1], stride)
            chosen.append(path[(len(path) - 1) % stride :: stride])
        run = self.projected([s for path in chosen for s in path])
        with substep(Substep(self.h / self.every)):  # laws of steps, such as heat that is stored
            found = self.working()._advanced(run, memory)
        ends = np.cumsum([len(path) for path in chosen]) - 1
        return {n: values[ends] for n, values in found.items()}

    def _last_stride(self, memory: Mapping[str, FloatArray]) -> int:
        """Number of the run's steps in one step of the error equation up to now."""
        return self.every if self.first else int(memory["steps"]) or self.every

    def _stride(self, state: State, before: int) -> int:
        """Number of the run's steps in one step of the error equation, at a state of the run: the
        largest that divides `every`, is not larger than that `before`, and in which no frame turns
        further than `turn`, rad. It never grows, since each change forgets the integrator's
        history. self.h: time between two estimates, s."""
        rate, h = 0.0, self.h / self.every
        for b in self.reduced:
            if b.kind.quantity is Quantity.POSE:
                # angular rate, rad/s: twice that of a quaternion, or that of the last coordinate
                v = state.v[self.reduced[b.name]]
                rate = max(rate, 2.0 * float(np.linalg.norm(v[-4:])) if b.size == FREE_POSE
                           else abs(float(v[-1])))
        limit = min(before, self.turn / (rate * h) if rate > 0.0 else np.inf)
        return max(d for d in range(1, self.every + 1)
                   if self.every % d == 0 and (d == 1 or d <= limit))

    def carry(self, count: int, memory: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """The same for `count` estimates along full-order steps, to which no error is added: by the
        equations at the last state that was reduced, with zero residual there."""
        at, own = StateAt(float(memory["time"]), *memory["reduced"]), self.working()
        stride = self._last_stride(memory)
        each = self.every // stride
        with substep(Substep(self.h / self.every)):
            found = own._advanced(
                [(at, memory["outside"])] * (each * count), memory, own.residual(at), stride)
        return {n: values[each - 1 :: each] for n, values in found.items()}

    def working(self) -> "CoupledErrors":
        """The same estimator with new working arrays, of one call or one thread."""
        return replace(self, equations=self.equations.working())

    def _advanced(
        self, run: Sequence[tuple[StateAt, FloatArray]], memory: dict[str, FloatArray],
        permitted: FloatArray | float = 0.0, steps: int = 0
    ) -> dict[str, FloatArray]:
        """Error norms of each block after a step of the error equation to each of these states,
        which come with their parts (3, m) outside of the error spaces; `memory` is brought to the
        last. Where the number of the run's steps in one changes, the integrator's history begins
        anew. permitted: residual (n,) that the error equation keeps; steps: number of the run's
        steps to each state, 0 where their times show it, which steps of full order keep."""
        found: dict[str, list[float]] = {n: [] for n in self.blocks}
        for at, outside in run:
            x, v, a, *history = memory["errors"]
            # h: a step of the run, s; before, count: so many of them in the last and in this step
            start, before, h = float(memory["time"]), int(memory["steps"]), self.h / self.every
            count = steps or max(round((at.t - start) / h), 1)
            error = State(
                at.t - count * h, x, v, a, np.reshape(history, (len(history), len(x))).T)
            if count != before:
                error = error_start(self.integrator, count, self.equations.layout, error)
            error = self._step(at, error, count, permitted)
            memory |= self._memory(error, at, outside, count)
            for n, norm in self._norms(error.x, outside[0]).items():
                found[n].append(norm)
        return {n: np.array(v) for n, v in found.items()}

    def _step(
        self, at: StateAt, error: State, count: int, permitted: FloatArray | float
    ) -> State:
        """Errors at a state of the run from those `count` steps before: R(state + error) =
        `permitted`, by Newton's method with one Jacobian. d (n,): departure of the error from its
        free motion; passes: Newton iterations of a long step."""
        layout, h = self.equations.layout, self.h / self.every  # h: a step of the run, s
        rules = error_rules(self.integrator, count, h)
        formula = step_formula(rules, layout, error, count * h)
        d, factor = np.zeros(layout.size), None
        for _ in range(ITERATIONS if count == 1 else self.passes):
            x, v, a = formula.at(d)
            now = StateAt(at.t, at.x + x, at.v + v, at.a + a)
            r = self.residual(now) - permitted
            if factor is None:
                try:
                    factor = self._jacobian(now, formula)
                except RuntimeError:  # singular: the errors go on freely
                    break
            change = factor.solve(r)
            d = d - change
            if all(np.linalg.norm(change[i]) <= ACCURACY * np.linalg.norm((formula.free + d)[i])
                   for i in (layout[n] for n in self.blocks)):
                break
        x, v, a = formula.at(d)
        # linear: errors are small changes of states, whose quaternions have no length of 1
        return advanced(rules, layout, error, formula, StepOutcome(
            x, Status.DONE, 1, rates=(v, a)), linear=True)

    def _jacobian(self, at: StateAt, formula: StepFormula) -> Factor:
        """Factorized derivative of the residual. Raises RuntimeError where it is singular."""
        equations, rates = self.equations, (formula.c1, formula.c2, formula.c1_first)
        if not self.varying:
            spaces = {b.name: b.space for b in self.spaces}
            return BorderedModes.at_state(equations, spaces, at.x, at.v, at.a, at.t, *rates)
        c1, c2 = rate_factors(equations.layout, *rates)
        return equations.factorize(equations.slope(at.x, at.v, at.a, at.t, c1, c2))

    def residual(self, at: StateAt) -> FloatArray:
        """Residual (n,) of the full-order equations on the error spaces."""
        return self.equations.residual_at(
            at.x, at.v, at.a, at.t, self.equations.prescribed(at.t))

    def lifted(self, state: State) -> StateAt:
        """A state of the reduced model in the coordinates of the error spaces."""
        return self.projected([state])[0][0]

    def projected(self, states: Sequence[State]) -> list[tuple[StateAt, FloatArray]]:
        """States of the reduced model in the coordinates of the error spaces, each with the parts
        (3, m) of x, v and a outside of them, of all blocks in turn."""
        layout, maps = self.equations.layout, {b.name: b.states for b in self.spaces}
        rows = [z for s in states for z in (s.x, s.v, s.a)]
        reduced_rows = np.vstack([np.zeros((0, self.reduced.size)), *rows])
        in_spaces = np.zeros((len(reduced_rows), layout.size))
        outside = [np.zeros((len(reduced_rows), 0))]
        for block in layout:
            coefficients = reduced_rows[:, self.reduced[block.name]]
            if block.name in maps:
                coefficients, rest = maps[block.name](coefficients)
                outside.append(rest)
            in_spaces[:, layout[block.name]] = coefficients
        all_outside = np.hstack(outside)
        return [(StateAt(s.t, *in_spaces[i : i + 3]), all_outside[i : i + 3])
                for s, i in zip(states, range(0, len(reduced_rows), 3), strict=True)]

    @property
    def _outside(self) -> dict[str, slice]:
        """Ranges of the blocks with reduced states outside of their error space."""
        sizes = {b.name: b.states.outside for b in self.spaces}
        return ranges({b.name: sizes[b.name] for b in self.equations.layout
                       if sizes.get(b.name)})

    def _norms(self, e: FloatArray, outside: FloatArray) -> dict[str, float]:
        """Estimates of each block from errors e (n,) and parts (m,) outside of the error spaces,
        times `margin`. space.norm (q, q): |norm e| is the length of the error of the block's q
        modes in its n unknowns; _outside: block -> its columns in `outside`."""
        layout, norms = self.equations.layout, {b.name: b.space.norm for b in self.spaces}
        rest = self._outside
        found = {}
        for n in self.blocks:
            inside = norms[n] @ e[layout[n]] if n in norms else e[layout[n]]
            both = np.concatenate([inside, outside[rest.get(n, slice(0, 0))]])
            found[n] = self.margin * float(np.linalg.norm(both))
        return found

    @staticmethod
    def _memory(
        error: State, at: StateAt, outside: FloatArray, count: int
    ) -> dict[str, FloatArray]:
        """Memory of an estimate: errors [x, v, a, history] (s, n); state that was reduced last (3,
        n), its time, s, and its part outside of the error spaces (3, m); number of the run's steps
        in the last step, 0 at the start."""
        return {"errors": np.vstack([error.x, error.v, error.a, error.memory.T]),
                "reduced": np.stack([at.x, at.v, at.a]), "time": np.array(at.t),
                "outside": outside, "steps": np.array(count)}
