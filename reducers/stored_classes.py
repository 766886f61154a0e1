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

CLASSES: Sequence[object] = (
    CompiledStepper, CompressedHeat, BlockwiseSolver, Tolerances, frame_step.BodyStep,
    frame_step.PrescribedFactors,
    coupled_errors.CoupledErrors, coupled_errors.ReducedBlock, error_space.ErrorSpace,
    estimator.BlockErrors, estimator.BlockSteps, estimator.ErrorModel, modal_steps.ModalSteps,
    reduced_states.InAtoms, reduced_states.InModes, reduced_states.Projected,
    residuals.ElasticResidual, residuals.HeatResidual,
    projected_operators.ProjectedElastic, projected_operators.ProjectedHeat,
    projected_operators.ProjectedLocal, projected_operators.TestMap,
    reduced_equations.Reduced, reduced_equations.BodyRows, reduced_equations.HeatRows,
    reduced_mechanics.Mechanics, reduced_mechanics.ReducedMechanics,
    local_copies.Coupled, thermal_groups.GroupLocal, time_tables.LoadsInTime,
    time_tables.TabulatedLoads, time_tables.TimeTable,
)
