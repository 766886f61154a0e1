"""Redundant joints: constraints that depend on each other are named, and share their load."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sparsemor import load, load_model, reduce, simulate
from sparsemor.bodies import JointPart, conditions_between
from sparsemor.core import Block, Equations, Joint, JointPlugin, Part
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.redundancy import dependent_joints, in_words
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed, Status
from tiers import full


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


SAME = {
    "one": pin("a:p", "b:p")}
"""Joints with the same effect as the first redundant ones."""


@pytest.mark.parametrize(("joints", "named", "count"), [
    full({"one": pin("a:p", "b:p"), "two": pin("a:p", "b:p")}, "one and two", 2),
    full({"one": pin("a:p", "b:p"), "two": pin("a:q", "b:q")}, "one and two", 1),
    full({"weld": WELD, "pin": pin("a:q", "b:q")}, "weld and pin", 2),
    full({"one": pin("a:p", "b:p"), "two": pin("a:q", "b:q"), "three": pin("a:r", "b:r")},
         "one, two and three", 3),
])
def test_redundant_joints_are_named_and_carry_the_load(
    joints: dict[str, Any], named: str, count: int
) -> None:
    whole = scene(**joints)
    whole["time"] = {"end": 0.2, "step": 0.01}
    run = simulate(load(whole))
    follow = "follows" if count == 1 else "follow"
    assert any(n.startswith(f"the constraints of {named} depend on each other: {count} of them "
                            f"{follow} from the others") for n in run.summary["notes"])
    alone = SAME if count == 2 and "one" in joints else {"weld": WELD}
    want = simulate(load({**scene(**alone), "time": whole["time"]}))
    for body in ("a.rigid", "b.rigid"):
        np.testing.assert_allclose(run.block(body), want.block(body), atol=1e-7)
    np.testing.assert_allclose(
        run.block("base.multiplier"), want.block("base.multiplier"), atol=2e-3)


@pytest.mark.full
@pytest.mark.parametrize(("step", "integrator"), [
    (1e-2, "bdf1"), (1e-4, "bdf2"), (1e-4, {"use": "generalized_alpha", "rho_inf": 0.8})])
def test_hinges_of_a_door_share_its_weight(step: float, integrator: Any) -> None:
    """They turn it as one hinge does; one hinge has its weight and the moment of that."""
    def door(*hinges: str) -> dict[str, Any]:
        points = {"a": [-0.4, 0.0, -0.8], "b": [-0.4, 0.0, 0.8], "c": [-0.4, 0.0, 0.0],
                  "knob": [0.4, 0.0, 0.0]}
        return {
            "format": 1, "bodies": {"door": {"use": "rigid", "mass": 20.0,
                                             "inertia": [3.0, 1.0, 2.0], "points": points}},
            "joints": {h: {"use": "revolute", "between": ["ground", f"door:{h}"],
                           "axis": [0.0, 0.0, 1.0]} for h in hinges},
            "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -9.81]},
                      "push": {"use": "point_force", "on": "door:knob",
                               "force": [0.0, 30.0, 0.0]}},
            "time": {"end": 30 * step, "step": step}, "integrator": integrator}

    one = simulate(load(door("c")))
    for hinges in (("a", "b"), ("a", "b", "c")):
        run = simulate(load(door(*hinges)))
        np.testing.assert_allclose(run.block("door.rigid"), one.block("door.rigid"), atol=1e-7)
        forces = [run.block(f"{h}.multiplier") for h in hinges]
        for f in forces:
            np.testing.assert_allclose(
                f[1:, 2], -20.0 * 9.81 / len(hinges), rtol=2e-2 if step < 1e-3 else 1e-3)
        total = sum(f[1:, :3] for f in forces)
        np.testing.assert_allclose(total, one.block("c.multiplier")[1:, :3], atol=0.2)


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_redundant_joints_of_flexible_bodies_in_reduced_and_kept_models(
    dimension: int, tmp_path: Path
) -> None:
    """Two pins at one set of a flexible bar."""
    d, about = dimension, {} if dimension == 2 else {"axis": [0.0, 0.0, 1.0]}
    mesh = {"use": "rectangle", "size": [0.4, 0.04], "divisions": [8, 1]} if d == 2 else {
        "use": "block", "size": [0.4, 0.04, 0.04], "divisions": [4, 1, 1]}
    bar = {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
           "material": {"rho": 2700, "E": 7e9, "nu": 0.3}, "mesh": mesh,
           **({"thickness": 0.04} if d == 2 else {})}
    joint = {"use": "revolute", "between": ["ground", "bar:left"], **about}

    def made(reducer: Any, **joints: Any) -> Any:
        return load({
            "format": 1, "bodies": {"bar": bar}, "joints": joints,
            "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81, 0.0][:d]}},
            "probes": {"tip": {"body": "bar", "at": "right"}},
            "time": {"end": 0.2, "step": 0.002}, "integrator": "bdf2", "reducer": reducer})

    one = simulate(made("full", one=joint)).probe("tip")
    for use in ("full", "galerkin", "sparse"):
        reducer = "full" if use == "full" else {"use": use, "compiled": "off"}
        run = simulate(made(reducer, one=joint, two=joint))
        np.testing.assert_allclose(run.probe("tip"), one, atol=1e-3, err_msg=use)
        np.testing.assert_allclose(
            run.block("one.multiplier")[2:], run.block("two.multiplier")[2:], rtol=1e-2, atol=0.05)
    model = reduce(made({"use": "galerkin", "compiled": "off"}, one=joint, two=joint))
    model.save(tmp_path / "m")
    np.testing.assert_allclose(load_model(tmp_path / "m").run().probe("tip"),
                               model.run().probe("tip"), rtol=1e-9)


@pytest.mark.full
def test_forces_that_atoms_do_not_determine_are_of_least_norm_and_noted() -> None:
    """A set moves without turning, and so do all atoms learned from it: the moment that keeps it
    from turning is rounding over rounding."""
    def made(reducer: Any, **more: Any) -> Any:
        return load({
            "format": 1, **more,
            "bodies": {"bob": {"use": "rigid", "mass": 1.0, "inertia": 0.1}, "wall": {
                "use": "flexible", "mesh": {"use": "rectangle", "size": [0.4, 0.1],
                                            "divisions": [8, 2]},
                "thickness": 0.02, "material": {"E": 7.0e7, "nu": 0.3, "rho": 2000},
                "order": 1, "fields": ["elastic"], "reference": {"clamp": "left"},
                "frame": "fixed"}},
            "joints": {"shake": {
                "use": "prescribed_motion", "of": "wall:top", "angle": 0.0, "x": {
                    "use": "smooth_step", "end": 0.02, "final": 2e-4}}},
            "loads": {"weight": {"use": "gravity"}}, "probes": {
                "tip": {"body": "wall", "at": "right"}},
            "time": {"end": 0.02, "step": 5e-4}, "integrator": "bdf1", "reducer": reducer})

    full, few = simulate(made("full")), [
        simulate(made({"use": use, "compiled": "off", "basis": {"use": "pod", "count": 5}}))
        for use in ("galerkin", "deim")]
    craig = simulate(made({"use": "galerkin", "compiled": "off", "basis": "craig_bampton"}))
    moment = full.joint_forces()["shake"]["moment", "N m"]
    for run in few:
        np.testing.assert_allclose(run.probe("tip"), full.probe("tip"), atol=1e-6)
        forces = run.joint_forces()["shake"]
        assert np.abs(forces["moment", "N m"]).max() < 1e-2
        np.testing.assert_allclose(
            forces["force x", "N"][-1], full.joint_forces()["shake"]["force x", "N"][-1], rtol=0.05)
        assert sum("moment of shake: the trial" in n for n in run.summary["notes"]) == 1
    np.testing.assert_allclose(craig.joint_forces()["shake"]["moment", "N m"][5:], moment[5:],
                               rtol=0.05)
    assert not [n for n in craig.summary["notes"] if "trial spaces move" in n]
    staged = simulate(made({"use": "galerkin", "basis": {"use": "pod", "count": 5}},
                           rigid_stage={}))
    assert sum("what is stored is rounding" in n for n in staged.summary["notes"]) == 1


class Stiff(JointPlugin):
    """A joint of another package that knows no compliance."""

    between: tuple[str, str]

    def build(self, name: str, parts: Mapping[str, Part]) -> Joint:
        sides = conditions_between(name, self.between, parts)
        sides.meet()
        return Unknowing(sides.joint())


@dataclass(frozen=True, eq=False)
class Unknowing(Joint):
    part: JointPart

    @property
    def name(self) -> str:
        return self.part.name

    def blocks(self) -> Sequence[Block]:
        return self.part.blocks()

    def contribute(self, equations: Equations) -> None:
        self.part.contribute(equations)


def test_joints_that_cannot_share_a_load_are_named() -> None:
    content = load(scene(one=pin("a:p", "b:p")))
    stiff = {n: Stiff(between=("a:p", "b:p")) for n in ("two", "three")}
    changed = content.model_copy(update={"joints": {"base": content.joints["base"], **stiff}})
    with pytest.raises(SolveFailed) as caught:
        consistent_state(assemble(changed))
    assert caught.value.status is Status.SINGULAR
    assert caught.value.detail == (
        "accelerations at the start: the constraints of two and three depend on each other")


def test_a_dependency_of_near_constraints_is_round_off_only() -> None:
    """Full rank names nothing, however different the units of rows and columns are."""
    model = checked_model(load(scene(pin=pin("a:p", "b:p"))))
    consistent_state(model)
    rng = np.random.default_rng(2)
    G = np.eye(4, 30) + 1e-4 * rng.standard_normal((4, 30))
    G[1] = G[0] + 1e-4 * rng.standard_normal(30)
    assert not dependent_joints(model.layout, csr_array(1e6 * G))
    G[1] = -3e5 * G[0]
    assert list(dependent_joints(model.layout, csr_array(G))) == [("base",)]
    G[1], G[2] = rng.standard_normal(30), G[0] + G[3]
    assert list(dependent_joints(model.layout, csr_array(G))) == [("base", "pin")]


def test_many_groups_are_counted() -> None:
    groups = [(f"a{i}", f"b{i}") for i in range(5)]
    assert in_words(groups).endswith("the constraints of a2 and b2 depend on each other; and 2 "
                                     "more such groups")
    assert in_words([]) == ""
