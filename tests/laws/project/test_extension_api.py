"""The extension API, `from sparsemor.core import ...`: every name of it, and that it stays lazy."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from sparsemor import bodies, core, reducers
from sparsemor.core import protocols

NAMES = {
    "AssembledTerm", "Check", "Findings", "Level", "LinearEquations", "Model", "OnStep",
    "PreparedRun", "RunResult", "Scene", "TabledEquations", "differences", "estimated_errors",
    "functions_of_time", "mentioned", "settled", "step_count", "trains",
    "BlockSolvers", "BoolArray", "CONSTANT_CHANGE", "ColumnSubsets", "CompressedLocal", "Csr",
    "Expression", "FREE_POSE", "Fault", "FloatArray", "GIGABYTE", "Gather", "InputError",
    "IntArray", "Linearized", "MachineCode", "Note", "Observer", "PLANAR_POSE", "Registry",
    "RunStart", "SPINNING_POSE", "Slot", "SolveFailed", "Solved", "Status", "advanced",
    "amplitudes_along",
    "bounded_address_space", "built_dictionary", "built_weights", "cell_facets",
    "checked_return", "coherence", "column_chunks", "condition_number", "consistent_state",
    "derivative_along_motion", "derivative_from_right", "dissect", "distinct_names",
    "evaluate_amplitudes", "expected_states", "facet_numbers", "factor_entries", "fitted_bases",
    "group_equal_rows", "hookimpl", "information", "is_vector_field", "joints_with_forces",
    "least_squares_coefficients", "limit_loaded_libraries", "linearization", "loaded_columns",
    "machine_memory", "matched_option", "motion_step", "needs_chunks", "next_time", "not_solved",
    "oriented_unit_columns", "orthonormal", "outer_facets", "outside_box_notes", "points_in_space",
    "present_step", "substep",
    "prepared_recovery", "projected_tables", "pseudo_inverse", "rate_factors", "require",
    "resultant_sources", "rigid_motions", "same_time", "sampled_rows", "slot_default",
    "second_difference", "solve_or_fail",
    "solved_directly", "solver_refusal", "steered", "step_formula", "suggestions", "svd",
    "system_jacobian", "system_residual", "tangent", "time_derivatives", "total_load",
    "total_load_along", "unavailable_resultants", "unconverged_note", "unit_columns",
    "unmatched_patterns",
    "unsuitable_matrix", "vectors_in_space",
}
"""Besides all contracts of `sparsemor.core.protocols`."""


def test_the_api_is_this_list() -> None:
    assert set(dir(core)) == NAMES | set(protocols.__all__)


def test_type_checkers_see_the_same_names() -> None:
    """The imports for type checkers name what the package gives at run time."""
    block = next(n for n in ast.parse(Path(core.__file__).read_text(encoding="utf-8")).body
                 if isinstance(n, ast.If))
    imports = [(str(n.module), a.name) for n in block.body if isinstance(n, ast.ImportFrom)
               for a in n.names]
    assert imports.pop(imports.index(("sparsemor.core.protocols", "*")))
    assert {name for _, name in imports} == NAMES
    for module, name in imports:
        assert getattr(import_module(module), name) is getattr(core, name), name


@pytest.mark.parametrize("name", sorted(NAMES | set(protocols.__all__)))
def test_each_name_is_there(name: str) -> None:
    assert getattr(core, name) is not None


BODIES = {
    "BODY_KINDS", "Between", "Conditions", "DenseTerm", "Drive",
    "ELASTIC", "FloatingBody", "ForceElement", "HasLawArrays", "Isotropic", "JointPart",
    "LoadPart", "MULTIPLIER",
    "MassProperties", "NumberOrFunction", "PlanePart", "PointwiseLaw", "Pose", "RIGID",
    "Response", "RigidItem", "Side", "SpringItem", "TEMPERATURE", "TEMPERATURE_RATE", "THERMAL",
    "Target", "Variable", "amplitude", "components", "conditions_between", "conditions_on",
    "constant", "curve_at", "displacement_gradient", "find_body", "find_surfaces", "find_target",
    "need_field", "numbers_of", "temperature_gradient",
}
REDUCERS = {
    "Approximation", "ErrorModel", "Interpolating", "LinearOperators", "Maps", "Projection",
    "ProjectionReducer", "Reducible", "TestMap", "choose_points", "error_model", "force_modes",
    "force_snapshots", "projection_notes", "interpolation", "left_inverse", "modal_coordinates",
}


def test_public_names_of_bodies_and_reducers_are_these_lists() -> None:
    for package, names in ((bodies, BODIES), (reducers, REDUCERS)):
        assert set(dir(package)) == names
        assert all(getattr(package, n) is not None for n in names)
        with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
            _ = package.Nothing


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Plugn'"):
        _ = core.Plugn  # type: ignore[attr-defined]


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = ("import sparsemor.bodies, sparsemor.core, sparsemor.reducers, sys; "
            "print([m for m in ('numpy', 'pydantic') if m in sys.modules])")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
