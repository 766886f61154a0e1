"""Sides of a joint, each a set of a body's nodes or the ground, and its constraint conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians

import numpy as np

from sparsemor.bodies.body_set import GROUND, Place, find_place
from sparsemor.bodies.frames.constraints import GROUND as AT_ORIGIN
from sparsemor.bodies.frames.frame_items import Item
from sparsemor.core import Body, FloatArray, FrameHistory, Gather, InputError, Part
from sparsemor.core.protocols.poses import in_degrees, points_in_space

NEAR = 1e-8
"""Largest relative initial gap between sides that must coincide."""
WHERE = {2: "plane", 3: "in space"}


@dataclass(frozen=True, slots=True, eq=False)
class Condition:
    """Contribution of one body to a joint's l constraints: C (l, forces) times the equations of a
    frame item; the forces of the item are C^T times the joint's multipliers.

    vectors: functionals of the displacements that the item uses, as columns; other: name of the
    body whose rigid coordinates it reads, "" for none.
    """

    body: Body
    item: Item
    vectors: FloatArray | None
    C: FloatArray
    other: str = ""


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a joint in d dimensions: a set of points of a body, or the ground (target None).
    key: its key in the scene."""

    target: Place | None
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
        """Derivatives of the mean rotation of the set (`Place.turning`)."""
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

    @property
    def point(self) -> FloatArray:
        """(d,) reference position of the side's centre, m, in the frame of its body."""
        assert self.target is not None
        return self.target.point

    @property
    def displacement(self) -> FloatArray | None:
        """(n, d) derivatives of the displacement of the side's centre by the unknown ones."""
        return None if self.target is None else self.target.displacement

    def place(self) -> FloatArray:
        """(d,) initial position of the side's centre, m, space axes."""
        return np.asarray(points_in_space(self.pose[None], self.point[None])[0])


def sides_of(
    parts: Mapping[str, Part], between: tuple[str, str], dimensions: Sequence[int]
) -> tuple[Side, Side]:
    """The two sides `body:set` or `ground` of a joint.

    InputError when both are the ground or the same body, or the bodies are not in the same one of
    the given dimensions.
    """
    gather, targets = Gather(), list[Place | None]()
    for i, text in enumerate(between):
        with gather.under(""):
            targets.append(None if text == GROUND else _target(parts, text, f"between.{i}"))
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


def _target(parts: Mapping[str, Part], text: str, key: str) -> Place:
    """The set `body:set` of a body that can move or deform; InputError for another one."""
    target = find_place(parts, text, key)
    if target.body.immobile:
        raise InputError(f"{text!r} cannot move: body {target.body.name!r} is fixed in space and "
                         "has no elastic field", key)
    return target


def _check_dimension(body: Body, dimensions: Sequence[int], key: str) -> None:
    """InputError for a body in a dimension in which the joint does not exist."""
    if body.d not in dimensions:
        need = "in space" if body.d == 2 else "in the plane"
        raise InputError(f"this joint needs bodies {need}, and body {body.name!r} is "
                         f"{WHERE[body.d]}", key)


def unit(axis: Sequence[float] | None, d: int, key: str = "axis") -> FloatArray:
    """(d,) unit vector along the axis of a joint's option `key`; InputError when it is missing,
    zero or of another dimension than d."""
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
            f"{b.target.text} at {_place(zb)} m, {gap:.3g} m apart; {_from_means(a, b)}"
            f"{_in_degrees(a, b)}correct a pose, or name the centre of a set "
            "(`sets: {NAME: {centre: [...]}}`)", "between")


def _in_degrees(*sides: Side) -> str:
    """Hint at angles of plane bodies, beyond a turn, that are round numbers."""
    angles = {s.body.name: float(s.body.pose[2]) for s in sides
              if s.body is not None and len(s.body.pose) == 3}
    return "".join(
        f"the angle of {name} is {a:g} rad: if degrees are meant, write {radians(a):.6g}; "
        for name, a in angles.items() if in_degrees(a))


def _from_means(*sides: Side) -> str:
    """Distance of each side's centre from the mean of its facets, in words."""
    return "".join(f"that of {t.text}, {words}; " for s in sides if (t := s.target) is not None
                   and (words := t.body.point_in_words(t.which)))


def size_of(*sides: Side) -> float:
    """Length to which an initial gap is compared, m: extent of the bodies and distance from the
    origin."""
    bodies = [s for s in sides if s.body is not None]
    extents = [s.body.extent for s in bodies if s.body is not None]
    return max(*extents, *(float(np.linalg.norm(s.place())) for s in bodies), 1e-12)


def _place(z: FloatArray) -> str:
    least = 1e-12 * float(np.abs(z).max())
    return "(" + ", ".join(f"{c if abs(c) > least else 0.0:.9g}" for c in z) + ")"
