"""Joint reactions: force and moment of the multipliers on each side.

The meaning of a multiplier depends on the joint's constraints, and a joint of rigid bodies can have
fewer of them than one of the same bodies when they deform. Force and moment about the mean point of
a side are common to both, so a rigid pre-simulation passes these on to the flexible run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.bodies.frames.items import Item
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.joints.side import Condition, Side
from sparsemor.core import FloatArray, InputError
from sparsemor.core.protocols.poses import points_in_space


def size(side: Side) -> int:
    """Number of components of a reaction on a side: force (d), N, and moment (1 or 3), N m."""
    return 3 * side.d - 3


def wrenches(
    sides: Sequence[Side], conditions: Sequence[Condition], times: FloatArray,
    multipliers: FloatArray, poses: Mapping[str, FloatArray], *, welded: bool,
) -> FloatArray:
    """(T, sum of sizes) force (N) on each side and moment (N m) about its mean point, in space
    axes, with the sign of the left-hand sides of the equations.

    multipliers (T, l); poses: rigid coordinates (T, n) of bodies that move; welded: an intermediate
    massless frame is welded to the first side.
    """
    bodies = [side.body for side in sides if side.body is not None]
    motion = {b.name: poses.get(b.name, b.pose[None]) for b in bodies}
    of, d = {b.name: i for i, b in enumerate(bodies)}, sides[0].d
    found = np.zeros((len(times), len(bodies), size(sides[0])))
    for c in conditions:
        if c.body.name not in of:
            continue
        other = poses[c.other] if c.other else None
        w = holding(c.item).wrench(times, multipliers @ c.C, motion[c.body.name], other)
        found[:, of[c.body.name], :d] += w.force
        found[:, of[c.body.name], d:] += w.moment
        if w.reach is None or welded:
            continue
        for name, i in of.items():
            if name != c.body.name:  # it answers with a force at `reach`
                found[:, i, :d] -= w.force
                found[:, i, d:] -= w.moment + torque(
                    w.reach - _mean_point(sides[i], motion[name]), w.force)
    return found.reshape(len(times), -1)


def holding(item: Item) -> Item:
    """The item of a joint, checked. InputError for one without `wrench`."""
    if item.reactions:
        return item
    raise InputError(
        f"its item {type(item).__name__} has no method `wrench`, so what it does to its bodies "
        "cannot be passed on by a rigid stage: give it that method (bodies/frames/items.py, "
        "`Item`), or drop rigid_stage")


def _mean_point(side: Side, pose: FloatArray) -> FloatArray:
    """(T or 1, d) position of a side's mean point, m, space axes."""
    return points_in_space(pose, np.broadcast_to(side.point, (len(pose), side.d)))
