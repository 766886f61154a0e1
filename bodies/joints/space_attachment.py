"""The two sides of a joint in space: a set of a body's points, or the ground."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames.constraints import STILL
from sparsemor.bodies.spatial_body import SpatialBody
from sparsemor.bodies.targets import GROUND, Target, find_target
from sparsemor.core import FloatArray, InputError, Part

NEAR = 1e-8
"""Relative gap that sides which must meet may have at the start."""


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a joint, or the ground."""

    target: Target | None
    body: SpatialBody | None

    @property
    def flexible(self) -> bool:
        """True if displacements can move its points: not where all of them are held."""
        body = self.body
        if body is None or body.elasticity is None or self.target is None:
            return False
        return bool(np.isin(self.target.nodes, body.elasticity.free // 3).any())

    @cached_property
    def turning(self) -> FloatArray | None:
        """(3 N, 3) mean rotation of the set by the displacements; None where they cannot turn it:
        on a rigid body, or where all its points are held. InputError for a set on one line."""
        body = self.body
        if not self.flexible or body is None or body.elasticity is None or self.target is None:
            return None
        try:
            vectors = nodal.mean_turn(self.mean(), body.X)
        except np.linalg.LinAlgError:
            raise InputError(
                f"the points of {self.target.text!r} lie on one line (or are one point), so their "
                "mean rotation is undefined: attach to a set that spans a plane",
                "between") from None
        return vectors if np.any(vectors[body.elasticity.free]) else None

    @property
    def about_z(self) -> bool:
        """True if it can turn about the z axis of space alone, or not at all."""
        body = self.body
        return body is None or (
            self.turning is None and (not body.moves or not body.turns_freely))

    @property
    def pose(self) -> FloatArray:
        """(7 or 4,) at the start."""
        return STILL if self.body is None else self.body.pose

    @property
    def axes(self) -> FloatArray:
        """(3, 3): its axes to space axes at the start."""
        return np.eye(3) if self.body is None else self.body.start_rotation()

    @property
    def reads(self) -> str:
        """The body whose coordinates are unknowns, "" for a side that stands still."""
        return self.body.name if self.body is not None and self.body.moves else ""

    def mean(self) -> FloatArray:
        assert self.target is not None
        return self.target.mean()

    def place(self) -> FloatArray:
        """(3,) global position of its point at the start."""
        assert self.body is not None
        return self.body.start_position(self.mean())


def spatial(parts: Mapping[str, Part], texts: Sequence[str]) -> bool:
    """True if any of these targets is on a body in space."""
    return any(isinstance(parts.get(s.partition(":")[0]), SpatialBody) for s in texts)


def need_space(parts: Mapping[str, Part], texts: Sequence[str], joint: str) -> None:
    """InputError for a joint that exists in space only."""
    if not spatial(parts, texts) and any(t != GROUND for t in texts):
        raise InputError(f"a {joint} joint needs bodies in space; these are plane", "between")


def unit(axis: Sequence[float] | None, key: str = "axis") -> FloatArray:
    """(3,) of length 1; InputError when it is missing or zero."""
    if axis is None:
        raise InputError("missing: in space give the axis, such as [0, 0, 1] (space axes, at the "
                         "start)", key)
    length = float(np.linalg.norm(axis))
    if not 0 < length < np.inf:
        raise InputError(f"an axis has a direction (got {list(axis)})", key)
    return np.array(axis, dtype=np.float64) / length


def side_of(parts: Mapping[str, Part], text: str, key: str) -> Side:
    if text == GROUND:
        return Side(None, None)
    target = find_target(parts, text, key)
    body = target.body
    if not isinstance(body, SpatialBody):
        raise InputError(f"body {body.name!r} is plane, the other side of this joint is in space",
                         key)
    if body.immobile:
        raise InputError(f"{target.text!r} cannot move: body {body.name!r} is fixed in space and "
                         "has no elastic field", key)
    return Side(target, body)


def check_meet(a: Side, b: Side) -> None:
    za, zb = a.place(), b.place()
    gap = float(np.linalg.norm(za - zb))
    if gap > NEAR * size_of(a, b) and a.target is not None and b.target is not None:
        raise InputError(
            f"the two sides do not meet at the start: {a.target.text} is at {_place(za)} m, "
            f"{b.target.text} at {_place(zb)} m, {gap:.3g} m apart; correct a pose", "between")


def size_of(*sides: Side) -> float:
    """Length that a gap is compared with, m."""
    extents = [float(np.ptp(s.body.X, axis=0).max()) for s in sides
               if s.body is not None and len(s.body.X)]
    far = [float(np.linalg.norm(s.place())) for s in sides if s.body is not None]
    return max(*extents, *far, 1e-12)


def _place(z: FloatArray) -> str:
    return "(" + ", ".join(f"{c:.9g}" for c in z) + ")"
