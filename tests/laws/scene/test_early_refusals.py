"""What needs no training to be refused is refused by `validate`, before the training run."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"
SPARSE = {"use": "sparse", "budgets": {"*": {"rows": 14, "atoms": 3}}}
CASES: dict[str, tuple[dict[str, Any], str, str]] = {
    "control and rows that change": (
        {"time.control": {"tolerance": 1e-3}, "reducer": {**SPARSE, "resample": 1}},
        "time.control", "the rows of this reducer change with the steps"),
    "control and trial runs": (
        {"time.control": {"tolerance": 1e-3}, "reducer": "auto"},
        "time.control", "trial runs take fixed steps"),
    "no interface": (
        {"reducer": {"use": "galerkin", "bases": {"*.thermal": "craig_bampton"}}},
        "reducer.basis", "craig_bampton: no joint acts on the unknowns of bar.thermal"),
    "no fixed interface": (
        {"reducer": {"use": "deim", "bases": {"*.thermal": {
            "use": "modal", "interface": "fixed"}}}},
        "reducer.basis", "modal with interface: fixed: no joint acts"),
    "no moving load": (
        {"reducer": {"use": "galerkin", "bases": {"*.elastic": "attachment"}}},
        "reducer.basis", "attachment: no load moves over bar.elastic"),
    "no impulse": (
        {"reducer": {"use": "ecsw", "bases": {"*.thermal": "impulse"}}},
        "reducer.basis", "impulse: no load moves over bar.thermal"),
    "no impulse inside a dictionary": (
        {"reducer": {"use": "galerkin", "bases": {"*.thermal": {
            "use": "dictionary", "bases": ["pod", "impulse"]}}}},
        "reducer.basis", "impulse: no load moves over bar.thermal"),
    "force modes from their mean": (
        {"reducer": {"use": "deim", "force_basis": {"use": "pod", "centred": True}}},
        "reducer.force_basis", "their modes are counted from zero: take centred: false"),
    "static with snapshots": (
        {"reducer": {"use": "galerkin", "bases": {"*.elastic": {
            "use": "static", "thermal": "pod"}}}},
        "reducer.basis", "`thermal` names a basis that needs snapshots"),
}


class Started:
    """Remembers which phases of a run began."""

    def __init__(self) -> None:
        self.phases: list[str] = []

    @hookimpl
    def on_start(self, run):
        self.phases.append(run.phase)


@pytest.mark.parametrize("changes, key, message", CASES.values(), ids=list(CASES))
def test_validate_refuses_what_needs_no_training(changes, key, message, here):
    scene = load(TINY, {"time.end": 0.004, "training.end": 0.004, **changes})
    watched = Started()
    with pytest.raises(InputError) as caught:
        simulate(scene, observers=[watched])  # which checks as `validate` does
    assert [f.key for f in caught.value.faults][0] == key
    assert message in str(caught.value) and watched.phases == []


@pytest.mark.parametrize("name", ["bar.thermal", "x.elastic", "joint x", "b:left"])
def test_a_name_has_no_room_for_a_field(name):
    with pytest.raises(InputError, match="a name is made of letters, digits and _"):
        load(TINY).using({"loads": {name: {"use": "gravity"}}})


@pytest.mark.parametrize("changes", [
    {"time.control": {"tolerance": 1e-3}, "reducer": SPARSE},
    {"reducer": {**SPARSE, "resample": 1}},
    {"reducer": {"use": "galerkin", "bases": {"*.elastic": "craig_bampton"}}},
    {"reducer": {"use": "galerkin", "bases": {"*.elastic": {"use": "attachment",
                                                            "thermal": "pod"}}}},
    {"reducer": {"use": "galerkin", "bases": {"*.thermal": {"use": "static", "thermal": "pod"}}}},
])
def test_what_can_be_built_is_not_refused(changes, here):
    checked_model(load(TINY, {"time.end": 0.004, "training.end": 0.004, **changes}))
