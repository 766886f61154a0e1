"""Classes of which the step solvers and error estimators of kept reduced models are made
(`Plugin.stored_classes`)."""

from collections.abc import Sequence

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
    operators,
    reduced,
    reduced_mechanics,
    thermal_groups,
    time_tables,
)
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.compiled.stepper import CompiledStepper
from sparsemor.reducers.step.solver import Stepper
from sparsemor.reducers.step.thermal_block import CompressedHeat

CLASSES: Sequence[object] = (
    CompiledStepper, CompressedHeat, Stepper, Tolerances, frame_step.BodyStep,
    frame_step.PrescribedFactors,
    coupled_errors.CoupledErrors, coupled_errors.ReducedBlock, error_space.ErrorSpace,
    estimator.BlockErrors, estimator.ErrorModel, modal_steps.ModalSteps, reduced_states.InAtoms,
    reduced_states.InModes, reduced_states.Projected, residuals.ElasticResidual,
    residuals.HeatResidual,
    operators.TestedElastic, operators.TestedHeat, operators.TestedLocal, operators.TestMap,
    reduced.Reduced, reduced.ReducedBody, reduced.ReducedHeat,
    reduced_mechanics.Mechanics, reduced_mechanics.ReducedMechanics,
    local_copies.Coupled, thermal_groups.GroupLocal, time_tables.LoadsInTime,
    time_tables.TabulatedLoads, time_tables.TimeTable,
)
