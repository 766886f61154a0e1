"""Step solver whose steps can be compiled."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from itertools import accumulate
from typing import Any, Literal, TypeAlias

import numpy as np

from sparsemor.core import (
    FloatArray,
    Note,
    State,
    StepSolver,
    UpdateRules,
    information,
    next_time,
    require,
)
from sparsemor.core.protocols import ManySteps, StepBlock
from sparsemor.reducers.step.acceptance import EPS, Scales
from sparsemor.reducers.step.blocks.thermal_block import HeatJacobian
from sparsemor.reducers.step.compiled.arrays import (
    NO_HEAT,
    NO_KEPT,
    NO_PRESCRIBED,
    NO_TERMS,
    HeatArrays,
    KeptHeat,
    ModelArrays,
    RunArrays,
)
from sparsemor.reducers.step.compiled.compile import compiled_advance, installed
from sparsemor.reducers.step.compiled.plan import Plan, model_arrays, plan
from sparsemor.reducers.step.compiled.stacked import work_of
from sparsemor.reducers.step.compiled.timed import NotCompiled
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.reduced_mechanics import ReducedMechanics
from sparsemor.reducers.step.solver import Stepper

Compiled: TypeAlias = Literal["auto", "on", "off"]
AUTO = 200_000
"""Smallest number of steps of a run that `auto` compiles: the first compilation takes as long as
about as many uncompiled steps."""
LONGEST = 400
"""Largest number of steps of a block: functions of time are tabulated for it."""


@dataclass(frozen=True, slots=True, eq=False)
class CompiledStepper(Stepper):
    """Block-wise step solver that takes several steps at once as machine code, unless `compiled` is
    "off" or its model is not covered (plan.py)."""

    compiled: Compiled = "off"

    def many(self, rules: UpdateRules, h: float, steps: int) -> "ManySteps[Memory] | None":
        """Compiled steps of size h, s, for a run of `steps` steps."""
        return compiled_steps(self, rules, h) if wanted(self.compiled, steps) else None

    def stepping_alike(self, copy: StepSolver) -> StepSolver:
        return _with(copy, copy.notes, self.compiled) if isinstance(copy, Stepper) else copy


def compiled_steps(s: Stepper, rules: UpdateRules, h: float) -> "CompiledSteps | None":
    """Compiled steps of `s`, of size h, s; None where its model is not covered."""
    try:
        return CompiledSteps(plan(s, *rules.factors[:2]), model_arrays(s, rules, h), h)
    except NotCompiled:
        return None


def compilable(made: Stepper, option: Compiled) -> Stepper:
    """The step solver with compiled steps as the option says; a note where they are wanted and the
    model is not covered. Raises InputError where numba is wanted and not installed."""
    if option == "off":
        return made
    require_numba(option)
    notes: tuple[Note, ...] = ()
    if option == "on":
        try:
            plan(made)
        except NotCompiled as reason:
            notes = (information(f"compiled: on has no effect: {reason}", "compiled"),)
    return _with(made, (*made.notes, *notes), option)


def _with(made: Stepper, notes: tuple[Note, ...], option: Compiled) -> CompiledStepper:
    kept: dict[str, Any] = {f.name: getattr(made, f.name) for f in fields(Stepper)}
    return CompiledStepper(**{**kept, "notes": notes}, compiled=option)


def require_numba(option: Compiled) -> None:
    """Raises InputError where numba is wanted and not installed."""
    if option == "on":
        require("numba", "fast", "compiled: on")


def wanted(option: Compiled, steps: int) -> bool:
    """True if the steps of a run are to be compiled."""
    return option == "on" or (option == "auto" and steps >= AUTO and installed())


class CompiledSteps:
    """Steps of size h, s, of one run on the arrays of a plan; working arrays belong to the run.

    advance_arrays: `kernel.advance`, compiled unless it is given, with `listed` for the lists of
    tuples of arrays that it takes.
    """

    def __init__(
        self, plan: Plan, model: ModelArrays, h: float,
        advance_arrays: Callable[..., int] | None = None,
        listed: Callable[[Sequence[Any], Any], Any] = lambda items, kind: items,
    ) -> None:
        self.plan, self.model, self.h = plan, model, h
        self._ahead = LONGEST
        if advance_arrays is None:
            advance_arrays, listed = _compiled(plan)
        self._advance = advance_arrays
        self._work = work_of(plan.bodies, plan.border)
        self._heat = listed(plan.heat, NO_HEAT)
        self._own = [_kept(h, plan.timed.width) for h in plan.heat]
        self._at: list[FloatArray | None] = [None] * len(self._own)
        self._kept = listed(self._own, NO_KEPT)
        self._terms = listed(plan.terms, NO_TERMS)
        self._prescribed = listed(plan.prescribed, NO_PRESCRIBED)

    def advance(self, state: State, memory: Memory, count: int) -> StepBlock:
        """Solves up to `count` steps; none at the start, where reference magnitudes are unknown,
        and while full Newton steps are due."""
        mechanics = self.plan.mechanics
        if isinstance(mechanics, ReducedMechanics) and memory.kept.top.any():
            _magnitudes(mechanics, state, memory.scales, self.model.c1, self.model.c2)
        known = memory.scales.floor or not (len(self.plan.bodies.k) or self.plan.prescribed)
        if not known or memory.full_newton_next:
            return StepBlock()
        ends = accumulate([self.h] * min(count, self._ahead), next_time, initial=state.t)
        times = np.array([*ends][1:])
        run = _run_arrays(state, memory)
        states, effort = np.empty((len(times), *run.z.shape)), np.zeros((len(times), 2))
        self._load(memory)
        done = self._advance(
            self.model, self._heat, self._kept, self.plan.bodies, self._terms, self._work,
            self._prescribed, run, self.plan.timed.along(times), self.plan.targets_along(times),
            states, effort)
        self._store(memory, times)
        if done:
            _keep(run, memory)
        # a step that is left to the uncompiled solver is often followed by others
        self._ahead = min(4 * self._ahead, LONGEST) if done == len(times) else 2
        return StepBlock(times[:done].tolist(), states[:done],
                         effort[:done, 0].astype(int).tolist(), effort[:done, 1].tolist())

    def _load(self, memory: Memory) -> None:
        """Takes the Jacobians of thermal blocks over from the memory; those of the last call have
        their factors."""
        for i, (name, kept) in enumerate(zip(self.plan.hot, self._own, strict=True)):
            at = memory.linearized.get(name)
            kept.state[:] = (0 if at is None else 2 if at is self._at[i] else 1), -1
            if kept.state[0] == 1 and at is not None:
                kept.at[:] = at[:-1].reshape(3, -1)
                kept.timed[:] = self.plan.timed.along(at[-1:])[0]

    def _store(self, memory: Memory, times: FloatArray) -> None:
        """Keeps them in the memory, also those of a step that was not solved: it is tried alike
        wherever a block begins."""
        for i, (name, kept) in enumerate(zip(self.plan.hot, self._own, strict=True)):
            ready, number = kept.state.tolist()
            if not ready:
                memory.keep(name, None)
            elif number >= 0:
                memory.keep(name, HeatJacobian(np.append(kept.at.ravel(), times[number])))
            self._at[i] = memory.linearized.get(name) if ready == 2 else None


def _kept(h: HeatArrays, width: int) -> KeptHeat:
    """Working arrays for the Jacobian of a thermal block, with this many functions of time."""
    s = len(h.active) if len(h.local.terms) else 0
    return KeptHeat(np.zeros((s, s)), np.zeros(s, dtype=np.int64), np.zeros((3, len(h.at))),
                    np.zeros(width), np.zeros(2, dtype=np.int64))


def _compiled(plan: Plan) -> tuple[Callable[..., int], Callable[[Sequence[Any], Any], Any]]:
    """Compiled `kernel.advance` and the function that makes its lists."""
    numba: Any = import_module("numba")  # optional, and takes half a second to import

    def listed(items: Sequence[Any], example: Any) -> Any:
        made = numba.typed.List.empty_list(numba.typeof(example))
        for item in items:
            made.append(item)
        return made

    return compiled_advance(plan.functions), listed


def _magnitudes(
    mechanics: ReducedMechanics, state: State, scales: Scales, c1: float, c2: float
) -> None:
    """Reference magnitudes of the iteration of compiled steps, where the last step was not one of
    them."""
    if not scales.floor:
        n = len(mechanics.bodies)
        scales.elastic, scales.bending, scales.floor = [0.0] * n, [0.0] * n, [0.0] * n
        at = state.x, state.v, state.a, state.t
        columns = {b.body.step.name: b.column[:, b.at < mechanics.n_rigid]
                   for b in mechanics.whole.working().border_blocks(*at, c1, c2)}
        for i, b in enumerate(mechanics.bodies):
            if b.free:  # of rounding positions of size 1
                scales.floor[i] = (4 * EPS) ** 2 * float(np.sum(columns[b.name] ** 2))
    for i, b in enumerate(mechanics.bodies):
        u, a = state.x[b.elastic], state.a[b.elastic]
        scales.elastic[i] = max(scales.elastic[i], float(u.dot(u)))
        scales.bending[i] = max(scales.bending[i], float(a.dot(a)))
    a = state.a[: mechanics.n_rigid]
    scales.acceleration = max(scales.acceleration, float(np.sqrt(a.dot(a))))


def _run_arrays(state: State, memory: Memory) -> RunArrays:
    past, scales = memory.past, memory.scales
    z = np.concatenate((np.stack((state.x, state.v, state.a)), state.memory.T))
    by_departure = np.zeros(past.n, dtype=np.bool_) if past.by_departure is None else (
        past.by_departure.copy())
    return RunArrays(
        z, past.ring.rows, np.array([past.ring.newest, past.ring.filled]), by_departure,
        np.array(scales.elastic), np.array(scales.bending), np.array(scales.floor),
        np.array([scales.acceleration]), np.zeros(1))


def _keep(run: RunArrays, memory: Memory) -> None:
    """Takes the state after the last solved step over into the memory."""
    past, scales = memory.past, memory.scales
    past.ring.newest, past.ring.filled = run.at.tolist()
    past.by_departure = run.by_departure
    scales.elastic, scales.bending = run.elastic.tolist(), run.bending.tolist()
    scales.acceleration = float(run.acceleration[0])
