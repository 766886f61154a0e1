"""Force elements: forces between two sides by a law, without a constraint between them.

The law acts on rigid coordinates. A flexible side is represented by a massless frame that is
constrained to its set; the multipliers are the forces that it passes on. Along a prescribed motion
the forces are known in advance, and act on the displacements of flexible sides as loads.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.frames.springs import (
    LINEAR,
    STOP,
    Angle,
    Distance,
    Numbers,
    PlaneAngle,
    RelativeItem,
    SpringItem,
)
from sparsemor.bodies.joints.built_joint import JointPart, write_reactions
from sparsemor.bodies.joints.constraint_conditions import Conditions, constant, massless_frame
from sparsemor.bodies.joints.joint_sides import Side, sides_of, unit
from sparsemor.core import (
    Amplitude,
    Block,
    Body,
    Equations,
    FloatArray,
    InputError,
    Joint,
    JointPlugin,
    Part,
    Table,
    TimeFunction,
)
from sparsemor.core.protocols.joint import RecordedForce
from sparsemor.core.protocols.poses import FREE_POSE


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Prescribed part of the force of a spring: factor load(t) - k s(t) - c s'(t), N or N m, with
    its length or angle at rest s = offset + sign rest(t), s' = sign speed(t), stiffness k and
    damping c: what k (q - s) + c (q' - s') + factor load has beyond k q + c q'; rest, speed, load:
    None for zero."""

    stiffness: float
    damping: float
    offset: float
    rest: Amplitude | None
    speed: Amplitude | None
    load: Amplitude | None
    sign: float = 1.0
    factor: float = 1.0

    def __call__(self, t: float) -> float:
        f = -self.stiffness * self.offset
        if self.rest is not None and self.speed is not None:
            f -= self.sign * (self.stiffness * self.rest(t) + self.damping * self.speed(t))
        return f if self.load is None else f + self.factor * self.load(t)

    @classmethod
    def of(
        cls, stiffness: float, damping: float, offset: float, rest: TimeFunction | None,
        load: TimeFunction | None, sign: float = 1.0, factor: float = 1.0
    ) -> "Drive":
        """Drive by functions of time."""
        return cls(
            stiffness, damping, offset, rest=None if rest is None else rest.value,
            speed=None if rest is None else rest.rate, load=None if load is None else load.value,
            sign=sign, factor=factor)


@dataclass(frozen=True, slots=True, eq=False)
class ItemForce:
    """Recorded force of an item, N or N m: sign times its force at times (T,), s, along the motion
    of its sides, pairs of rigid coordinates (T, n) and their rates."""

    item: SpringItem
    sign: float

    def __call__(
        self, times: FloatArray, motion: Sequence[tuple[FloatArray, FloatArray]]
    ) -> FloatArray:
        return self.sign * self.item.along(times, *motion)[0]

    def bounded_angle(
        self, times: FloatArray, own: FloatArray, other: FloatArray
    ) -> FloatArray | None:
        """Angle (T,), rad, of a linear rotational spring less that of its rest, between -2 pi and 2
        pi, as attitudes in space determine it no further; None for other forces, and where whole
        turns are counted. own, other (T, n): rigid coordinates of both sides, attitude from 3
        on."""
        item = self.item
        if not isinstance(item, RelativeItem) or not isinstance(item.coordinate, Angle) or (
                item.law[0] != LINEAR or not item.law[1]):
            return None
        if own.shape[1] < FREE_POSE and (other.shape[1] < FREE_POSE or not item.others):
            return None  # these count all turns
        relaxed = item.near_at(times)
        return item.coordinate.nearly(own[:, 3:], other[:, 3:], relaxed) - relaxed


@dataclass(frozen=True, slots=True, eq=False)
class ForceElementPart(Joint):
    """Force element of a scene: items of the frame of the first of its two `sides`, which read
    the coordinates of the other one. law, recorded: force that is recorded, its name and unit;
    held: constraints of massless frames, None for rigid sides; adjusted: these frames; prescribed:
    True if the motion of its sides is: then its force is a load on both."""

    name: str
    sides: tuple[Side, Side]
    items: tuple[SpringItem, ...]
    law: ItemForce
    recorded: tuple[str, str]
    held: JointPart | None = None
    adjusted: Mapping[str, Body] = field(default_factory=dict)
    prescribed: bool = False
    turns: bool = False
    localized: bool = True

    @property
    def force(self) -> RecordedForce:
        """The force that is recorded."""
        one, two = self.sides
        return RecordedForce(self.law, self.recorded, (
            f"{one.reads}.rigid" if one.reads else one.motion,
            f"{two.reads}.rigid" if two.reads else two.motion))

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier."""
        return () if self.held is None else self.held.components

    def blocks(self) -> Sequence[Block]:
        return () if self.held is None else self.held.blocks()

    def contribute(self, equations: Equations) -> None:
        """Adds the items to the equations of the own side's frame, with constraints of massless
        frames on flexible sides (held); where all motion is prescribed, the known force. reads:
        name of a side's body, if its rigid coordinates are unknowns, else ""."""
        if self.prescribed:
            write_reactions(equations, self.sides, self._reactions(equations), self.turns)
            return
        if self.held is not None:
            self.held.contribute(equations)
        own, other = self.sides
        assert own.body is not None
        for item in self.items:
            equations.frame(own.body.name, item,
                            reads=f"{other.reads}.rigid" if other.reads else "")

    def _reactions(self, equations: Equations) -> Table:
        """Forces and moments on both sides along their prescribed motion, with the functions of
        time that the steps of the run see."""
        motion = [s.motion for s in self.sides]
        times = max((m.times for m in motion), key=len)  # a side at rest has one
        own, other = (m.along(times)[:2] for m in motion)
        items: list[SpringItem] = [equations.over_steps(item) for item in self.items]
        wrenches = [item.along(times, own, other)[1] for item in items]
        wrench = sum(wrenches[1:], wrenches[0])
        return Table(times, np.hstack([wrench, -wrench]))


