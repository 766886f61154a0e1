"""Extension API: everything that the author of a plugin needs, in one import line.

    from sparsemor.core import BlockData, Dictionary, InputError, Plugin

Names are imported on first use, so that importing the package stays fast. The module that defines a
name may change; the name here does not: tests/laws/project/test_extension_api.py lists them all.
Law checks of a plugin (tests that it satisfies its interface) are in `sparsemor.core.testing`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.core.arrays import BoolArray as BoolArray
    from sparsemor.core.arrays import Csr as Csr
    from sparsemor.core.arrays import FloatArray as FloatArray
    from sparsemor.core.arrays import IntArray as IntArray
    from sparsemor.core.errors import Fault as Fault
    from sparsemor.core.errors import Gather as Gather
    from sparsemor.core.errors import InputError as InputError
    from sparsemor.core.linalg.coherence import coherence as coherence
    from sparsemor.core.linalg.coherence import condition_number as condition_number
    from sparsemor.core.linalg.coherence import oriented_unit_columns as oriented_unit_columns
    from sparsemor.core.linalg.coherence import unit_columns as unit_columns
    from sparsemor.core.linalg.column_subsets import ColumnSubsets as ColumnSubsets
    from sparsemor.core.linalg.column_subsets import pseudo_inverse as pseudo_inverse
    from sparsemor.core.linalg.factorized import Solved as Solved
    from sparsemor.core.linalg.factorized import is_vector_field as is_vector_field
    from sparsemor.core.linalg.factorized import not_solved as not_solved
    from sparsemor.core.linalg.factorized import rigid_motions as rigid_motions
    from sparsemor.core.linalg.factorized import solved_directly as solved_directly
    from sparsemor.core.linalg.factorized import unsuitable_matrix as unsuitable_matrix
    from sparsemor.core.linalg.least_squares import (
        least_squares_coefficients as least_squares_coefficients,
    )
    from sparsemor.core.linalg.least_squares import orthonormal as orthonormal
    from sparsemor.core.linalg.nested_dissection import dissect as dissect
    from sparsemor.core.linalg.nested_dissection import factor_entries as factor_entries
    from sparsemor.core.linalg.snapshots import column_chunks as column_chunks
    from sparsemor.core.linalg.snapshots import needs_chunks as needs_chunks
    from sparsemor.core.linalg.svd import svd as svd
    from sparsemor.core.linalg.threads import limit_loaded_libraries as limit_loaded_libraries
    from sparsemor.core.model.assembled_term import AssembledTerm as AssembledTerm
    from sparsemor.core.model.assembly import mentioned as mentioned
    from sparsemor.core.model.block_patterns import matched_option as matched_option
    from sparsemor.core.model.block_patterns import unmatched_patterns as unmatched_patterns
    from sparsemor.core.model.compressed_local import CompressedLocal as CompressedLocal
    from sparsemor.core.model.constraint_rates import (
        derivative_along_motion as derivative_along_motion,
    )
    from sparsemor.core.model.constraint_rates import motion_step as motion_step
    from sparsemor.core.model.equations import rate_factors as rate_factors
    from sparsemor.core.model.equations import system_jacobian as system_jacobian
    from sparsemor.core.model.equations import system_residual as system_residual
    from sparsemor.core.model.expected_states import expected_states as expected_states
    from sparsemor.core.model.facets import cell_facets as cell_facets
    from sparsemor.core.model.facets import facet_numbers as facet_numbers
    from sparsemor.core.model.facets import group_equal_rows as group_equal_rows
    from sparsemor.core.model.facets import outer_facets as outer_facets
    from sparsemor.core.model.factorizations import BlockSolvers as BlockSolvers
    from sparsemor.core.model.factorizations import solve_or_fail as solve_or_fail
    from sparsemor.core.model.factorizations import unconverged_note as unconverged_note
    from sparsemor.core.model.fitting_bases import fitted_bases as fitted_bases
    from sparsemor.core.model.initial_state import consistent_state as consistent_state
    from sparsemor.core.model.linear_equations import LinearEquations as LinearEquations
    from sparsemor.core.model.linear_equations import TabledEquations as TabledEquations
    from sparsemor.core.model.linearized_term import Linearized as Linearized
    from sparsemor.core.model.linearized_term import linearization as linearization
    from sparsemor.core.model.model import Model as Model
    from sparsemor.core.model.model import distinct_names as distinct_names
    from sparsemor.core.model.moving_loads import loaded_columns as loaded_columns
    from sparsemor.core.model.points_outside import outside_box_notes as outside_box_notes
    from sparsemor.core.notes import Level as Level
    from sparsemor.core.notes import Note as Note
    from sparsemor.core.notes import information as information
    from sparsemor.core.protocols import *
    from sparsemor.core.protocols.integrator import advanced as advanced
    from sparsemor.core.protocols.integrator import differences as differences
    from sparsemor.core.protocols.integrator import next_time as next_time
    from sparsemor.core.protocols.integrator import same_time as same_time
    from sparsemor.core.protocols.integrator import second_difference as second_difference
    from sparsemor.core.protocols.integrator import settled as settled
    from sparsemor.core.protocols.integrator import step_formula as step_formula
    from sparsemor.core.protocols.layout import joints_with_forces as joints_with_forces
    from sparsemor.core.protocols.load_tables import projected_tables as projected_tables
    from sparsemor.core.protocols.load_tables import total_load as total_load
    from sparsemor.core.protocols.load_tables import total_load_along as total_load_along
    from sparsemor.core.protocols.poses import FREE_POSE as FREE_POSE
    from sparsemor.core.protocols.poses import PLANAR_POSE as PLANAR_POSE
    from sparsemor.core.protocols.poses import SPINNING_POSE as SPINNING_POSE
    from sparsemor.core.protocols.poses import points_in_space as points_in_space
    from sparsemor.core.protocols.poses import vectors_in_space as vectors_in_space
    from sparsemor.core.protocols.prescribed_quantities import (
        derivative_from_right as derivative_from_right,
    )
    from sparsemor.core.protocols.prescribed_quantities import time_derivatives as time_derivatives
    from sparsemor.core.protocols.separable import amplitudes_along as amplitudes_along
    from sparsemor.core.protocols.separable import evaluate_amplitudes as evaluate_amplitudes
    from sparsemor.core.protocols.sparse_solver import solver_refusal as solver_refusal
    from sparsemor.core.protocols.step_amplitude import present_step as present_step
    from sparsemor.core.protocols.step_amplitude import substep as substep
    from sparsemor.core.protocols.step_solver import resultant_sources as resultant_sources
    from sparsemor.core.protocols.step_solver import (
        unavailable_resultants as unavailable_resultants,
    )
    from sparsemor.core.protocols.turning import steered as steered
    from sparsemor.core.protocols.turning import tangent as tangent
    from sparsemor.core.registry.hooks import Observer as Observer
    from sparsemor.core.registry.hooks import RunStart as RunStart
    from sparsemor.core.registry.hooks import hookimpl as hookimpl
    from sparsemor.core.registry.optional_packages import require as require
    from sparsemor.core.registry.registry import Registry as Registry
    from sparsemor.core.registry.registry import suggestions as suggestions
    from sparsemor.core.registry.returned_values import built_dictionary as built_dictionary
    from sparsemor.core.registry.returned_values import built_weights as built_weights
    from sparsemor.core.registry.returned_values import checked_return as checked_return
    from sparsemor.core.registry.returned_values import prepared_recovery as prepared_recovery
    from sparsemor.core.registry.returned_values import sampled_rows as sampled_rows
    from sparsemor.core.registry.slot import Slot as Slot
    from sparsemor.core.registry.slot import slot_default as slot_default
    from sparsemor.core.results.error_norms import CONSTANT_CHANGE as CONSTANT_CHANGE
    from sparsemor.core.results.error_norms import estimated_errors as estimated_errors
    from sparsemor.core.results.run_result import RunResult as RunResult
    from sparsemor.core.scene.expressions import Expression as Expression
    from sparsemor.core.scene.nested import functions_of_time as functions_of_time
    from sparsemor.core.scene.scene import Scene as Scene
    from sparsemor.core.simulation.checks import Check as Check
    from sparsemor.core.simulation.checks import Findings as Findings
    from sparsemor.core.simulation.checks import OnStep as OnStep
    from sparsemor.core.simulation.kept.machine_code import MachineCode as MachineCode
    from sparsemor.core.simulation.memory.estimate import trains as trains
    from sparsemor.core.simulation.memory.limits import GIGABYTE as GIGABYTE
    from sparsemor.core.simulation.memory.limits import (
        bounded_address_space as bounded_address_space,
    )
    from sparsemor.core.simulation.memory.limits import machine_memory as machine_memory
    from sparsemor.core.simulation.offline import step_count as step_count
    from sparsemor.core.simulation.prepared_run import PreparedRun as PreparedRun
    from sparsemor.core.status import SolveFailed as SolveFailed
    from sparsemor.core.status import Status as Status

_HOMES = {
    "arrays": ("BoolArray", "Csr", "FloatArray", "IntArray"),
    "errors": ("Fault", "Gather", "InputError"),
    "linalg.coherence": ("coherence", "condition_number", "oriented_unit_columns",
        "unit_columns"),
    "linalg.column_subsets": ("ColumnSubsets", "pseudo_inverse"),
    "linalg.factorized": ("Solved", "is_vector_field", "not_solved", "rigid_motions",
        "solved_directly", "unsuitable_matrix"),
    "linalg.least_squares": ("least_squares_coefficients", "orthonormal"),
    "linalg.nested_dissection": ("dissect", "factor_entries"),
    "linalg.snapshots": ("column_chunks", "needs_chunks"),
    "linalg.svd": ("svd",),
    "linalg.threads": ("limit_loaded_libraries",),
    "model.block_patterns": ("matched_option", "unmatched_patterns"),
    "model.compressed_local": ("CompressedLocal",),
    "model.constraint_rates": ("derivative_along_motion", "motion_step"),
    "model.equations": ("rate_factors", "system_jacobian", "system_residual"),
    "model.facets": ("cell_facets", "facet_numbers", "group_equal_rows", "outer_facets"),
    "model.factorizations": ("BlockSolvers", "solve_or_fail", "unconverged_note"),
    "model.fitting_bases": ("fitted_bases",),
    "model.initial_state": ("consistent_state",),
    "model.assembled_term": ("AssembledTerm",),
    "model.assembly": ("mentioned",),
    "model.expected_states": ("expected_states",),
    "model.linear_equations": ("LinearEquations", "TabledEquations"),
    "model.model": ("Model", "distinct_names"),
    "model.points_outside": ("outside_box_notes",),
    "model.linearized_term": ("Linearized", "linearization"),
    "model.moving_loads": ("loaded_columns",),
    "notes": ("Level", "Note", "information"),
    "protocols.integrator": ("advanced", "differences", "next_time", "same_time",
        "second_difference", "settled", "step_formula"),
    "protocols.layout": ("joints_with_forces",),
    "protocols.load_tables": ("projected_tables", "total_load", "total_load_along"),
    "protocols.poses": ("FREE_POSE", "PLANAR_POSE", "SPINNING_POSE", "points_in_space",
        "vectors_in_space"),
    "protocols.prescribed_quantities": ("derivative_from_right", "time_derivatives"),
    "protocols.separable": ("amplitudes_along", "evaluate_amplitudes"),
    "protocols.sparse_solver": ("solver_refusal",),
    "protocols.step_amplitude": ("present_step", "substep"),
    "protocols.step_solver": ("resultant_sources", "unavailable_resultants"),
    "protocols.turning": ("steered", "tangent"),
    "registry.hooks": ("Observer", "RunStart", "hookimpl"),
    "registry.optional_packages": ("require",),
    "registry.registry": ("Registry", "suggestions"),
    "registry.returned_values": ("built_dictionary", "built_weights", "checked_return",
        "prepared_recovery", "sampled_rows"),
    "registry.slot": ("Slot", "slot_default"),
    "results.error_norms": ("CONSTANT_CHANGE", "estimated_errors"),
    "results.run_result": ("RunResult",),
    "scene.expressions": ("Expression",),
    "scene.nested": ("functions_of_time",),
    "scene.scene": ("Scene",),
    "simulation.checks": ("Check", "Findings", "OnStep"),
    "simulation.kept.machine_code": ("MachineCode",),
    "simulation.memory.estimate": ("trains",),
    "simulation.memory.limits": ("GIGABYTE", "bounded_address_space", "machine_memory"),
    "simulation.offline": ("step_count",),
    "simulation.prepared_run": ("PreparedRun",),
    "status": ("SolveFailed", "Status"),
}
"""Module of core -> public names that it defines; those of `protocols` are in its `__all__`."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.core.{module}"), name)
    if not name.startswith("_"):
        protocols = import_module("sparsemor.core.protocols")
        if name in protocols.__all__:
            return getattr(protocols, name)
    raise AttributeError(f"module 'sparsemor.core' has no attribute {name!r}")


def __dir__() -> list[str]:
    protocols = import_module("sparsemor.core.protocols")
    return sorted([*protocols.__all__, *(n for names in _HOMES.values() for n in names)])
