"""Block-wise solution of a step: heat first, then mechanics. Shared by all reducers.

Temperatures act on displacements, but not the reverse, so that each thermal block is solved before
(thermal_block.py; blocks that conduct to each other together, by the Newton loop). Mechanics are
all elastic blocks with rigid coordinates and joint forces (newton_loop.py).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from sparsemor.core import (
    AssembledModel,
    BoolArray,
    Dictionary,
    FloatArray,
    IntArray,
    Layout,
    Note,
    State,
    Status,
    StepFormula,
    StepOutcome,
    StepSolver,
    Table,
)
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.core.model.constraint_rates import motion_step
from sparsemor.core.protocols.step_solver import LinearSystem
from sparsemor.reducers.step.consistent_start import consistent_start, constraint_errors
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.monolithic_step import WholeNewton, beyond_limits, linear_response
from sparsemor.reducers.step.newton_loop import KeptJacobian, Loop, StepEquations
from sparsemor.reducers.step.predictor import Predictor, block_starts
from sparsemor.reducers.step.projected_operators import ProjectedElastic
from sparsemor.reducers.step.reduced_equations import Reduced
from sparsemor.reducers.step.reduced_mechanics import (
    LoopMechanics,
    Mechanics,
    ReducedMechanics,
    StepUnknowns,
)
from sparsemor.reducers.step.step_memory import Memory
from sparsemor.reducers.step.thermal_block import HeatBlock
from sparsemor.reducers.step.thermal_groups import group_name

STEPS = 10
"""Number of steps after one that needed the exact Jacobian before the cheaper iteration is tried
again."""
Facts = Mapping[str, Mapping[str, float | int | str]]
"""Block name -> numbers to report."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockwiseSolver(StepSolver[Memory]):
    """Block-wise step solver: heat first, then mechanics.

    limits: largest permitted |coefficient| of each block; sanity (n,): the inverse for each
    unknown, so that one product shows that all are within. heat: block name -> its rows in a step;
    operators: elastic block -> projected operators. points: number of past states that are
    extrapolated. system: bodies and constraints, for consistent starts; mechanics: the solver of
    their step, None only while the solver is put together. rows: sampled rows of each block;
    elements_touched: block -> elements that a step visits; factorizations: made before the run.
    """

    layout: Layout
    dictionaries: Mapping[str, Dictionary]
    rows: Mapping[str, IntArray]
    elements_touched: Mapping[str, int]
    system: Mechanics
    heat: Mapping[str, HeatBlock]
    tolerances: Tolerances
    points: int
    factorizations: int
    limits: Mapping[str, float] = field(default_factory=dict)
    sanity: FloatArray = field(default_factory=lambda: np.zeros(0))
    notes: tuple[Note, ...] = ()
    facts: Facts = field(default_factory=dict)
    operators: Mapping[str, ProjectedElastic] = field(default_factory=dict)
    mechanics: LoopMechanics | None = None
    iterative: bool = False
    """True if any elastic block has an iterative linear solver."""
    heat_groups: tuple[tuple[str, slice | IntArray], ...] = ()
    """Name and unknowns of each thermal block, or of several that are solved together."""
    meshless: bool = False
    """True if `start` takes a state in the reduced unknowns."""
    newton: WholeNewton | None = None
    """The whole step with its exact Jacobian, where the mechanics do not converge."""
    full_heat: Mapping[str, StepEquations] = field(default_factory=dict)
    """Equations of the heat of each group of coupled bodies that is solved for by the loop."""
    loop: Loop | None = None
    whole: Reduced | None = None
    """Equations of the whole step of a reduced model, for its linear response."""

    @property
    def mechanics_solver(self) -> LoopMechanics:
        """The mechanics, which every complete step solver has."""
        assert self.mechanics is not None
        return self.mechanics

    def with_equations(self, whole: Reduced) -> "BlockwiseSolver":
        """This step solver of a reduced model with all its bodies solved for together."""
        return replace(self, whole=whole, mechanics=ReducedMechanics(whole, self.tolerances))

    def start(self, state: State) -> tuple[State, Memory]:
        reduced = self.reduced(state)
        count = len(list(self.layout))
        return reduced, Memory(
            past=Predictor(self.points, reduced.x, block_starts(self.layout)),
            kept=KeptJacobian.empty(count),
            heat_kept={n: KeptJacobian.empty(count) for n in self.full_heat},
            factorizations=self.factorizations)

    def linear_system(self) -> LinearSystem:
        return StepSolver.linear_system(self) if self.whole is None else self.whole.linear_system()

    @property
    def leaves_mesh(self) -> bool:
        return True

    def projection(self, state: State) -> State:
        """A full-order state in the unknowns of this model."""
        return state if self.meshless else reduce_state(state, self.layout, self.dictionaries)

    def without_mesh(self) -> "BlockwiseSolver":
        """This step solver without operators and bases of the mesh's size, and with the loads of
        the consistent start at that time only."""
        bases = {n: replace(d, atoms=d.atoms[:0], offset=d.offset[:0], provenance=())
                 for n, d in self.dictionaries.items()}
        own = {f.name: getattr(self, f.name) for f in fields(BlockwiseSolver)}
        operators = {
            n: replace(t, tables=tuple(Table(p.times[:1], p.at(0.0)[None]) for p in t.tables))
            for n, t in self.operators.items()}
        return BlockwiseSolver(**{
            **own, "meshless": True, "operators": operators, "dictionaries": bases})

    def reduced(self, state: State) -> State:
        """A full-order state in the unknowns of this model, with rates of temperature,
        accelerations and multipliers that satisfy its own equations. Without dictionaries (full
        order, rigid bodies) as it is: the model's start is consistent already."""
        reduced = self.projection(state)
        reduced = replace(reduced, v=reduced.v.copy())  # without mesh it is the caller's state
        for name, at in self.heat_groups:
            if self.dictionaries and name in self.heat:  # not where atoms are selected
                reduced.v[at] = self.heat[name].start_rates(
                    reduced.x[at], reduced.v[at], reduced.t)
        if self.dictionaries:
            # s, step of the finite differences of constraint Jacobians
            scale = motion_step(self.layout, reduced.v, self.system.h)
            reduced = consistent_start(self.system, self._body_operators(), reduced, scale)
        return reduced

    def constraint_errors(self, state: State) -> tuple[FloatArray, FloatArray]:
        if not self.system.size:
            return np.zeros((0, 2)), np.zeros((0, 2))
        return constraint_errors(self.system, self._body_operators(), state)

    def _body_operators(self) -> list[ProjectedElastic | None]:
        """Projected operators of each body, None where it has no elastic block."""
        return [self.operators.get(b.elastic_name) for b in self.system.bodies]

    def solve(self, step: StepFormula, memory: Memory) -> tuple[StepOutcome, Memory]:
        outcome = self.trial_solution(step, memory)
        return (self.accepted(outcome, step, memory) if outcome.status.ok else outcome), memory

    def trial_solution(
        self, step: StepFormula, memory: Memory, guess: FloatArray | None = None
    ) -> StepOutcome:
        """Solution of a step, not yet stored as a past state of the run. It is the first that
        converges of: Newton's method with the exact Jacobian of all unknowns, in the `STEPS` steps
        after one that needed it; heat by groups, then mechanics; after a failure of the mechanics,
        that exact Jacobian. Its `iterations` are those of the mechanics, or the largest number of
        a thermal group where nothing moves.

        guess (n,): unknowns near the solution; None for the extrapolation of past states.
        """
        if self.newton is not None and memory.full_newton_steps_left:
            outcome = self._full_newton(self.newton, step, memory)
            memory.full_newton_steps_left -= 1
            if outcome.status.ok:
                return outcome
            memory.full_newton_steps_left = 0
        # unknowns of the iteration are departures d = x - free from the step's free motion
        now = StepUnknowns(
            step, memory.past.guess(step) if guess is None else guess - step.free)
        iterations = 0
        for name, at in self.heat_groups:
            status, n, detail = self._solve_heat(name, at, now, memory)
            if not status.ok:
                return now.outcome(status, n, name, detail)
            iterations = max(iterations, n)
        if self.system.bodies:
            status, iterations, block, detail = self.mechanics_solver.solve(step, now, memory)
            if self.iterative:  # a linear solver of an elastic block: its iterations are counted
                for name, count in memory.work.equations.iterations.items():
                    memory.add_linear_iterations(name, count)
            if not status.ok:
                return self._by_exact_jacobian(
                    now.outcome(status, iterations, block, detail), step, memory)
        return now.outcome(Status.DONE, iterations)

    def _solve_heat(
        self, name: str, at: slice | IntArray, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str]:
        """Solution of one thermal block, or of several that are coupled (group `name` of the
        unknowns `at`), added to the prediction `now`; returns status, number of iterations and
        details. Full-order groups (`full_heat`) are solved by the Newton loop, reduced ones by
        their `HeatBlock`, whose `active` are the numbers of the active atoms, None for all."""
        equations = self.full_heat.get(name)
        block = self.heat[name] if equations is None else None
        if block is not None and isinstance(at, slice):  # coupled blocks keep all atoms active
            now.drop_inactive_temperatures(at, block.active)
        local = bool((block or self.full_heat[name]).elements)  # such as radiation
        T, rate, bend = now.temperatures(at, local)
        if local:
            last = memory.newest[at]
            far = float(np.abs(T - last).max()) > 0.1 * float(np.abs(last).max())
            # below 0 K radiation has a second solution: start from the last temperatures instead
            if far:
                now.add_temperatures(at, None, last - T)
                T, rate, bend = now.temperatures(at)
        if block is None:
            return self._solve_heat_by_loop(name, at, now, memory)
        # linear: iterations of a linear solver; remaining: estimated error left by the iteration
        d, status, n, linear, detail, remaining, jacobian = block.solve(
            T, rate, bend, now.step.t, now.step.c2_first, memory.jacobian(name))
        now.remaining = max(now.remaining, remaining)
        if linear:
            memory.add_linear_iterations(name, linear)
        if status.ok:
            now.add_temperatures(at, block.active, d)
            memory.keep(name, jacobian)
        return status, n, detail

    def _solve_heat_by_loop(
        self, name: str, at: slice | IntArray, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str]:
        """Solution of the heat of a full-order group by the Newton loop, added to the prediction
        `now`; returns status, number of iterations and details. Departures d (n,) from the free
        motion are of all unknowns of the model, of which the loop changes those at `at`."""
        equations, loop = self.full_heat[name].working(), self.loop
        assert loop is not None
        kept = memory.heat_kept[name]
        equations.begin(now.step, now.d)
        ended = loop.solve(equations, now.step, now.d, kept, memory.newest)
        for block, count in equations.iterations.items():
            memory.add_linear_iterations(block, count)
        if ended.status.ok:
            now.remaining = max(now.remaining, ended.remaining)
            now.add_temperatures(at, None, ended.d[at] - now.d[at])
        return ended.status, ended.iterations, ended.detail

    def _by_exact_jacobian(
        self, failed: StepOutcome, step: StepFormula, memory: Memory
    ) -> StepOutcome:
        """Solution of the step by Newton's method with the exact Jacobian of all unknowns; the
        original failure `failed` if that fails, too, or if the model has no such method."""
        if self.newton is None:
            return failed
        outcome = self._full_newton(self.newton, step, memory)
        spent = failed.iterations + outcome.iterations
        if not outcome.status.ok:
            return replace(failed, iterations=spent)
        memory.full_newton_steps_left = STEPS  # so many further steps begin with it
        return replace(outcome, iterations=spent)

    def _full_newton(
        self, newton: WholeNewton, step: StepFormula, memory: Memory
    ) -> StepOutcome:
        """One step with the exact Jacobian of all unknowns, which is kept in memory.exact; the
        magnitudes of the unknowns are those of memory.kept."""
        outcome = newton.solve(step, memory.past, memory.exact, memory.kept)
        if outcome.status.ok:
            memory.full_newton_steps += 1
        return outcome

    def accepted(
        self, outcome: StepOutcome, step: StepFormula, memory: Memory
    ) -> StepOutcome:
        """The outcome, stored as a past state of the run; or a failure where values exceed their
        limits. Stored are x, its departure d from the step's free motion, which the rates give to
        more digits where they are known, and the largest magnitudes so far, to which the loops
        compare changes."""
        bad = self._beyond_limits(outcome.x)
        if bad is None:
            x, rates = outcome.x, outcome.rates
            d = x - step.free if rates is None else step.departure(x, *rates)
            memory.past.push(x, d)
            for kept in memory.heat_kept.values():
                if self.loop is not None:
                    self.loop.remember(x, d, step, kept)
            self.mechanics_solver.remember(x, d, step, memory)
        return bad or outcome

    def _beyond_limits(self, x: FloatArray) -> StepOutcome | None:
        """Failure of the first block with values that are not finite or exceed their limits; None
        if there is none."""
        y = x * self.sanity
        if y.dot(y) <= 1.0:
            return None
        return self.beyond_limits(x, [b.name for b in self.layout])

    def beyond_limits(self, x: FloatArray, blocks: Sequence[str]) -> StepOutcome | None:
        """Failure of the first of these blocks with values that are not finite or exceed their
        limits; None if there is none."""
        return next(beyond_limits(x, self.layout, self.limits, blocks), None)

    def alone(self) -> Mapping[str, FloatArray]:
        """Reduced elastic block -> (s, 2 s): response of its active coefficients to changes of
        their r1 and r2 with all other unknowns fixed: [-D^-1 D_m, -D^-1 M] projected, with the
        damping D_m."""
        return self.mechanics_solver.alone()

    def response(self, step: StepFormula, x: FloatArray) -> FloatArray | None:
        """Linear response (n, 2 n) of the solution x of a step to changes of [r1; r2]; None where
        no equations of the whole step are at hand."""
        return None if self.whole is None else linear_response(self.whole, step, x)

    def supports(self, memory: Memory) -> Mapping[str, BoolArray]:
        return memory.supports

    def linear_iterations(self, memory: Memory) -> Mapping[str, int]:
        """Block -> iterations of its linear solver since the start."""
        return memory.linear

    def counters(self, memory: Memory) -> Mapping[str, int]:
        return {"factorizations": memory.factorizations,
                "support_changes": memory.support_changes,
                "full_newton_steps": memory.full_newton_steps}


