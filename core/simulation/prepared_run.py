"""A run that is prepared for its first step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.model.factorizations import Factored
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import (
    BodyShape,
    ErrorEstimator,
    ErrorLimit,
    ReducedProblem,
    State,
    StepMemory,
    StepSolver,
)
from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.probes import ForceReader, ProbeReader
from sparsemor.core.scene.options import Control
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.diagnostics.blow_up import Extents
from sparsemor.core.simulation.diagnostics.trial_space import TrialSpace
from sparsemor.core.simulation.error_control.notes import error_limit
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.step_control import Judged, judged
from sparsemor.core.simulation.time_stepping import FixedStep, full_state, iterate


@dataclass(frozen=True, slots=True, eq=False)
class PreparedRun:
    """A run up to its first step: everything that further runs of the same model share.

    solver: step solver; start: state from which it starts, of the full-order model, or in the
    unknowns of a solver without mesh; header: of the result; probes, forces, given: what is
    recorded next to the unknowns; notes, stability, spaces: findings before the first step;
    trained_to: end of the training run, s. model: assembled model, estimator: of the error, and
    offline data, None where they are not at hand; own_loads: False if the run has other loads than
    that model; extents: of the bodies, where the model, or the atoms of the solver, are not at
    hand.
    """

    scene: Scene
    solver: StepSolver
    start: State
    header: RunHeader
    probes: tuple[ProbeReader, ...]
    given: Mapping[str, BodyShape]
    notes: tuple[Note, ...]
    stability: Mapping[str, Any]
    spaces: tuple[TrialSpace, ...]
    trained_to: float
    model: Model | None = None
    estimator: ErrorEstimator | None = None
    offline: Offline | None = None
    own_loads: bool = True
    forces: tuple[ForceReader, ...] = ()
    extents: Extents = Extents(())

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
        return error_limit(self.scene.reducer)

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
        """Its step solver for steps of h, s, made of the offline data that are at hand. Raises
        LookupError where some are not, InputError and SolveFailed as the reducer."""
        if self.model is None or self.offline is None:
            raise LookupError("model")
        made: StepSolver = self.scene.reducer.prepare(ReducedProblem(
            self.model, self.scene.integrator, h, self.offline.as_computed(),
            np.random.default_rng(self.scene.seed)))
        return made
