"""Options of a step's solution, common to the reducers."""

from pydantic import Field

from sparsemor.core import Plugin, ReducedProblem, StepSolver
from sparsemor.reducers.estimation.build import error_model
from sparsemor.reducers.estimation.estimator import ErrorModel
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.compiled.stepper import Compiled


class StepOptions(Plugin):
    """Options of a step's solution: predictor, tolerance, compilation."""

    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Tolerance of a step's iteration: estimated relative error of the unknowns."""
    max_iterations: int = Field(default=30, ge=1)
    """Largest number of Newton iterations in a step; the step fails beyond."""
    compiled: Compiled = "auto"
    """Compile the time step to machine code with numba (`pip install 'sparsemor[fast]'`): `on`,
    `off`, or `auto`, which is on in runs of at least 200 000 steps if numba is installed. It covers
    rigid bodies and reduced flexible ones, in the plane and in space, without contact in the step.
    Other models, steps that converge slowly, adaptive steps and steps with rows drawn again are
    solved without it."""

    @property
    def tolerances(self) -> Tolerances:
        return Tolerances(self.remaining, self.max_iterations)


class ReducedStepOptions(StepOptions):
    """Options of a step's solution in a reduced model."""

    error_estimate: int = Field(default=0, ge=0)
    """Number of steps from one estimate of each block's error to the next; 0: none. The estimate
    solves the equation of the error in a space of its own, without the full-order run."""

    def error_estimator(self, problem: ReducedProblem, solver: StepSolver) -> ErrorModel | None:
        """Estimator of the errors of runs of `solver`, None without the option."""
        return error_model(problem, solver, self.error_estimate) if self.error_estimate else None
