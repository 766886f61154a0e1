"""The two sides of a joint: two attachments, or one and the ground."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.joints.plane_part import End, JointPart
from sparsemor.bodies.planar_body import PlanarBody
from sparsemor.bodies.targets import GROUND, Target, find_target
from sparsemor.core import FloatArray, Gather, Held, InputError, Part
from sparsemor.core.protocols.separable import Amplitude


def connect(
    name: str, between: tuple[str, str], parts: Mapping[str, Part], angle: bool
) -> JointPart:
    """Positions (and angles) of two attachments stay as they are at the start.

    InputError when both sides are the ground, are the same body, or do not meet at the start.
    """
    gather = Gather()
    sides = [gather("", find_target, parts, s, f"between.{i}")
             for i, s in enumerate(between) if s != GROUND]
    gather.check()
    targets = [s for s in sides if s is not None]
    if not targets:
        raise InputError("a joint needs at least one body: both sides are the ground", "between")
    if len(targets) == 2 and targets[0].body.name == targets[1].body.name:
        raise InputError(f"both sides are on body {targets[0].body.name!r}", "between")
    for t in targets:
        _check(t, angle)
    if len(targets) == 2:
        _check_meet(targets[0], targets[1])
    n = 3 if angle else 2
    signs = [1.0, -1.0][: len(targets)]
    start = np.zeros(n)
    for sign, target in zip(signs, targets, strict=True):
        start += sign * _start(target, n)
    ends = tuple(End(t, s * np.eye(n)) for s, t in zip(signs, targets, strict=True))
    values = start.tolist()
    if len(targets) == 2:
        values[:2] = [0.0, 0.0]
    return JointPart(name, ends, tuple(constant(float(c)) for c in values))


def constant(value: float) -> Amplitude:
    return Held(value)


def _start(target: Target, n: int) -> FloatArray:
    z = plane(target).start_position(target.mean())
    return np.array([z.real, z.imag, target.body.pose[2]])[:n]


def plane(target: Target, key: str = "between") -> PlanarBody:
    """The planar body of a target; InputError for one in space (its joints are in space.py)."""
    if not isinstance(target.body, PlanarBody):
        raise InputError(f"body {target.body.name!r} is in space, this joint is plane", key)
    return target.body


def _check(target: Target, angle: bool) -> None:
    body = target.body
    if body.immobile:
        raise InputError(f"{target.text!r} cannot move: body {body.name!r} is fixed in space and "
                         "has no elastic field", "between")
    if angle and body.elasticity is not None and len(target.nodes) < 2:
        raise InputError(f"{target.text!r} is a single point of a flexible body and has no angle: "
                         "attach to a set of two or more points", "between")


def _check_meet(a: Target, b: Target) -> None:
    za, zb = plane(a).start_position(a.mean()), plane(b).start_position(b.mean())
    gap = abs(za - zb)
    size = max(float(np.ptp(np.abs(t.body.X))) if len(t.body.X) else 0.0 for t in (a, b))
    if gap > 1e-8 * max(size, abs(za), 1e-12):
        raise InputError(
            f"the two sides do not meet at the start: {a.text} is at ({za.real:.9g}, {za.imag:.9g})"
            f" m, {b.text} at ({zb.real:.9g}, {zb.imag:.9g}) m, {gap:.3g} m apart; correct a pose",
            "between")