class ForceElement(JointPlugin):
    """Base class of force elements between two of `body:set` and `ground`.

    dimensions: dimensions in which it exists; turns: True if it acts on rotations, False if on
    points; recorded: name and unit of its force in results.
    """

    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    turns: ClassVar[bool] = False
    recorded: ClassVar[tuple[str, str]]

    between: tuple[str, str]
    """The two sides: each a set `body:set`, or `ground`."""

    @property
    def acts_on_rotations(self) -> bool:
        """`turns`, unless it depends on options."""
        return self.turns

    def build(self, name: str, parts: Mapping[str, Part]) -> ForceElementPart:
        """The force element on two sides; a flexible side gets a massless frame that follows its
        set. Its item belongs to the first side whose coordinates are unknowns (`reads`), the own
        one. guide: prescribed motion of a body: where no side's motion is unknown, the force is a
        load. held: constraints of the frames, in one joint."""
        ends = sides_of(parts, self.between, self.dimensions)
        bodies = [s.body for s in ends if s.body is not None]
        if any(b.guide is not None for b in bodies) and not any(b.moves for b in bodies):
            return self._prescribed(name, ends)
        sides, held, frames = [], [], {}
        for end, which in zip(ends, ("first", "second"), strict=True):
            if not end.flexible:
                sides.append(end)
                continue
            frame = massless_frame(f"{name}.{which}", end, self.acts_on_rotations)
            assert frame.body is not None
            sides.append(frame)
            held.append(self._held(name, end, frame))
            frames[frame.body.name] = frame.body
        for more in held[1:]:
            held[0].add(more)
        first = bool(sides[0].reads)  # True: the own side is the first of the scene
        own, other = sides if first else sides[::-1]
        if not own.reads:
            raise InputError("no side can move", "between")
        items = self.items(own, other, first)
        return ForceElementPart(
            name, (own, other), items, self._law(items[0], first), self.recorded,
            held=held[0].joint() if held else None, adjusted=frames)

    def _prescribed(self, name: str, ends: tuple[Side, Side]) -> ForceElementPart:
        """The element between sides whose motion is prescribed."""
        first = ends[0].body is not None
        own, other = ends if first else ends[::-1]
        items = self.items(own, other, first)
        if self.acts_on_rotations:
            for side in ends:  # refuses a set without a mean rotation
                _ = side.turning
        return ForceElementPart(
            name, (own, other), items, self._law(items[0], first), self.recorded, prescribed=True,
            turns=self.acts_on_rotations)

    def _law(self, item: SpringItem, first: bool) -> ItemForce:
        """Force that is recorded: of a rotational one the moment on the first side."""
        return ItemForce(item, -1.0 if self.acts_on_rotations and first else 1.0)

    @abstractmethod
    def item(self, own: Side, other: Side, first: bool) -> SpringItem:
        """Item of the frame of `own`, which moves; first: True if it is the first side of the
        scene."""

    def items(self, own: Side, other: Side, first: bool) -> tuple[SpringItem, ...]:
        """All items of an element of several forces, of which the first one is recorded."""
        return (self.item(own, other, first),)

    def _held(self, name: str, end: Side, frame: Side) -> Conditions:
        """Constraints of a massless frame to a flexible side `end`: same point; its rotation is
        that of the set, or, where the element acts on points only, zero: in the plane its angle, in
        space the angle about z, the only one that such a frame has."""
        made = Conditions(name, end, frame)
        made.meet()
        if self.acts_on_rotations:
            made.no_turn()
        elif end.d == 2:
            made.linear([(frame, np.array([[0.0, 0.0, 1.0]]))], [constant(0.0)])
        else:
            x, y, _ = np.eye(3)
            still = Conditions(name, frame, Side(None, 3))
            still.no_relative_rotation([x], [y])
            made.add(still)
        return made


RECORDED = {"turn": ("torque", "N m"), "slide": ("force", "N")}
"""Name and unit of the recorded force, on the first side."""


