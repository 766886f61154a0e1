"""Classes of which the step solvers and error estimators of kept reduced models are made
(`Plugin.stored_classes`)."""

from collections.abc import Callable, Sequence
from typing import Any

from sparsemor.reducers.estimation import (
    coupled_errors,
    error_space,
    estimator,
    modal_steps,
    reduced_states,
    residuals,
)
from sparsemor.reducers.step import (
    frame_step,
    local_copies,
    projected_operators,
    reduced_equations,
    reduced_mechanics,
    thermal_groups,
    time_tables,
)
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.compiled.compiled_stepper import CompiledStepper
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.thermal_block import CompressedHeat


def _former(name: str, now: Callable[..., object], **fields: str) -> object:
    """Reader of objects whose class had the name `module:class` when they were stored. fields:
    former name of a field -> its name now."""
    def read(**values: Any) -> object:
        return now(**{fields.get(n, n): value for n, value in values.items()})

    read.__module__, _, read.__qualname__ = name.partition(":")
    return read


_STEP = "sparsemor.reducers.step."
CLASSES: Sequence[object] = (
    CompiledStepper, CompressedHeat, BlockwiseSolver, Tolerances, frame_step.BodyStep,
    frame_step.PrescribedFactors,
    coupled_errors.CoupledErrors, coupled_errors.ReducedBlock, error_space.ErrorSpace,
    estimator.BlockErrors, estimator.ErrorModel, modal_steps.ModalSteps, reduced_states.InAtoms,
    reduced_states.InModes, reduced_states.Projected, residuals.ElasticResidual,
    residuals.HeatResidual,
    projected_operators.ProjectedElastic, projected_operators.ProjectedHeat,
    projected_operators.ProjectedLocal, projected_operators.TestMap,
    reduced_equations.Reduced, reduced_equations.BodyRows, reduced_equations.HeatRows,
    reduced_mechanics.Mechanics, reduced_mechanics.ReducedMechanics,
    local_copies.Coupled, thermal_groups.GroupLocal, time_tables.LoadsInTime,
    time_tables.TabulatedLoads, time_tables.TimeTable,
    _former(_STEP + "blockwise_solver:Stepper", BlockwiseSolver, tested="operators"),
    _former(_STEP + "projected_operators:TestedElastic", projected_operators.ProjectedElastic),
    _former(_STEP + "projected_operators:TestedHeat", projected_operators.ProjectedHeat),
    _former(_STEP + "projected_operators:TestedLocal", projected_operators.ProjectedLocal),
    _former(_STEP + "reduced_equations:ReducedBody", reduced_equations.BodyRows,
            tested="operators", drive="factors"),
    _former(_STEP + "reduced_equations:ReducedHeat", reduced_equations.HeatRows,
            tested="operators"),
)
