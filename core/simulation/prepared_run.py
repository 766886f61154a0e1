"""A run that is prepared for its first step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.factorizations import Factored
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols.body import BodyShape
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.reducer import ErrorEstimator, ErrorLimit
from sparsemor.core.protocols.step_solver import StepMemory, StepSolver
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.probes import ForceReader, ProbeReader
from sparsemor.core.results.relative_error_estimates import constant_change
from sparsemor.core.scene.default_plugins import FULL_ORDER
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.run_identity import physics_of
from sparsemor.core.scene.scene import Scene
from sparsemor.core.scene.sections import Control
from sparsemor.core.simulation.blow_up import Extents
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.step_control import Judged, judged, step_of
from sparsemor.core.simulation.time_stepping import (
    FixedStep,
    full_state,
    iterate,
    problem_of,
    started,
)
from sparsemor.core.simulation.training import in_training
from sparsemor.core.status import SolveFailed


@dataclass(frozen=True, slots=True, eq=False)
class PreparedRun:
    """A run up to its first step: everything that further runs of the same model share.

    solver: step solver; start: state from which it starts, of the full-order model, or in the
    unknowns of a solver without mesh, full_start: then that of the full-order model for the
    estimator; header: of the result; probes, forces, given: what is recorded next to the unknowns;
    trained_to: end of the training run of its bases, s, if there was one. model: assembled model,
    estimator: of the error, and offline data, None where they are not at hand; own_loads: False if
    the run has other loads than that model, or controllers; extents: of the bodies, where the
    model, or the atoms of the solver, are not at hand. notes, summary, kept, changes: what is
    known, and found by checks, before the first step (`Findings`).
    """

    scene: Scene
    solver: StepSolver
    start: State
    header: RunHeader
    probes: tuple[ProbeReader, ...]
    given: Mapping[str, BodyShape]
    notes: tuple[Note, ...]
    trained_to: float | None
    model: Model | None = None
    estimator: ErrorEstimator | None = None
    offline: Offline | None = None
    own_loads: bool = True
    full_start: State | None = None
    forces: tuple[ForceReader, ...] = ()
    extents: Extents = Extents(())
    summary: Mapping[str, Any] = field(default_factory=dict)
    kept: Mapping[str, Any] = field(default_factory=dict)
    changes: Mapping[str, float] = field(default_factory=dict)

    @property
    def in_training(self) -> bool:
        """True if the run at full order is the training run."""
        return in_training(self.scene)

    @property
    def physics(self) -> str:
        """Digest of all that its full-order solution depends on."""
        return physics_of(self.scene, "run").digest()

    @property
    def constant_change(self) -> float:
        """Relative change up to which a field counts as constant."""
        return constant_change(self.scene.dump())

    def first_states(self, count: int) -> FloatArray:
        """States (M, n) of its first steps at full order, without the initial state; those before a
        step that fails. Raises SolveFailed where an operator cannot be factorized."""
        assert self.model is not None and self.offline is not None
        full, h = self.scene.using({"reducer": {"use": FULL_ORDER}}, label="full order"), (
            self.scene.time.step)
        solver: StepSolver = full.reducer.prepare(problem_of(full, self.model, self.offline))
        state, memory = started(
            solver, full.integrator, resolved_start(self.model, full.integrator, h).state)
        taken = iterate(step_of(solver, full.integrator, h), state, memory,
                        min(count, step_count(full)))
        states = [one.state.x for one in taken if one.outcome.status.ok]
        return np.stack(states) if states else np.zeros((0, len(state.x)))

    def factored(self) -> Sequence[Factored]:
        """Reports of the linear systems of the assembled model."""
        return [] if self.model is None else self.model.solvers.log

    @property
    def steps(self) -> int:
        """Number of its steps."""
        return step_count(self.scene)

    @property
    def error_limit(self) -> ErrorLimit:
        """Tolerance of its estimated error, and what follows beyond it."""
        return self.scene.reducer.error_limit

    def full_order(self, state: State) -> State:
        """A state of its step solver in full-order unknowns, without the integrator's memory."""
        return full_state(self.solver, state)

    def measured_blocks(self) -> tuple[Judged, ...]:
        """Blocks that have rates, with the norm of their unknowns and a reference size."""
        sizes = Control(tolerance=0.5)
        return tuple(judged(b, self.solver, sizes) for b in self.solver.layout.differential)

    def advanced(
        self, solver: StepSolver, h: float, state: State, memory: StepMemory, count: int
    ) -> list[State]:
        """States after up to `count` steps of h, s, with a step solver; those before one that
        fails."""
        step = FixedStep.of(self.scene.integrator, solver, h)
        return [t.state for t in iterate(step, state, memory, count) if t.outcome.status.ok]

    def solver_of(self, h: float) -> StepSolver:
        """Its step solver for steps of h, s, made of the offline data that are at hand, once for
        all runs of the model. Raises LookupError where some are not, or the reducer refuses."""
        scene, model, offline = self.scene, self.model, self.offline
        if model is None or offline is None:
            raise LookupError("model")

        def make() -> StepSolver | None:
            try:
                made: StepSolver = scene.reducer.prepare(
                    problem_of(scene, model, offline.as_computed(), h))
            except (SolveFailed, InputError, LookupError):
                return None
            return made

        tree = scene.dump()
        of = digest(tree["reducer"], tree["integrator"], scene.seed, h)
        found = model.once(("step solver", offline, of), make)
        if found is None:
            raise LookupError(f"a step solver for steps of {h:g} s")
        return found
