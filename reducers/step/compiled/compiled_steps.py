"""Several steps at once as machine code."""

from collections.abc import Callable
from itertools import accumulate
from typing import cast

import numpy as np
from scipy.linalg.lapack import dgetri

from sparsemor.core import FloatArray, State, UpdateRules, next_time
from sparsemor.core.protocols.poses import turns_from
from sparsemor.core.protocols.step_amplitude import Substep, substep
from sparsemor.core.protocols.step_solver import StepBlock
from sparsemor.core.protocols.time_function import held_reads
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.compiled.compile import Functions, compiled_advance
from sparsemor.reducers.step.compiled.fill_arrays import model_arrays, plan, work_of
from sparsemor.reducers.step.compiled.model_arrays import RunArrays
from sparsemor.reducers.step.jacobian_factors import Factor, Inverse
from sparsemor.reducers.step.newton_loop import UNKNOWN, KeptJacobian, Linearisation, Loop
from sparsemor.reducers.step.step_memory import Memory
from sparsemor.reducers.step.thermal_block import CompressedHeat

LONGEST = 400
"""Largest number of steps of a block: functions of time are tabulated for it."""
AHEAD = 50
"""Largest number of steps from a state to that of the Jacobian with which it is continued."""


class CompiledSteps:
    """Steps of size h, s, of one run of a step solver; working arrays belong to the run. Raises
    NotCompiled where its model is not covered.

    code: function that makes `kernel.advance` with the model's functions.
    """

    def __init__(
        self, solver: BlockwiseSolver, rules: UpdateRules, h: float,
        code: Callable[[Functions], Callable[..., int]] = compiled_advance
    ) -> None:
        """rules: of the integrator; h: step size, s; code: makes the compiled `kernel.advance` with
        the model's functions of frames and laws. plan: arrays that do not depend on the steps."""
        self.solver, self.h, self.plan = solver, h, plan(solver)
        self.model = model_arrays(solver, rules, h)
        m = self.model
        self._c = m.c1, m.c2, m.c1_first, m.c2_first
        self._advance = code(self.plan.functions)
        self._arrays = self.model, self.plan.heat, self.plan.arrays, work_of(self.model)
        self._block_length, self._factor = LONGEST, cast("Factor | None", None)
        self._inverse, none = np.zeros((0, 0)), np.zeros(0)
        self._spans = np.zeros((0, 2), dtype=np.int64)
        self._attitudes = np.zeros((0, 4, 4, 4))
        # times, functions of time and rows by time alone, tabulated for the next steps; False where
        # a controller sets one of them anew in each step
        self._table, self._tabulated = (none, none, none), True
        # thermal block -> temperatures at which the kept Jacobian in `plan.heat` was evaluated
        self._heat_points: dict[str, FloatArray] = {}

    def advance(self, state: State, memory: Memory, count: int) -> StepBlock:
        """Solves up to `count` steps; none where reference magnitudes are unknown, as at the start,
        and none that does not converge even with a Jacobian of the last state."""
        moves = self.plan.arrays.moves
        # full_newton_steps_left: number of next steps that need the exact Jacobian of all unknowns
        # kept.top: largest value of each block so far, to which changes are relative
        if memory.full_newton_steps_left or (moves and not memory.kept.top.any()):
            return StepBlock()
        times, timed, base = self._functions_of_time(state.t, count)
        block, renew = self._solved(state, memory, times, timed, base)
        # no step solved: try again with a Jacobian of the last state, until that is the kept one
        while renew and not block and self._jacobian_age(state, memory.kept) != 0.0:
            self._linearize(state, memory)
            block, renew = self._solved(state, memory, times, timed, base)
        if renew and block:
            self._linearize(block.state(len(block) - 1), memory)
        if self.plan.arrays.prescribed:  # products with temperatures, for all steps, are large
            # next block: four times as long after one without a stop, else twice what was solved
            done = len(block)
            longer = 4 * self._block_length if done == len(times) else 2 * done + 2
            self._block_length = min(longer, LONGEST)
        return block

    def _solved(
        self, state: State, memory: Memory, times: FloatArray, timed: FloatArray, base: FloatArray
    ) -> tuple[StepBlock, bool]:
        """The steps that are solved with the kept Jacobians, and True if a new one is due. What the
        compiled function changed in its arrays is taken over into the memory of the run."""
        with substep(Substep(self.h)):
            self._take_jacobians(state, memory)
        run = self._run_arrays(state, memory)
        states, effort = np.empty((len(times), *run.z.shape)), np.zeros((len(times), 2))
        done = self._advance(*self._arrays, run, timed, base, self._bounds(memory, times),
                             np.zeros((3, *base.shape)), states, effort)
        for name, heat in zip(self.plan.heat_groups, self.plan.heat, strict=True):
            if heat.inverse.size and not heat.ready[0]:  # it contracts too slowly
                memory.keep(name, None)
        if done:  # run.at: newest row and number of filled ones; run.effort: least, debt, renew
            memory.past.ring.newest, memory.past.ring.filled = run.at[:2].tolist()
            memory.past.by_departure = run.by_departure
            memory.kept.least, memory.kept.debt = run.effort[:2].tolist()
        block = StepBlock(times[:done].tolist(), states[:done],
                          effort[:done, 0].astype(int).tolist(), effort[:done, 1].tolist())
        return block, bool(run.effort[2])

    def _jacobian_age(self, state: State, kept: KeptJacobian) -> float:
        """Time, s, since the state of the kept Jacobian, negative where that is yet to come."""
        return 0.0 if kept.point is None else state.t - kept.point.t

    def _linearize(self, state: State, memory: Memory) -> None:
        """The kept Jacobian becomes that of a state as far ahead as the old one lies behind: it
        serves as long before this state as after. It depends on nothing else, so that a resumed run
        has equal digits."""
        kept, rigid, x, v = memory.kept, self.solver.layout.frames, state.x.copy(), state.v.copy()
        tau = min(max(self._jacobian_age(state, kept), 0.0), AHEAD * self.h)
        x[rigid] += tau * (v[rigid] + 0.5 * tau * state.a[rigid])
        v[rigid] += tau * state.a[rigid]
        kept.forget()
        kept.point = Linearisation(x, v, state.a, state.t + tau, self._c)
        kept.least, kept.debt = UNKNOWN, 0
        memory.factorizations += 1

    def _functions_of_time(self, t: float, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times of the next steps (T,), functions of time (T, q), and rows (T, n) that depend on
        time alone; those tabulated before (`_table`, the same three) are not evaluated again."""
        first = int(np.searchsorted(self._table[0], next_time(t, self.h)))
        if not (self._table[0][first : first + 1] == next_time(t, self.h)).any():
            longest = LONGEST if self._tabulated else 1
            ends = accumulate([self.h] * min(count, longest), next_time, initial=t)
            times, first, reads = np.array([*ends][1:]), 0, held_reads()
            timed = self.plan.timed.along(times)
            table = times, timed, self.plan.base_along(times, timed)
            if held_reads() != reads:  # a held value of a controller was read: valid for one step
                self._tabulated, (times, timed, base) = False, (a[:1] for a in table)
                return times, timed, base
            self._table = table
        at = slice(first, first + min(count, self._block_length))
        times, timed, base = (values[at] for values in self._table)
        return times, timed, base

    def _take_jacobians(self, state: State, memory: Memory) -> None:
        """Takes the kept Jacobians over from the memory, with factors that are computed again after
        a restart: of mechanics as an inverse with the attitudes (unit quaternions) from which its
        bodies turn; of thermal blocks in `heat.inverse`, with heat.ready[0] = 1 if there is one."""
        kept, equations = memory.kept, self.plan.equations
        if self.plan.arrays.moves:
            if kept.point is None or kept.point.c != self._c:
                self._linearize(state, memory)
            if kept.factor is None or not len(kept.noise):
                loop = Loop(self.solver.layout, self.solver.tolerances)
                if kept.factor is None:
                    loop.factorize(memory.work.of(equations), kept)
                loop.kept_noise(memory.work.of(equations), kept)
            if kept.factor is not self._factor:
                assert kept.factor is not None and kept.point is not None
                self._factor, at = kept.factor, self.solver.layout.quaternions
                self._attitudes = turns_from(np.array(
                    [kept.point.x[i : i + 4] for i in at]).reshape(len(at), 4))
                n = len(self.plan.arrays.solved)
                self._inverse = (kept.factor.inverse if isinstance(kept.factor, Inverse)
                                 else kept.factor.solve(np.eye(n)))
                if len(some := self._inverse != 0.0):
                    self._spans = np.stack((
                        some.argmax(axis=1), len(some) - some[:, ::-1].argmax(axis=1)), axis=1)
        for name, heat in zip(self.plan.heat_groups, self.plan.heat, strict=True):
            if not heat.inverse.size:
                continue
            known, block = memory.jacobian(name), self.solver.heat[name]
            heat.ready[0] = int(known is not None)
            if known is not None and known.at is not self._heat_points.get(name):
                assert isinstance(block, CompressedHeat)
                memory.keep(name, known := block.restored(known))
                assert known.factors is not None
                heat.inverse[:] = dgetri(*known.factors[:2])[0]
                self._heat_points[name] = known.at

    def _bounds(self, memory: Memory, times: FloatArray) -> FloatArray:
        """Proved contraction (T,) with the kept Jacobian of the steps that end at `times`; inf
        where none is known."""
        equations, point = memory.work.of(self.plan.equations), memory.kept.point
        if not equations.linear or point is None:
            return np.full(len(times), np.inf)
        return np.asarray(np.max(
            [b.contraction_along(point, times) for b in equations.prescribed_bodies], axis=0))

    def _run_arrays(self, state: State, memory: Memory) -> RunArrays:
        past, kept = memory.past, memory.kept
        by_departure = np.zeros(past.n, dtype=np.bool_) if past.by_departure is None else (
            past.by_departure.copy())
        noise = kept.noise if len(kept.noise) else np.zeros(len(kept.top))
        return RunArrays(
            np.concatenate((np.stack((state.x, state.v, state.a)), state.memory.T)),
            past.ring.rows, np.array([past.ring.newest, past.ring.filled]), by_departure, kept.top,
            kept.rate, noise, self._inverse, self._spans, self._attitudes,
            np.array([kept.least, kept.debt, 0]), np.zeros(1))
