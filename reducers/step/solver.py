"""Block-wise solution of a step: heat first, then mechanics. Shared by all reducers.

Temperatures act on displacements, but not the reverse, so that each thermal block is solved before
(thermal_block.py; blocks that conduct to each other together, by the Newton loop). Mechanics are
all elastic blocks with rigid coordinates and joint forces (newton_loop.py).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from sparsemor.core import (
    BoolArray,
    Dictionary,
    FloatArray,
    Frame,
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
from sparsemor.core.linalg.least_squares import least_squares_coefficients
from sparsemor.core.model.constraint_rates import motion_step
from sparsemor.core.protocols import LinearSystem, MovingBody, Separated
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.blocks.thermal_block import HeatBlock
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.initial import StartTimes, consistent_start, constraint_errors
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.newton_loop import Kept, Loop, StepEquations
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.predictor import Past, block_starts
from sparsemor.reducers.step.reduced import Reduced
from sparsemor.reducers.step.reduced_mechanics import LoopMechanics, Mechanics, ReducedMechanics
from sparsemor.reducers.step.step_unknowns import StepUnknowns
from sparsemor.reducers.step.whole_step import WholeNewton, linear_response

STEPS = 10
"""Number of steps after one that needed the exact Jacobian before the cheaper iteration is tried
again."""
Facts = Mapping[str, Mapping[str, float | int | str]]
"""Block name -> numbers to report."""


@dataclass(frozen=True, slots=True, eq=False)
class Stepper(StepSolver[Memory]):
    """Block-wise step solver: heat first, then mechanics.

    limits: largest permitted |coefficient| of each block; sanity (n,): the inverse for each
    unknown, so that one product shows that all are within. heat: block name -> its rows in a step;
    tested: elastic block -> projected operators. points: number of past states that are
    extrapolated.
    """

    layout: Layout
    dictionaries: Mapping[str, Dictionary]
    rows: Mapping[str, IntArray]
    elements_touched: Mapping[str, int]
    separated: Separated
    heat: Mapping[str, HeatBlock]
    frames: Mapping[str, Frame]
    tolerances: Tolerances
    points: int
    factorizations: int
    limits: Mapping[str, float] = field(default_factory=dict)
    sanity: FloatArray = field(default_factory=lambda: np.zeros(0))
    notes: tuple[Note, ...] = ()
    facts: Facts = field(default_factory=dict)
    tested: Mapping[str, TestedElastic] = field(default_factory=dict)
    mechanics: Mechanics | None = None
    iterating: bool = False
    """True if any elastic block has an iterative linear solver."""
    hot: tuple[tuple[str, slice | IntArray], ...] = ()
    """Name and unknowns of each thermal block, or of several that are solved together."""
    meshless: bool = False
    """True if `start` takes a state in the reduced unknowns."""
    newton: WholeNewton | None = None
    """The whole step with its exact Jacobian, where the mechanics do not converge."""
    warming: Mapping[str, StepEquations] = field(default_factory=dict)
    """Equations of the heat of each group of coupled bodies that is solved for by the loop."""
    loop: Loop | None = None
    whole: Reduced | None = None
    """Equations of the whole step of a reduced model, for its linear response."""

    @property
    def solved(self) -> LoopMechanics:
        """The mechanics with equations."""
        assert isinstance(self.mechanics, LoopMechanics)
        return self.mechanics

    def by_loop(self, equations: StepEquations) -> Mechanics:
        """The mechanics with these equations, solved by the loop."""
        m = self.mechanics
        assert m is not None
        return LoopMechanics(
            m.bodies, m.n_rigid, m.algebraic, m.targets, m.tol, equations)

    def with_equations(self, whole: Reduced) -> "Stepper":
        """This step solver of a reduced model with all its bodies solved for together."""
        m = self.mechanics
        if m is None:
            return replace(self, whole=whole)
        return replace(self, whole=whole, mechanics=ReducedMechanics(
            m.bodies, m.n_rigid, m.algebraic, m.targets, m.tol, whole))

    def start(self, state: State) -> tuple[State, Memory]:
        reduced = self.reduced(state)
        count = len(list(self.layout))
        return reduced, Memory(
            past=Past(self.points, reduced.x, block_starts(self.layout)),
            kept=Kept.of(count), warming={n: Kept.of(count) for n in self.warming},
            factorizations=self.factorizations)

    def linear_system(self) -> LinearSystem:
        return StepSolver.linear_system(self) if self.whole is None else self.whole.linear_system()

    @property
    def leaves_mesh(self) -> bool:
        return True

    def projection(self, state: State) -> State:
        """A full-order state in the unknowns of this model."""
        return state if self.meshless else reduce_state(state, self.layout, self.dictionaries)

    def without_mesh(self) -> "Stepper":
        """This step solver without operators and bases of the mesh's size, and with the loads of
        the consistent start at that time only."""
        moving = tuple(replace(m, operators=None) for m in self.separated.moving)
        bases = {n: replace(d, atoms=d.atoms[:0], offset=d.offset[:0], provenance=())
                 for n, d in self.dictionaries.items()}
        own = {f.name: getattr(self, f.name) for f in fields(Stepper)}
        tested = {n: replace(t, tables=tuple(Table(p.times[:1], p.at(0.0)[None]) for p in t.tables))
                  for n, t in self.tested.items()}
        separated = replace(self.separated, moving=moving, heat=(), couplings=(), other=())
        return Stepper(**{**own, "meshless": True, "tested": tested, "dictionaries": bases,
                          "separated": separated})

    def reduced(self, state: State) -> State:
        """A full-order state in the unknowns of this model, with consistent rates."""
        reduced = self.projection(state)
        reduced = replace(reduced, v=reduced.v.copy())  # without mesh it is the caller's state
        for name, at in self.hot:
            if self.dictionaries and name in self.heat:  # not where atoms are selected
                reduced.v[at] = self.heat[name].start_rates(
                    reduced.x[at], reduced.v[at], reduced.t)
        if self.dictionaries and self.mechanics is not None:
            tested = [self.tested.get(b.elastic_name) for b in self.mechanics.bodies]
            h = self.separated.step
            scales = StartTimes(h, motion_step(self.layout, reduced.v, h))
            reduced = consistent_start(self.mechanics, tested, reduced, scales)
        return reduced

    def constraint_errors(self, state: State) -> tuple[FloatArray, FloatArray]:
        if self.mechanics is None or not self.mechanics.size:
            return np.zeros((0, 2)), np.zeros((0, 2))
        tested = [self.tested.get(b.elastic_name) for b in self.mechanics.bodies]
        return constraint_errors(self.mechanics, tested, state, self.separated.step)

    def solve(self, step: StepFormula, memory: Memory) -> tuple[StepOutcome, Memory]:
        outcome = self.tried(step, memory)
        return (self.accepted(outcome, step, memory) if outcome.status.ok else outcome), memory

    def tried(
        self, step: StepFormula, memory: Memory, guess: FloatArray | None = None
    ) -> StepOutcome:
        """Solution of a step, not yet stored as a past state of the run.

        guess (n,): unknowns near the solution; None for the extrapolation of past states.
        """
        if self.newton is not None and memory.full_newton_next:
            outcome = self._full_newton(self.newton, step, memory)
            memory.full_newton_next -= 1
            if outcome.status.ok:
                return outcome
            memory.full_newton_next = 0
        now = StepUnknowns(
            step, memory.past.guess(step) if guess is None else guess - step.free)
        iterations = 0
        for name, at in self.hot:
            status, n, detail = self._solve_heat(name, at, now, memory)
            if not status.ok:
                return now.outcome(status, n, name, detail)
            iterations = max(iterations, n)
        if self.mechanics is not None and self.mechanics.bodies:
            status, iterations, block, detail = self.solved.solve(step, now, memory)
            if self.iterating:
                for name, count in memory.work.equations.iterations.items():
                    memory.counted(name, count)
            if not status.ok:
                return self._by_exact_jacobian(
                    now.outcome(status, iterations, block, detail), step, memory)
        return now.outcome(Status.DONE, iterations)

    def _solve_heat(
        self, name: str, at: slice | IntArray, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str]:
        """Solves one thermal block, or several that are coupled, in place; returns status, number
        of iterations and details."""
        equations = self.warming.get(name)
        block = self.heat[name] if equations is None else None
        if block is not None and isinstance(at, slice):
            now.drop_inactive_temperatures(at, block.active)
        if (block or self.warming[name]).elements:
            last = memory.newest[at]
            far = float(np.abs(now.x[at] - last).max()) > 0.1 * float(np.abs(last).max())
            if far:  # below 0 K radiation has a second solution
                now.add_temperatures(at, None, last - now.x[at])
        if block is None:
            return self._solve_heat_by_loop(name, at, now, memory)
        d, status, n, linear, detail, remaining, jacobian = block.solve(
            now.x[at], now.v[at], now.a[at], now.step.t, now.step.c2_first, memory.jacobian(name))
        now.remaining = max(now.remaining, remaining)
        if linear:
            memory.counted(name, linear)
        if status.ok:
            now.add_temperatures(at, block.active, d)
            memory.keep(name, jacobian)
        return status, n, detail

    def _solve_heat_by_loop(
        self, name: str, at: slice | IntArray, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str]:
        """Solves the heat of a group by the loop, in place."""
        equations, loop = self.warming[name].working(), self.loop
        assert loop is not None
        kept = memory.warming[name]
        equations.begin(now.step, now.d)
        ended = loop.solve(equations, now.step, now.d, kept, memory.newest)
        for block, count in equations.iterations.items():
            memory.counted(block, count)
        if ended.status.ok:
            now.remaining = max(now.remaining, ended.remaining)
            now.add_temperatures(at, None, ended.d[at] - now.d[at])
        return ended.status, ended.iterations, ended.detail

    def _by_exact_jacobian(
        self, failed: StepOutcome, step: StepFormula, memory: Memory
    ) -> StepOutcome:
        """Solution of the step by Newton's method with the exact Jacobian; the original failure if
        that fails, too."""
        if self.newton is None:
            return failed
        outcome = self._full_newton(self.newton, step, memory)
        spent = failed.iterations + outcome.iterations
        if not outcome.status.ok:
            return replace(failed, iterations=spent)
        memory.full_newton_next = STEPS
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
        limits."""
        bad = self._beyond_limits(outcome.x)
        if bad is None:
            x, rates = outcome.x, outcome.rates
            d = x - step.free if rates is None else step.departure(x, *rates)
            memory.past.push(x, d)
            for kept in memory.warming.values():
                if self.loop is not None:
                    self.loop.remember(x, d, step, kept)
            self.solved.remember(x, d, step, memory)
        return bad or outcome

    def _beyond_limits(self, x: FloatArray) -> StepOutcome | None:
        """Failure of the first block with values that are not finite or exceed their limits; None
        if there is none."""
        y = x * self.sanity
        if y.dot(y) <= 1.0:
            return None
        found = (self.beyond_limits(x, b.name) for b in self.layout)
        return next((bad for bad in found if bad is not None), None)

    def beyond_limits(self, x: FloatArray, block: str) -> StepOutcome | None:
        """Failure of one block with values that are not finite or exceed their limits; None if
        there is none."""
        top = float(np.abs(x[self.layout[block]]).max())
        if not top < np.inf:
            return StepOutcome(x, Status.NOT_FINITE, 1, block)
        limit = self.limits.get(block, np.inf)
        if top > limit:
            detail = f"largest coefficient {top:.3g}, {limit:.3g} allowed"
            return StepOutcome(x, Status.DIVERGED, 1, block, detail)
        return None

    def alone(self) -> Mapping[str, FloatArray]:
        """Reduced elastic block -> (s, 2 s): response of its active coefficients to changes of
        their r1 and r2 with all other unknowns fixed: [-D^-1 D_m, -D^-1 M] projected, with the
        damping D_m."""
        return self.solved.alone()

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


def bodies(s: Stepper) -> Sequence[BodyStep]:
    none, found = slice(0, 0), []
    for m in s.separated.moving:
        found.append(BodyStep(
            m.name, s.frames.get(m.name, m.frame), m.to_border, m.origin,
            s.layout[m.elastic] if m.elastic else none,
            s.layout[m.thermal] if m.thermal in s.layout else none, m.elastic, m.guide,
            rigid_block(s.layout, m)))
    return found


def rigid_block(layout: Layout, body: MovingBody) -> str:
    """Name of the block of a body's rigid coordinates, "" where its frame has no unknowns."""
    used = body.to_border[: body.frame.rigid_size, : layout.frames.stop].any(axis=0)
    return ", ".join(layout.containing(np.flatnonzero(used)))


def reduce_state(
    state: State, layout: Layout, dictionaries: Mapping[str, Dictionary]
) -> State:
    """Least-squares coefficients of a full-order state and its rates on the trial bases."""
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
