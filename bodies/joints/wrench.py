"""Wrench of a joint in space: force and moment of the multipliers on each side.

Multipliers mean what the joint's conditions were built for, and a joint of rigid bodies has fewer
of them than one of the same bodies when they deform. Force and moment about the mean point of a
side are what both have in common, so these are what a rigid stage passes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sparsemor.bodies.frames.constraints import Wrench
from sparsemor.bodies.frames.items import Holding, Item
from sparsemor.core import FloatArray, InputError
from sparsemor.core.protocols.poses import placed

if TYPE_CHECKING:
    from sparsemor.bodies.joints.space_part import Condition, SpaceJoint

SIZE = 6
"""Force (3), N, and moment (3), N m, of one side."""


def wrenches(
    joint: SpaceJoint, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
) -> FloatArray:
    """(T, 6 s): force (N) on each of the s sides and moment (N m) about its mean point, in space
    axes and with the sign of the equations' left sides; multipliers (T, l), poses (T, n) of bodies
    that move.
    """
    bodies = [side.body for side in joint.sides if side.body is not None]
    motion = {b.name: poses.get(b.name, b.pose[None]) for b in bodies}
    of = {b.name: i for i, b in enumerate(bodies)}
    found = np.zeros((len(bodies), 2, len(times), 3))
    for c in joint.conditions:
        if c.body.name not in of:
            continue  # a frame between two flexible sides, whose weld acts on them
        force, moment, reach = _own(c, times, multipliers @ c.C, motion[c.body.name], poses)
        found[of[c.body.name]] += force, moment
        if reach is None or joint.adjusted:
            continue
        for name, i in of.items():
            if name != c.body.name:
                found[i] -= _other(joint, i, force, moment, reach, motion)
    return found.transpose(2, 0, 1, 3).reshape(len(times), -1)


def _own(
    c: Condition, times: FloatArray, lam: FloatArray, pose: FloatArray,
    poses: Mapping[str, FloatArray],
) -> Wrench:
    """On the own side of a condition; lam (T, forces)."""
    other = poses[c.other] if c.other else None
    return holding(c.item).wrench(times, lam, pose, other)


def holding(item: Item) -> Holding:
    """The item of a joint. InputError for one without `wrench`."""
    if isinstance(item, Holding):
        return item
    raise InputError(
        f"its item {type(item).__name__} has no method `wrench`, so what it does to its bodies "
        "cannot be passed on by a rigid stage: give it that method (bodies/frames/items.py, "
        "`Holding`), or drop rigid_stage")


def _other(
    joint: SpaceJoint, side: int, force: FloatArray, moment: FloatArray, reach: FloatArray,
    motion: Mapping[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Force and moment about its mean point that a side answers with: a force at `reach`."""
    body = joint.sides[side].body
    assert body is not None
    mean = joint.sides[side].mean() @ body.X
    pose = motion[body.name]
    arm = reach - placed(pose, np.broadcast_to(mean, (len(pose), 3)))
    return force, moment + np.cross(arm, force)
