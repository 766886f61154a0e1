"""Redundant joints: a run whose constraints depend on each other names the joints."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sparsemor import load, simulate
from sparsemor.core.model.initial_state import consistent_state, dependent_joints, in_words
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed, Status


def pin(one: str, other: str) -> dict[str, Any]:
    return {"use": "revolute", "between": [one, other]}


def scene(**joints: Any) -> dict[str, Any]:
    """Two rigid bodies in the plane, the first one on a pin; other joints between them."""
    return {
        "format": 1,
        "bodies": {
            "a": {"use": "rigid", "mass": 1.0, "inertia": 0.1,
                  "points": {"p": [0.3, 0.1], "q": [0.7, -0.2], "r": [1.0, 0.37]}},
            "b": {"use": "rigid", "mass": 2.0, "inertia": 0.2, "pose": {"position": [0.3, 0.1]},
                  "points": {"p": [0.0, 0.0], "q": [0.4, -0.3], "r": [0.7, 0.27]}}},
        "joints": {"base": pin("ground", "a:r"), **joints},
        "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": 0.02, "step": 0.01}, "integrator": "bdf1", "reducer": "full"}


WELD = {"use": "fixed", "between": ["a:p", "b:p"]}


@pytest.mark.parametrize(("joints", "named"), [
    ({"one": pin("a:p", "b:p"), "two": pin("a:p", "b:p")}, "one and two"),
    ({"one": pin("a:p", "b:p"), "two": pin("a:q", "b:q")}, "one and two"),
    ({"weld": WELD, "pin": pin("a:q", "b:q")}, "weld and pin"),
    ({"one": pin("a:p", "b:p"), "two": pin("a:q", "b:q"), "three": pin("a:r", "b:r")},
     "one, two and three"),
])
def test_redundant_joints_are_named(joints: dict[str, Any], named: str) -> None:
    with pytest.raises(SolveFailed) as caught:
        simulate(load(scene(**joints)))
    assert caught.value.status is Status.SINGULAR
    assert caught.value.detail == (
        f"accelerations at the start: the constraints of {named} depend on each other")


def test_groups_are_named_apart() -> None:
    with pytest.raises(SolveFailed) as caught:
        simulate(load(scene(second=pin("ground", "a:r"), weld=WELD, pin=pin("a:q", "b:q"))))
    assert caught.value.detail.endswith(
        ": the constraints of base and second depend on each other; "
        "the constraints of weld and pin depend on each other")


def test_a_dependency_of_near_constraints_is_round_off_only() -> None:
    """Full rank names nothing, however different the units of rows and columns are."""
    model = checked_model(load(scene(pin=pin("a:p", "b:p"))))
    consistent_state(model)
    rng = np.random.default_rng(2)
    G = np.eye(4, 30) + 1e-4 * rng.standard_normal((4, 30))
    G[1] = G[0] + 1e-4 * rng.standard_normal(30)
    assert dependent_joints(model.layout, csr_array(1e6 * G)) == []
    G[1] = -3e5 * G[0]
    assert dependent_joints(model.layout, csr_array(G)) == [("base",)]
    G[1], G[2] = rng.standard_normal(30), G[0] + G[3]
    assert dependent_joints(model.layout, csr_array(G)) == [("base", "pin")]


def test_many_groups_are_counted() -> None:
    groups = [(f"a{i}", f"b{i}") for i in range(5)]
    assert in_words(groups).endswith("the constraints of a2 and b2 depend on each other; and 2 "
                                     "more such groups")
    assert in_words([]) == ""
