"""Joints in space: which points coincide or slide, which directions stay perpendicular.

A joint's rows are sums over its conditions, each in the kernel of one body. Conditions on
directions and lines are written in the own body (the flexible one, if there is one) and read the
coordinates of the other; a flexible side turns with the mean rotation of its set. Two flexible
sides meet in a frame without mass that is welded to the first.

That mean rotation is a linear function theta of the displacements, and I + theta~ is a rotation to
first order only. A condition on one pair of directions then depends, to second order, on which pair
was taken. Relative rotations are therefore conditions on the antisymmetric part of the direction
cosines, (d . e' - e . d') / 2: the rotation part of I + theta~ in its polar decomposition, by
atan |theta| about theta, in whichever axes it is written.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames.attitude import angular_velocity
from sparsemor.bodies.frames.constraints import Facing, Slide
from sparsemor.bodies.frames.items import Item
from sparsemor.bodies.joints.plane_attachment import constant
from sparsemor.bodies.joints.space_attachment import NEAR, Side, check_meet, side_of, size_of
from sparsemor.bodies.joints.space_part import Condition, SpaceJoint
from sparsemor.bodies.spatial_body import SpatialBody
from sparsemor.bodies.targets import Target
from sparsemor.core import FloatArray, Gather, InputError, Part
from sparsemor.core.protocols.separable import Amplitude


@dataclass(slots=True, eq=False)
class Rows:
    """Collects the conditions of a joint. first, second: its sides in the order of the scene;
    weld: what ties the frame between two flexible bodies, then `first`, to the first of them."""

    name: str
    first: Side
    second: Side
    weld: "Rows | None" = None
    count: int = 0
    made: list[tuple[SpatialBody, Item, FloatArray | None, FloatArray, int, str]] = field(
        default_factory=list)
    targets: list[Amplitude] = field(default_factory=list)

    @property
    def own(self) -> Side:
        """The side that carries conditions on both: the flexible one, else the first body."""
        if self.first.body is None or (self.second.flexible and not self.first.flexible):
            return self.second
        return self.first

    @property
    def other(self) -> Side:
        return self.first if self.own is self.second else self.second

    @property
    def given(self) -> bool:
        """True if nothing is solved: the motion of a side is given and none is unknown."""
        bodies = [s.body for s in (self.first, self.second) if s.body is not None]
        return any(b.guide is not None for b in bodies) and not any(b.moves for b in bodies)

    def meet(
        self, which: Sequence[int] = (0, 1, 2), follow: Sequence[Amplitude] = ()
    ) -> None:
        """Coordinates (space axes) of the two points are equal, or stay where they are; one point
        alone may follow functions of time, m."""
        start = np.zeros(3)
        for side, sign in ((self.first, 1.0), (self.second, -1.0)):
            if side.body is None:
                continue
            if self.first.body is None:
                sign = 1.0  # a single side: its force has the sign of its own coordinates
            item, vectors = side.body.attachment(side.mean())
            self._add(side.body, item, vectors, sign * np.eye(3)[list(which)], "")
            start += sign * side.place()
        if self.first.body is not None and self.second.body is not None:
            start[:] = 0.0
        self._close(len(which), follow or [constant(float(start[i])) for i in which])

    def face(self, own: Sequence[FloatArray], other: Sequence[FloatArray]) -> None:
        """Pairs of directions, in space axes at the start, that stay perpendicular."""
        self._face(own, other, np.eye(len(own)))

    def no_relative_rotation(
        self, own: Sequence[FloatArray], other: Sequence[FloatArray],
        turn: Amplitude | None = None, axis: FloatArray | None = None,
    ) -> None:
        """No rotation in the plane of each pair (d, e) of directions, in space axes at the start:
        (A d . A_o e - A e . A_o d) / 2 = 0. The other's turn about `axis` by an angle `turn`, rad.
        """
        half = 0.5 * np.eye(len(own))
        self._face([*own, *other], [*other, *own], np.hstack([half, -half]), turn, axis)

    def _face(
        self, own: Sequence[FloatArray], other: Sequence[FloatArray], C: FloatArray,
        turn: Amplitude | None = None, axis: FloatArray | None = None,
    ) -> None:
        """Rows C (l, n) @ (A own_k . A_o other_k), n pairs of directions."""
        side, far = self.own, self.other
        body = side.body
        assert body is not None
        across = axis is not None and abs(abs(axis[2]) - 1.0) >= 1e-9
        if side.about_z and across and axis is not None and not self.given:
            raise InputError(f"the body turns about the z axis alone, and about {axis.tolist()} "
                             "it cannot: the axis must be [0, 0, 1]; or give the body a floating "
                             "frame", "axis")
        if side.about_z and far.about_z and not self.given:
            own, other, C = _about_z(own, other, C)
            if not own:
                return
        item = Facing(
            own=np.array(own) @ side.axes, other=np.array(other) @ far.axes,
            others=len(far.pose) if far.reads else 0, place=far.pose,
            turns=side.turning is not None, turn=turn,
            axis=None if axis is None else axis @ far.axes)
        sign = 1.0 if side is self.first or self.first.body is None else -1.0
        self._add(body, item, side.turning, sign * C, far.reads)
        self._close(len(C), [constant(0.0)] * len(C))

    def slide(self, lines: Sequence[FloatArray]) -> None:
        """The distance of the two points across directions (space axes at the start) of the other
        body stays zero; the ground's point is where the body's is at the start."""
        side, far = self.own, self.other
        body = side.body
        assert body is not None
        place = side.place() if far.body is None else far.place()
        gap = np.array(lines) @ (side.place() - place)
        if np.abs(gap).max() > NEAR * size_of(side, far):
            raise InputError(
                "the second point does not lie on the line through the first along the axis: they "
                f"are {np.abs(gap).max():.3g} m apart across it; correct a pose or the axis",
                "between")
        weights = side.mean()
        item = Slide(weights @ body.X, np.array(lines) @ far.axes,
                     (place - far.pose[:3]) @ far.axes, len(far.pose) if far.reads else 0, far.pose)
        sign = 1.0 if side is self.first or self.first.body is None else -1.0
        self._add(body, item, nodal.along(weights), sign * np.eye(len(lines)), far.reads)
        self._close(len(lines), [constant(0.0)] * len(lines))

    def no_turn(self) -> None:
        """The two sides keep their relative rotation. Three pairs are enough where both are rigid:
        their relative rotation is one."""
        x, y, z = np.eye(3)
        hold = self.face if self.own.turning is None else self.no_relative_rotation
        hold([y, z, x], [z, x, y])

    def joint(self) -> SpaceJoint:
        frame: dict[str, SpatialBody] = {}
        if self.weld is not None and self.first.body is not None:
            frame[self.first.body.name] = self.first.body
            self.made += [(b, i, P, C, first + self.count, r)
                          for b, i, P, C, first, r in self.weld.made]
            self._close(self.weld.count, self.weld.targets)
        conditions = []
        for body, item, vectors, C, first, reads in self.made:
            wide = np.zeros((self.count, C.shape[1]))
            wide[first : first + len(C)] = C
            conditions.append(Condition(body, item, vectors, wide, reads))
        ends = (self.first if self.weld is None else self.weld.first, self.second)
        sides = tuple(s for s in ends if s.body is not None)
        return SpaceJoint(self.name, sides, tuple(conditions), tuple(self.targets), frame)

    def _add(
        self, body: SpatialBody, item: Item, vectors: FloatArray | None, C: FloatArray, reads: str
    ) -> None:
        self.made.append((body, item, vectors, C, self.count, reads))

    def _close(self, rows: int, targets: Sequence[Amplitude]) -> None:
        self.count += rows
        self.targets += targets


def rows_between(
    name: str, between: tuple[str, str], parts: Mapping[str, Part], *, meeting: bool,
    turning: bool,
) -> Rows:
    """The sides of a joint in space. meeting: their points must coincide at the start; turning: it
    has conditions on both sides at once.

    InputError when both sides are the ground, are the same body, or do not meet.
    """
    gather = Gather()
    sides = [gather("", side_of, parts, s, f"between.{i}") for i, s in enumerate(between)]
    gather.check()
    first, second = (s for s in sides if s is not None)
    if first.body is None and second.body is None:
        raise InputError("a joint needs at least one body: both sides are the ground", "between")
    if first.body is not None and second.body is not None:
        if first.body.name == second.body.name:
            raise InputError(f"both sides are on body {first.body.name!r}", "between")
        if meeting:
            check_meet(first, second)
        if turning and first.flexible and second.flexible:
            middle = _frame_at(f"{name}.frame", first)
            weld = Rows(name, first, middle)
            weld.meet()
            weld.no_turn()
            return Rows(name, middle, second, weld)
    return Rows(name, first, second)


def rows_on(name: str, of: str, parts: Mapping[str, Part]) -> Rows:
    """The same for one target that is driven against the ground."""
    return Rows(name, side_of(parts, of, "of"), Side(None, None))


def _frame_at(name: str, side: Side) -> Side:
    """A frame without mass at a side's point, with that body's axes and motion at the start."""
    body = side.body
    assert body is not None
    arm = side.place() - body.pose[:3]
    spin = angular_velocity(body.pose, body.velocity)
    pose, velocity = body.pose.copy(), body.velocity.copy()
    pose[:3] += arm
    velocity[:3] += rot.cross(spin, arm)
    frame = SpatialBody(name=name, X=np.zeros((1, 3)), inertia=None, pose=pose, velocity=velocity,
                        moves=True, points={"origin": np.array([0])})
    return Side(Target(frame, np.array([0]), name), frame)


def _about_z(
    own: Sequence[FloatArray], other: Sequence[FloatArray], C: FloatArray
) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Pairs of directions that two sides which turn about z alone do not keep by themselves, and
    the rows of C (l, n) that are left of them.

    InputError where a pair neither holds by itself nor is one of the plane across z.
    """
    kept: tuple[list[FloatArray], list[FloatArray], list[int]] = [], [], []
    for i, (d, e) in enumerate(zip(own, other, strict=True)):
        along = [abs(abs(v[2]) - 1.0) < 1e-9 for v in (d, e)]
        across = [abs(v[2]) < 1e-9 for v in (d, e)]
        if (along[0] and across[1]) or (along[1] and across[0]):
            continue
        if not all(across):
            raise InputError("both sides turn about the z axis alone: the axis of this joint must "
                             "be [0, 0, 1]; or give one of them a floating frame", "axis")
        kept[0].append(d)
        kept[1].append(e)
        kept[2].append(i)
    C = C[:, kept[2]]
    return kept[0], kept[1], C[C.any(axis=1)]
