"""Options common to reducers: by field (elastic, thermal), numbers of atoms, and the solution of a
step."""

from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

from pydantic import Field

from sparsemor.core import (
    Basis,
    ErrorEstimator,
    ErrorLimit,
    InputError,
    Plugin,
    ReducedProblem,
    Reducer,
    StepSolver,
)
from sparsemor.core.protocols.reducer import ErrorAction
from sparsemor.reducers.step.compiled.compiled_stepper import Compiled, expected
from sparsemor.reducers.step.convergence_test import Tolerances

T = TypeVar("T")
BASES = ("basis", "bases")
"""Options that set the trial bases of the blocks."""


def counts_atoms(basis: Basis) -> bool:
    """True if the number of atoms is an option of the basis, `count`."""
    return "count" in type(basis).model_fields


def of_field(field: str, table: Mapping[str, T]) -> T | None:
    """Entry for a field in a table by block pattern: that of `*.field`, otherwise the first entry
    whose pattern names the field or is `*`; None if there is none."""
    if f"*.{field}" in table:
        return table[f"*.{field}"]
    return next((v for p, v in table.items() if p == "*" or p.rpartition(".")[2] == field), None)


def counted(
    atoms: Mapping[str, int], basis: Basis, bases: Mapping[str, Basis]
) -> tuple[Basis, dict[str, Basis]]:
    """The shared basis and the bases by pattern, with the numbers of atoms in `atoms` (field ->
    number) where the number is an option of the basis; the shared basis gets the number of the
    first field."""
    found = dict(bases)
    for i, (field, count) in enumerate(atoms.items()):
        if i > 0:
            own = bases.get(f"*.{field}", basis)
            if counts_atoms(own):
                found[f"*.{field}"] = own.model_copy(update={"count": count})
    first = next(iter(atoms.values()), None)
    if first is None or not counts_atoms(basis):
        return basis, found
    return basis.model_copy(update={"count": first}), found


class StepOptions(Reducer):
    """Options of a step's solution: predictor, tolerance, compilation."""

    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Tolerance of a step's iteration: estimated relative error of the unknowns."""
    max_iterations: int = Field(default=30, ge=1)
    """Largest number of Newton iterations in a step; the step fails beyond."""
    compiled: Compiled = "auto"
    """Compile the time step to machine code with numba (`pip install 'sparsemor[fast]'`): `on`,
    `off`, or `auto`: if numba is installed, in runs of at least 50 000 steps, and of at least 2000
    where an earlier run has kept the machine code (the last digits may then differ from those of
    that run). It covers rigid bodies and reduced flexible ones, in the plane and in space, without
    contact in the step. Other models, models whose atoms are selected during the run, steps that
    converge slowly, adaptive steps and steps with rows drawn again are solved without it."""

    @property
    def tolerances(self) -> Tolerances:
        return Tolerances(self.remaining, self.max_iterations)


class ErrorEstimate(Plugin):
    """Estimate of the error of each block during the run, and what follows where it is large."""

    every: int = Field(ge=1)
    """Number of steps from one estimate to the next."""
    tolerance: float = Field(default=0.1, gt=0)
    """Largest estimated error of a block, relative to its largest change in the run up to then or
    in the training run, whichever is larger."""
    action: ErrorAction = "warn"
    """What follows from an estimate above the tolerance. `warn`: a warning after the run; `stop`:
    the run ends with status `inaccurate`; `fall_back`: it goes on at full order from the last state
    within the tolerance; `enrich`: full-order steps from there give new atoms, with which the
    reduced model goes on."""


class ReducedStepOptions(StepOptions):
    """Options of a step's solution in a reduced model."""

    error_estimate: Literal["auto", "on", "off"] | Annotated[int, Field(ge=0)] | ErrorEstimate = (
        "auto")
    """Estimates of each block's error, which solve the equation of the error in a space of its own,
    without the full-order run. `on`: at so many steps that they cost about 5 % of the run, more of
    them at its start, and twice as large as found, since loads that act suddenly between them may
    be missed; `auto`: the same in kept models, in `compare` and in what reducer `auto` chooses, and
    none in other runs; `off` or 0: none. A number is that of steps from one estimate to the next.
    With a tolerance and an action: `{every: 10, tolerance: 0.01, action: stop}`."""

    @property
    def error_limit(self) -> ErrorLimit:
        """Tolerance of the estimated error, and what follows beyond it."""
        chosen = self.error_estimate
        if isinstance(chosen, ErrorEstimate):
            return ErrorLimit(chosen.tolerance, chosen.action, chosen.every)
        return ErrorLimit(every=chosen) if isinstance(chosen, int) else ErrorLimit(
            at_few_steps=chosen)

    def error_estimator(self, problem: ReducedProblem, solver: StepSolver) -> ErrorEstimator | None:
        """Estimator of the errors of runs of `solver`, None without the option. Raises InputError
        for an integrator with several solves in a step, if a number of steps is asked for."""
        limit = self.error_limit
        if limit.at_few_steps == "on" or limit.at_few_steps == "auto" and problem.estimated:
            from sparsemor.reducers.estimation.estimate_interval import affordable_model

            return affordable_model(
                problem, solver, self.active_atoms, expected(self.compiled, problem.steps))
        every = limit.every
        if every and not problem.integrator.one_solve:
            raise InputError("the estimate needs an integrator with one solve a step",
                             "error_estimate")
        if not every:
            return None
        from sparsemor.reducers.estimation.error_model_assembly import error_model

        return error_model(problem, solver, every, self.active_atoms)

    def active_atoms(self, name: str, atoms: int) -> int:
        """Largest number of active ones of the `atoms` atoms of a block."""
        return atoms