class Relative(ForceElement):
    """Force on the relative motion of two sides that a joint leaves free, next to that joint."""

    motion: Literal["turn", "slide"] = "turn"
    """Relative motion: `turn`, the angle that a revolute or cylindrical joint leaves free, counter-
    clockwise and in space about `axis`, or `slide`, the distance along `axis` that a prismatic or
    cylindrical one does. It is that of the first side relative to the second, and zero at the
    start."""
    axis: tuple[float, float] | tuple[float, float, float] | None = None
    """Direction of the axis at the start (space axes)."""

    @property
    def acts_on_rotations(self) -> bool:
        return True

    @property
    def recorded(self) -> tuple[str, str]:  # type: ignore[override]
        return RECORDED[self.motion]

    @abstractmethod
    def law(self) -> Numbers:
        """Kind and numbers of the law (`relative_law`)."""

    @property
    def centre(self) -> float:
        """Angle, rad, to which that of two sides in space is nearest, among those that differ by
        two turns."""
        return 0.0

    def item(self, own: Side, other: Side, first: bool) -> RelativeItem:
        if self.motion == "turn" and own.d == 2 and self.axis is not None:
            raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
        axis = np.zeros(2) if self.motion == "turn" and own.d == 2 else unit(self.axis, own.d)
        return relative_item(self.motion, axis, own, other, first, self.law(), self.centre)

    def _law(self, item: object, first: bool) -> ItemForce:
        assert isinstance(item, RelativeItem)
        # the law's force acts against the motion of the first side; recorded is that on this side
        return ItemForce(item, -1.0)


def relative_item(
    motion: str, axis: FloatArray, own: Side, other: Side, first: bool, law: Numbers,
    near: float = 0.0,
) -> RelativeItem:
    """Item of the frame of `own` for a law of the angle ("turn") about an axis (d,) or of the
    distance along it, in space axes at the start.

    The coordinate of the law is that of the first side relative to the second, so that its sign
    changes if `own` is the second; first: True if it is the first. law: its kind and four numbers;
    near: angle, rad, to which that in space is nearest among those that differ by two turns.
    """
    sign = 1.0 if first else -1.0
    if motion == "turn":
        return RelativeItem(relative_angle(axis, own, other), law, sign, near=sign * near)
    # a coordinate that is zero at the start, as the ground's point is the other's
    base = (own.place() - other.pose[: own.d]) @ other.axes
    others, place = unknowns(other)
    distance = Distance(others, place, point=own.point, base=base, axis=axis @ other.axes)
    return RelativeItem(distance, law, sign)


def relative_angle(axis: FloatArray, own: Side, other: Side) -> PlaneAngle | Angle:
    """Angle of two sides since the start, in space about an axis (3,), in space axes at the start.
    """
    others, place = unknowns(other)
    if own.d == 2:
        return PlaneAngle(others, place, start=float(own.pose[2] - other.pose[2]))
    e1, e2 = across(axis)
    return Angle(others, place, own=e1 @ own.axes, first=e1 @ other.axes,
                 second=e2 @ other.axes, start=own.pose[3:])


def unknowns(other: Side) -> tuple[int, FloatArray]:
    """Number of rigid coordinates of a side that are unknowns, and its pose at the start."""
    return len(other.pose) if other.reads else 0, other.pose


NONE = 1e300
"""Angle or distance of a limit that is not given."""


class Stop(Relative):
    """Limits of the angle or distance that a joint of the same sides leaves free.

    Beyond a limit by the depth s acts the force stiffness s (1 + damping s') against it, never less
    than zero (Hunt and Crossley 1975, doi 10.1115/1.3423596). A body that meets the limit with the
    speed v leaves it with e v, where the restitution e follows from D = damping v alone, whatever
    the mass: D (1 + e) = ln((1 + D) / (1 - e D)), about e = 1 - 2/3 D for small D. Results store
    the force or moment on the first side.
    """

    lower: float | None = Field(default=None, le=0.0)
    """Lower limit, rad or m, measured from the start; none when not given."""
    upper: float | None = Field(default=None, ge=0.0)
    """Upper limit, rad or m, measured from the start; none when not given."""
    stiffness: float = Field(gt=0.0)
    """Stiffness, N m/rad or N/m."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping factor, s/rad or s/m: the restitution is 0.94 at a damping times speed
    of 0.1, 0.75 at 0.5, 0.59 at 1."""

    @model_validator(mode="after")
    def _limits(self) -> Self:
        if self.lower is None and self.upper is None:
            raise ValueError("it limits nothing: give lower, upper or both")
        return self

    def law(self) -> Numbers:
        lower, upper = (f if x is None else x for x, f in ((self.lower, -NONE), (self.upper, NONE)))
        return STOP, lower, upper, self.stiffness, self.damping  # kind and numbers, `relative_law`

    @property
    def centre(self) -> float:
        """Between the limits, or the one limit: the angle to which that in space is nearest."""
        given = [x for x in (self.lower, self.upper) if x is not None]
        return sum(given) / len(given)
