"""Items of a spatial frame that are written elsewhere: evaluated everywhere, or refused."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.body_set import find_target
from sparsemor.bodies.frames.applied_forces import BodyForce
from sparsemor.bodies.frames.frame_items import Item
from sparsemor.bodies.frames.mean_displacement_and_rotation import with_torques
from sparsemor.bodies.frames.motion import Motion, Moved, Pushed, Sums
from sparsemor.bodies.joints.built_joint import JointPart
from sparsemor.bodies.joints.constraint_conditions import conditions_between
from sparsemor.bodies.loads.built_load import LoadPart
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core import JointPlugin, LoadPlugin, Part
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.prescribed_quantities import AtStart, Followed
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.testing.in_memory_run import march, scene_of

FORCE = np.array([0.0, 50.0, -200.0])


@dataclass(frozen=True, slots=True, eq=False)
class Silent(Item):
    """Delegates to a force that turns with the body, but for `push`."""

    force: BodyForce
    directions = 4
    others = 0

    def names(self, source: str) -> tuple[str, ...]:
        return self.force.names(source)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Silent":
        return type(self)(self.force.shifted(s, quadratic))

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        self.force.evaluate(m, j, o, k, out)


@dataclass(frozen=True, slots=True, eq=False)
class Delegate(Silent):
    """The same with `push`."""

    pushes = True

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        self.force.push(m, j, out)


class Push(LoadPlugin):
    """A force on the end of the bar through an item of its own class."""

    kind: str

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        target = find_target(parts, "bar:right", "on")
        body: Any = target.body
        force = np.outer(target.mean(), FORCE)

        def write(equations: Equations) -> None:
            item: Any = BodyForce(FORCE, target.mean() @ np.cross(body.X, FORCE), lambda t: 1.0)
            if self.kind != "own":
                item = (Delegate if self.kind == "delegate" else Silent)(item)
            equations.frame(body.name, item, with_torques(force)[body.elasticity.free])

        return LoadPart(name, write)


def bar(kind: str, frame: str) -> dict[str, Any]:
    return {
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
            "mesh": BlockMesh(size=(0.3, 0.1, 0.06), divisions=(2, 1, 1)), "frame": frame,
            "material": {"E": 5e8, "nu": 0.3, "rho": 1100}}},
        "loads": {"tip": Push(kind=kind)}, "time": {"end": 5e-3, "step": 1e-3}}


def bent(kind: str, frame: str) -> FloatArray:
    """Displacements of the bar, fixed in space or along a prescribed rotation."""
    scene = scene_of(bar(kind, frame))
    if frame == "fixed":
        return march(scene).block("bar.elastic")
    t = 1e-3 * np.arange(6)
    pose = np.zeros((6, 4))
    pose[:, 3] = 30.0 * t
    rate = np.tile([0.0, 0.0, 0.0, 30.0], (6, 1))
    history = {"bar": FrameHistory(t, pose, rate, 0 * pose)}
    model = assemble(scene, Followed(Stage(t, history, frozenset(history), {}, {}, {})))
    return march(scene, model=model).block("bar.elastic")


@pytest.mark.parametrize("frame", ["fixed", "spinning"])
def test_an_item_that_delegates_to_a_force_is_that_force(frame: str) -> None:
    want = bent("own", frame)
    assert np.abs(want).max() > 1e-5
    assert np.array_equal(bent("delegate", frame), want)


@pytest.mark.parametrize("frame", ["fixed", "spinning"])
def test_an_item_that_a_prescribed_frame_cannot_evaluate_is_refused(frame: str) -> None:
    with pytest.raises(InputError, match="loads.tip: its item Silent has no method `push`"):
        bent("silent", frame)


@dataclass(frozen=True, slots=True, eq=False)
class Plain(Item):
    """Delegates to an attachment, but for `wrench`."""

    item: Any
    directions = 3
    others = 0
    forces = 3

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(self.item.names(source))

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Plain":
        return Plain(self.item.shifted(s, quadratic))

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        self.item.evaluate(m, j, o, k, out)


class Ball(JointPlugin):
    """A spherical joint to the ground through an item of its own class."""

    of: str

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        sides = conditions_between(name, ("ground", self.of), parts)
        sides.meet()
        sides.made = [(row, replace(c, item=Plain(c.item))) for row, c in sides.made]
        return sides.joint()


def test_a_joint_item_that_a_rigid_stage_cannot_pass_on_is_refused() -> None:
    tree = bar("own", "floating")
    tree["joints"] = {"pin": Ball(of="bar:left")}
    assert march(scene_of(tree)).block("bar.elastic").any()  # without a stage it is a joint
    with pytest.raises(InputError, match=r"joints\.pin: its item Plain has no method `wrench`"):
        assemble(scene_of(tree), AtStart())  # what a scene with a stage is checked with
