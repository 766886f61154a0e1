"""The extension API: `from sparsemor.core import ...`, at most 120 names, and its other modules."""

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest

from public_names import MODULES
from sparsemor import bodies, core, reducers

MOST = 120
"""Names of sparsemor.core: what every plugin needs, and no more."""
PAGE = Path(__file__).parents[3] / "docs" / "reference" / "modules.md"
NAMES = {a.asname for n in ast.parse(Path(core.__file__).read_text(encoding="utf-8")).body
         if isinstance(n, ast.ImportFrom) for a in n.names}


def test_the_api_is_small() -> None:
    assert None not in NAMES and len(NAMES) <= MOST


@pytest.mark.parametrize("name", sorted(map(str, NAMES)))
def test_each_name_is_there(name: str) -> None:
    assert getattr(core, name) is not None


def test_the_page_lists_the_other_modules() -> None:
    listed = set(re.findall(r"(?m)^\| `(sparsemor\.[\w.]+)` \|", PAGE.read_text("utf-8")))
    assert listed == MODULES
    assert all(import_module(m).__doc__ for m in MODULES)


BODIES = {
    "BODY_KINDS", "Between", "Conditions", "DenseTerm", "Drive", "ELASTIC", "FieldInertia",
    "FloatingBody", "ForceElement", "Isotropic", "JointPart", "LoadPart", "MULTIPLIER",
    "MassProperties", "NumberOrFunction", "Place", "PlanePart", "PointwiseLaw", "Pose", "RIGID",
    "Relative", "Response", "RigidItem", "Side", "SpringItem", "TEMPERATURE", "TEMPERATURE_RATE",
    "THERMAL", "Target", "Variable", "amplitude", "components", "conditions_between",
    "conditions_on", "constant", "curve_at", "displacement_gradient", "find_body", "find_place",
    "find_surfaces", "find_target", "inertia_matrices", "need_field", "need_motion", "numbers_of",
    "temperature_gradient", "write_frame", "write_point_force", "write_weight",
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