def reduce_state(
    state: State, layout: Layout, dictionaries: Mapping[str, Dictionary]
) -> State:
    """Least-squares coefficients of a full-order state and its rates on the trial bases; layout: of
    the reduced model. Blocks without a dictionary are copied."""
    if not dictionaries:
        return state
    full = layout.resized({name: len(d.offset) for name, d in dictionaries.items()})
    x, v, a = (np.zeros(layout.size) for _ in range(3))
    for b in layout:
        here, there = layout[b.name], full[b.name]
        if b.name not in dictionaries:
            x[here], v[here], a[here] = state.x[there], state.v[there], state.a[there]
            continue
        d = dictionaries[b.name]
        columns = np.stack([state.x[there] - d.offset, state.v[there], state.a[there]], axis=1)
        x[here], v[here], a[here] = least_squares_coefficients(d.atoms, columns).T
    return State(state.t, x, v, a, state.memory)


def stepper(
    model: AssembledModel, layout: Layout, dictionaries: Mapping[str, Dictionary],
    rows: Mapping[str, IntArray], heat: Mapping[str, HeatBlock], tol: Tolerances, points: int,
    factorizations: int, limits: Mapping[str, float] | None = None,
    notes: tuple[Note, ...] = (), operators: Mapping[str, ProjectedElastic] | None = None,
    facts: Facts | None = None, visited: Mapping[str, int] | None = None,
) -> BlockwiseSolver:
    """Block-wise step solver from reduced or full-order blocks, with the elements that one step
    visits.

    layout: of the unknowns of the step; rows: sampled rows of each block; heat: group -> thermal
    block; tol: of the iteration; factorizations: number made so far; limits: largest permitted
    |coefficient| of each block; facts: block -> numbers to report.
    points: number of past states to extrapolate; operators: projected elastic operators, for
    consistent initial rates; visited: elements of each thermal block's local terms, where these are
    not those of `heat`, whose keys are groups of coupled blocks.
    """
    # constant matrices were assembled once: only local terms visit elements in a step
    elements = {name: 0 for name in model.reducible()}
    elements |= visited or {name: block.elements for name, block in heat.items()}
    elements |= {n: sum(part.term.elements for part in t.local)
                 for n, t in (operators or {}).items() if t.local}
    # 1 / limit of each unknown; those without one are scaled to be caught when not finite only
    sanity = np.full(layout.size, 1e-150)
    for name, limit in (limits or {}).items():
        sanity[layout[name]] = 1.0 / limit
    separated, known = model.separated, operators or {}
    bodies = tuple(BodyStep.from_body(
        m, layout, known[m.elastic].frame if m.elastic in known else None)
                   for m in separated.moving)
    system = Mechanics(bodies, n_rigid=layout.frames.stop, algebraic=layout.algebraic,
                       targets=tuple(separated.border_targets), h=separated.step)
    return BlockwiseSolver(
        layout=layout, dictionaries=dictionaries, rows=rows, elements_touched=elements,
        system=system, heat=heat, tolerances=tol, points=points, factorizations=factorizations,
        limits=limits or {}, sanity=sanity, notes=notes, facts=facts or {}, operators=known,
        heat_groups=_heat_groups(model, layout))


def _heat_groups(model: AssembledModel, layout: Layout) -> tuple[tuple[str, slice | IntArray], ...]:
    """Name and unknowns of each group of coupled thermal blocks."""
    number = np.arange(layout.size)
    found: list[tuple[str, slice | IntArray]] = []
    for group in model.separated.heat_groups:
        ranges = [layout[b.thermal] for b in group]
        at = ranges[0] if len(group) == 1 else np.concatenate([number[r] for r in ranges])
        found.append((group_name(group), at))
    return tuple(found)
