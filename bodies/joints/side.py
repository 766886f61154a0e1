"""Sides of a joint, each a set of a body's nodes or the ground, and its constraint conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.frames.constraints import GROUND as AT_ORIGIN
from sparsemor.bodies.targets import GROUND, Target, find_target
from sparsemor.core import FloatArray, FrameHistory, FrameItem, Gather, InputError, Part

NEAR = 1e-8
"""Largest relative initial gap between sides that must coincide."""
WHERE = {2: "plane", 3: "in space"}


@dataclass(frozen=True, slots=True, eq=False)
class Condition:
    """Contribution of one body to a joint's constraints: C (l, forces) times the equations of a
    frame item.

    vectors: functionals of the displacements that the item uses, as columns; other: name of the
    body whose rigid coordinates it reads, "" for none.
    """

    body: Body
    item: FrameItem
    vectors: FloatArray | None
    C: FloatArray
    other: str = ""


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a joint in d dimensions: a set of nodes of a body, or the ground (target None).
    key: its key in the scene."""

    target: Target | None
    d: int
    key: str = "between"

    @property
    def body(self) -> Body | None:
        return None if self.target is None else self.target.body

    @property
    def flexible(self) -> bool:
        """True if displacements can move its nodes."""
        return self.target is not None and self.target.flexible

    @cached_property
    def turning(self) -> FloatArray | None:
        """Functionals of the mean rotation of the set (`Target.turning`)."""
        return None if self.target is None else self.target.turning(self.key)

    @property
    def about_z(self) -> bool:
        """In space: True if the side can rotate about the z axis of space alone, or not at all."""
        body = self.body
        return body is None or (
            self.turning is None and (not body.moves or not body.turns_freely))

    @property
    def pose(self) -> FloatArray:
        """Rigid coordinates at the start: (3,) in the plane, (7,) or (4,) in space."""
        return AT_ORIGIN[self.d] if self.body is None else self.body.pose

    @property
    def axes(self) -> FloatArray:
        """(d, d) rotation matrix from the side's axes to space axes at the start."""
        return np.eye(self.d) if self.body is None else self.body.start_rotation()

    @property
    def motion(self) -> FrameHistory:
        """Motion of the side where it is not an unknown: prescribed, or at rest."""
        guide = None if self.body is None else self.body.guide
        return FrameHistory.standing(self.pose) if guide is None else guide

    @property
    def reads(self) -> str:
        """Name of the body if its rigid coordinates are unknowns, else ""."""
        return self.body.name if self.body is not None and self.body.moves else ""

    def mean(self) -> FloatArray:
        assert self.target is not None
        return self.target.mean()

    @property
    def mean_of_facets(self) -> FloatArray:
        """(N,) weights of the mean over the set's facets, none of which is moved by its centre."""
        assert self.target is not None
        return self.target.centre.even

    def place(self) -> FloatArray:
        """(d,) initial position of the side's centre, m, space axes."""
        assert self.body is not None
        return self.body.start_position(self.mean())


def sides_of(
    parts: Mapping[str, Part], between: tuple[str, str], dimensions: Sequence[int]
) -> tuple[Side, Side]:
    """The two sides `body:set` or `ground` of a joint.

    InputError when both are the ground or the same body, or the bodies are not in the same one of
    the given dimensions.
    """
    gather = Gather()
    targets = [None if text == GROUND else gather("", _target, parts, text, f"between.{i}")
               for i, text in enumerate(between)]
    gather.check()
    bodies = [t.body for t in targets if t is not None]
    if not bodies:
        raise InputError("a joint needs at least one body: both sides are the ground", "between")
    first, other = bodies[0], bodies[-1]
    if len(bodies) == 2 and first.name == other.name:
        raise InputError(f"both sides are on body {first.name!r}", "between")
    if first.d != other.d:
        flat, solid = sorted(bodies, key=lambda b: b.d)
        raise InputError(f"body {flat.name!r} is plane and body {solid.name!r} in space: the sides "
                         "of a joint are both in the plane or both in space", "between")
    _check_dimension(first, dimensions, "between")
    one, two = (Side(t, first.d, f"between.{i}") for i, t in enumerate(targets))
    return one, two


def side_of(parts: Mapping[str, Part], text: str, dimensions: Sequence[int], key: str) -> Side:
    """The side `body:set` of a joint with the ground. InputError as in `sides_of`."""
    target = _target(parts, text, key)
    _check_dimension(target.body, dimensions, key)
    return Side(target, target.body.d, key)


def _target(parts: Mapping[str, Part], text: str, key: str) -> Target:
    target = find_target(parts, text, key)
    if target.body.immobile:
        raise InputError(f"{text!r} cannot move: body {target.body.name!r} is fixed in space and "
                         "has no elastic field", key)
    return target


def _check_dimension(body: Body, dimensions: Sequence[int], key: str) -> None:
    if body.d not in dimensions:
        need = "in space" if body.d == 2 else "in the plane"
        raise InputError(f"this joint needs bodies {need}, and body {body.name!r} is "
                         f"{WHERE[body.d]}", key)


def unit(axis: Sequence[float] | None, d: int, key: str = "axis") -> FloatArray:
    """(d,) unit vector along an axis; InputError when it is missing, zero or of another dimension.
    """
    if axis is None:
        raise InputError("missing: in space give the axis, such as [0, 0, 1] (space axes, at the "
                         "start)", key)
    if len(axis) != d:
        raise InputError(f"the bodies are {WHERE[d]}: give {'two' if d == 2 else 'three'} "
                         f"components (got {list(axis)})", key)
    length = float(np.linalg.norm(axis))
    if not 0 < length < np.inf:
        raise InputError(f"an axis has a direction (got {list(axis)})", key)
    return np.array(axis, dtype=np.float64) / length


def check_meet(a: Side, b: Side) -> None:
    """InputError if the centres of two sides are apart at the start."""
    za, zb = a.place(), b.place()
    gap = float(np.linalg.norm(za - zb))
    if gap > NEAR * size_of(a, b) and a.target is not None and b.target is not None:
        raise InputError(
            f"the two sides do not meet at the start: {a.target.text} is at {_place(za)} m, "
            f"{b.target.text} at {_place(zb)} m, {gap:.3g} m apart; {_from_means(a, b)}correct a "
            "pose, or name the centre of a set (`sets: {NAME: {centre: [...]}}`)", "between")


def _from_means(*sides: Side) -> str:
    """Distance of each side's centre from the mean of its facets, in words."""
    found = [f"that of {t.text}, {t.centre.how}, is {t.centre.shift:.3g} m from the mean of its "
             "facets; " for t in (s.target for s in sides)
             if t is not None and t.body.mesh is not None]
    return "".join(found)


def size_of(*sides: Side) -> float:
    """Length to which an initial gap is compared, m: extent of the bodies and distance from the
    origin."""
    bodies = [s for s in sides if s.body is not None]
    extents = [float(np.ptp(s.body.X, axis=0).max()) for s in bodies
               if s.body is not None and len(s.body.X)]
    return max(*extents, *(float(np.linalg.norm(s.place())) for s in bodies), 1e-12)


def _place(z: FloatArray) -> str:
    return "(" + ", ".join(f"{c:.9g}" for c in z) + ")"
