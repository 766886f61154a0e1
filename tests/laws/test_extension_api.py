"""The extension API, `from sparsemor.core import ...`: every name of it, and that it stays lazy."""

import subprocess
import sys

import pytest

from sparsemor import bodies, core, reducers
from sparsemor.core import protocols

NAMES = {
    "BoolArray", "CompressedLocal", "Csr", "Fault", "FloatArray", "Gather", "InputError",
    "IntArray", "Note", "Plugin", "Registry", "RunStart", "Slot", "SolveFailed", "Solved", "Status",
    "chosen", "hookimpl", "information", "near", "not_solved", "require", "slot_default",
    "solved_directly", "unsuitable_matrix",
}
"""Besides all contracts of `sparsemor.core.protocols`."""


def test_the_api_is_this_list() -> None:
    assert set(dir(core)) == NAMES | set(protocols.__all__)


@pytest.mark.parametrize("name", sorted(NAMES | set(protocols.__all__)))
def test_each_name_is_there(name: str) -> None:
    assert getattr(core, name) is not None


BODIES = {
    "BODY_KINDS", "Between", "Body", "Conditions", "DenseTerm", "ELASTIC", "Isotropic",
    "JointPart", "LoadPart", "MULTIPLIER", "MassProperties", "NumberOrFunction", "Pose", "RIGID",
    "THERMAL", "Target", "amplitude", "components", "conditions_between", "conditions_on",
    "constant", "find_body",
    "find_surfaces", "find_target", "need_field",
}
REDUCERS = {"Linear", "Maps", "ProjectionReducer", "Reducible", "TestMap", "left_inverse"}


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
