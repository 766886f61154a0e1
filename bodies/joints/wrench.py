"""What the multipliers of a joint in space do to each of its sides: a force and a moment.

Multipliers mean what the joint's conditions were built for, and a joint of rigid bodies has fewer
of them than one of the same bodies when they deform. Force and moment about the mean point of a
side are what both have in common, so these are what a rigid stage hands on.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sparsemor.bodies.spatial.items import Attachment
from sparsemor.bodies.spatial.pairs import Facing, Slide
from sparsemor.core.arrays import FloatArray
from sparsemor.core.placement import placed, turned

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
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """(T, 3) force at the own point and moment on the own side; then where that point is, (T, 3) m,
    None for a condition that the other side has no part in. lam (T, forces)."""
    item, none = c.item, np.zeros((len(times), 3))
    if isinstance(item, Attachment):
        return lam, none, None
    assert isinstance(item, Facing | Slide)
    far = poses[c.other] if c.other else item.place[None]
    if isinstance(item, Slide):
        lines = [turned(far, e) for e in item.lines]
        force = sum((lam[:, k : k + 1] * f for k, f in enumerate(lines)), none)
        return force, none, placed(pose, np.broadcast_to(item.point, (len(pose), 3)))
    faces = np.stack([item.faces(t) for t in times.tolist()])  # (T, l, 3)
    moment = none
    for k, d in enumerate(item.own):
        f = turned(np.broadcast_to(far, (len(times), far.shape[1])), faces[:, k])
        moment = moment + lam[:, k : k + 1] * np.cross(turned(pose, d), f)
    return none, moment, none


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
