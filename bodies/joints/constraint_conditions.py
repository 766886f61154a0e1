"""Constraints of joints: coincident or sliding points, perpendicular directions, coupled rotations.

The constraint equations of a joint are sums over its conditions, each evaluated with the equations
of one body. Positions and, in the plane, angles of the two sides enter linearly. Conditions on
directions and lines are evaluated with one body (the flexible one, if there is one) and read the
coordinates of the other; a flexible side rotates with the mean rotation of its set of nodes.
Between two flexible sides such a condition is imposed on a massless frame that is welded to the
first.

In space that mean rotation is a linear function theta of the displacements, and I + theta~ is a
rotation to first order only. A condition on one pair of directions then depends, to second order,
on the choice of the pair. Relative rotations are therefore conditions on the antisymmetric part of
the direction cosines, (d . e' - e . d') / 2: this is the rotation of I + theta~ in its polar
decomposition, by atan |theta| about theta, independent of the axes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sparsemor.bodies.body_set import Place
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames.attitude import velocity_at
from sparsemor.bodies.frames.constraints import Facing, Slide
from sparsemor.bodies.frames.frame_items import Item
from sparsemor.bodies.frames.mean_displacement_and_rotation import MeanPoint, Rotation
from sparsemor.bodies.joints.built_joint import JointPart
from sparsemor.bodies.joints.joint_sides import (
    NEAR,
    Condition,
    Side,
    check_meet,
    side_of,
    sides_of,
    size_of,
)
from sparsemor.core import Amplitude, Body, FloatArray, InputError, Part
from sparsemor.core.protocols.time_function import Held


def constant(value: float) -> Amplitude:
    """Constant target value of a constraint."""
    return Held(value)


@dataclass(slots=True, eq=False)
class Conditions:
    """Collects the constraints of a joint.

    first, second: its sides in the order of the scene. Between two flexible bodies `first` is an
    intermediate massless frame, and weld its constraints to the first body. made: conditions, each
    with the number of its first constraint equation; count: number of equations.
    """

    name: str
    first: Side
    second: Side
    weld: "Conditions | None" = None
    count: int = 0
    made: list[tuple[int, Condition]] = field(default_factory=list)
    targets: list[Amplitude] = field(default_factory=list)

    @property
    def d(self) -> int:
        """Dimension: 2 or 3."""
        return self.first.d

    @property
    def own(self) -> Side:
        """The side with whose equations two-sided conditions are evaluated: the flexible one, else
        the first body."""
        if self.first.body is None or (self.second.flexible and not self.first.flexible):
            return self.second
        return self.first

    @property
    def other(self) -> Side:
        return self.first if self.own is self.second else self.second

    @property
    def ends(self) -> tuple[Side, Side]:
        """The sides named in the scene, without an intermediate frame."""
        return (self.first if self.weld is None else self.weld.first, self.second)

    @property
    def prescribed(self) -> bool:
        """True if there is nothing to solve: the motion of a side is prescribed, and that of no
        side is unknown."""
        bodies = [s.body for s in (self.first, self.second) if s.body is not None]
        return any(b.guide is not None for b in bodies) and not any(b.moves for b in bodies)

    def signed(self) -> list[tuple[Side, float]]:
        """Sides that are bodies, with sign +1 for the first and -1 for the second (+1 if it is
        alone), so that a multiplier is a force on the first."""
        sides = [s for s in (self.first, self.second) if s.body is not None]
        return list(zip(sides, (1.0, -1.0), strict=False))

    # ------------------------------------------------------------------ positions and angles

    def linear(
        self, shares: Sequence[tuple[Side, FloatArray]], targets: Sequence[Amplitude]
    ) -> None:
        """Constraints: sum of C_i (mean position of side i, m, space axes) = targets.

        shares: pairs (side, C_i), with C_i (l, d), in the plane also (l, 3), whose last column
        multiplies the angle of the side, rad; targets: l functions of time. All conditions are
        added (`_add`) to the same l equations, which `_close` ends.
        """
        for side, C in shares:
            assert side.body is not None
            position, angle = C[:, : self.d], C[:, self.d :]
            if position.any():
                self._add(side.body, MeanPoint(side.point), side.displacement, position)
            if angle.any():
                self._check_angle(side)
                turning = side.turning
                self._add(side.body, Rotation(turning is not None), turning, angle)
        self._close(len(shares[0][1]), targets)

    def meet(
        self, along: FloatArray | None = None, targets: Sequence[Amplitude] = ()
    ) -> None:
        """Coincident points: equal components along directions `along` (l, d) of space (default:
        all).

        For a joint with the ground the components are constant, or follow the functions of time
        `targets`, m. InputError for points that are apart at the start. Two bodies: position of the
        first minus that of the second is zero (signs 1 and -1), so that multipliers are forces on
        the first.
        """
        first, second = self.ends
        if first.body is not None and second.body is not None:
            check_meet(first, second)
        E, sides = np.eye(self.d) if along is None else along, self.signed()
        start = E @ sides[0][0].place() if len(sides) == 1 else np.zeros(len(E))
        self.linear([(side, sign * E) for side, sign in sides],
                    targets or [constant(value) for value in start.tolist()])

    def couple_rotations(self, ratio: float = -1.0, target: Amplitude | None = None) -> None:
        """In the plane: angle_1 + ratio angle_2, rad, is constant; for a joint with the ground the
        angle may follow a function of time."""
        sides = [s for s in (self.first, self.second) if s.body is not None]
        terms = list(zip(sides, [1.0, ratio], strict=False))  # one, for a joint with the ground
        start = sum(factor * float(side.pose[2]) for side, factor in terms)
        self.linear([(side, np.array([[0.0, 0.0, factor]])) for side, factor in terms],
                    [constant(start) if target is None else target])

    def no_turn(self) -> None:
        """Constant relative rotation of the two sides. In space between rigid sides three
        perpendicularity conditions are enough."""
        if self.d == 2:
            self.couple_rotations()
            return
        x, y, z = np.eye(3)
        hold = self.face if self.own.turning is None else self.no_relative_rotation
        hold([y, z, x], [z, x, y])

    # ------------------------------------------------------------------ directions and lines

    def face(self, own: Sequence[FloatArray], other: Sequence[FloatArray]) -> None:
        """Pairs of directions, in space axes at the start, that stay perpendicular."""
        self._face(own, other, np.eye(len(own)))

    def no_relative_rotation(
        self, own: Sequence[FloatArray], other: Sequence[FloatArray],
        turn: Amplitude | None = None, axis: FloatArray | None = None,
    ) -> None:
        """No relative rotation in the plane of each pair (d, e) of directions, in space axes at the
        start: (A d . A_o e - A e . A_o d) / 2 = 0.

        turn, axis: the other body's directions are rotated about `axis` by the angle turn(t), rad.
        """
        half = 0.5 * np.eye(len(own))
        self._face([*own, *other], [*other, *own], np.hstack([half, -half]), turn, axis)

    def _face(
        self, own: Sequence[FloatArray], other: Sequence[FloatArray], C: FloatArray,
        turn: Amplitude | None = None, axis: FloatArray | None = None,
    ) -> None:
        """Constraints C (l, n) @ (A own_k . A_o other_k) = 0 for n pairs of directions, fixed in
        the own and the other side, in space axes at the start; turn, axis: those of the other side
        are rotated about `axis` by turn(t), rad. axes: rotation of a side at the start, so that d @
        axes is d in its axes; far.reads: name of the other body, if its coordinates are unknowns;
        _of_both: adds the constraints, of which the own side's frame evaluates those of both.

        InputError where sides that rotate about z alone cannot satisfy them.
        """
        side, far = self.own, self.other
        across = axis is not None and abs(abs(axis[2]) - 1.0) >= 1e-9
        if side.about_z and across and axis is not None and not self.prescribed:
            raise InputError(f"the body turns about the z axis alone, and about {axis.tolist()} "
                             "it cannot: the axis must be [0, 0, 1]; or give the body a floating "
                             "frame", "axis")
        if side.about_z and far.about_z and not self.prescribed:
            own, other, C = _about_z(own, other, C)
            if not own:
                return
        item = Facing(
            own=np.array(own) @ side.axes, other=np.array(other) @ far.axes,
            others=len(far.pose) if far.reads else 0, place=far.pose,
            turns=side.turning is not None, turn=turn,
            axis=None if axis is None else axis @ far.axes)
        self._of_both(item, side.turning, C)

    def slide(self, lines: Sequence[FloatArray]) -> None:
        """Zero distance of the two points along directions `lines` (space axes at the start) fixed
        in the other body; the ground's point is the initial position of the body's point. base: the
        other point in its body's axes; _of_both: adds the constraints, of which the own side's
        frame evaluates those of both. InputError for points that are apart along them."""
        side, far = self.own, self.other
        assert side.body is not None
        place = side.place() if far.body is None else far.place()
        gap = np.abs(np.array(lines) @ (side.place() - place)).max()
        if gap > NEAR * size_of(side, far):
            raise InputError(
                "the second point does not lie on the line through the first along the axis: they "
                f"are {gap:.3g} m apart across it; correct a pose or the axis", "between")
        item = Slide(
            side.point, lines=np.array(lines) @ far.axes,
            base=(place - far.pose[: self.d]) @ far.axes,
            others=len(far.pose) if far.reads else 0, place=far.pose)
        self._of_both(item, side.displacement, np.eye(len(lines)))

    def add_item(self, side: Side, item: Item, reads: str = "") -> None:
        """Constraint equations item = 0, one for each of its multipliers, evaluated with the frame
        of a side; reads: name of the other body whose rigid coordinates it reads."""
        assert side.body is not None
        self._add(side.body, item, None, np.eye(item.forces), reads)
        self._close(item.forces, [constant(0.0)] * item.forces)

    def _of_both(self, item: Item, vectors: FloatArray | None, C: FloatArray) -> None:
        """Adds constraints evaluated with the own side that read the coordinates of the other;
        vectors, C: as in `Condition`."""
        body = self.own.body
        assert body is not None
        # multipliers act on the first side
        sign = 1.0 if self.own is self.first or self.first.body is None else -1.0
        self._add(body, item, vectors, sign * C, self.other.reads)
        self._close(len(C), [constant(0.0)] * len(C))

    # ------------------------------------------------------------------ the joint

    def add(self, others: "Conditions") -> None:
        """Adds the constraints of another joint after its own."""
        self.made += [(first + self.count, c) for first, c in others.made]
        self._close(others.count, others.targets)

    def joint(self) -> JointPart:
        """The joint with all constraints collected so far, then those of the weld of an
        intermediate frame. made: pairs of the number of the first equation of a condition, and the
        condition, whose C (rows, forces) is extended to all `count` equations."""
        frame: dict[str, Body] = {}
        if self.weld is not None and self.first.body is not None:
            frame[self.first.body.name] = self.first.body
            self.add(self.weld)
        conditions = []
        for first, c in self.made:
            wide = np.zeros((self.count, c.C.shape[1]))
            wide[first : first + len(c.C)] = c.C
            conditions.append(replace(c, C=wide))
        sides = tuple(s for s in self.ends if s.body is not None)
        return JointPart(
            self.name, sides, tuple(conditions), tuple(self.targets), adjusted=frame)

    def _add(
        self, body: Body, item: Item, vectors: FloatArray | None, C: FloatArray,
        reads: str = "",
    ) -> None:
        """Adds a condition to the next constraint equations, which `_close` counts: several
        conditions may be added to the same ones."""
        self.made.append((self.count, Condition(body, item, vectors, C, reads)))

    def _close(self, rows: int, targets: Sequence[Amplitude]) -> None:
        """Ends these constraint equations, of the given number and targets."""
        self.count += rows
        self.targets += targets

    @staticmethod
    def _check_angle(side: Side) -> None:
        """InputError where the rotation of the side is undefined, also if all its points are
        fixed."""
        if side.target is not None:
            side.target.body.rotation_of(side.target.which, side.key)


def conditions_between(
    name: str, between: tuple[str, str], parts: Mapping[str, Part], *,
    dimensions: Sequence[int] = (2, 3), relative: Sequence[int] = (),
) -> Conditions:
    """A joint of two sides, without constraints yet.

    dimensions: dimensions in which the joint exists; relative: dimensions in which it constrains
    directions or lines, for which two flexible sides need an intermediate massless frame: it is
    welded to the first one and then takes its place. InputError as in `sides_of`.
    """
    first, second = sides_of(parts, between, dimensions)
    if first.d not in relative or not (first.flexible and second.flexible):
        return Conditions(name, first, second)
    middle = massless_frame(f"{name}.frame", first)
    weld = Conditions(name, first, middle)
    weld.meet()
    weld.no_turn()
    return Conditions(name, middle, second, weld)


def conditions_on(
    name: str, of: str, parts: Mapping[str, Part], *, dimensions: Sequence[int] = (2, 3)
) -> Conditions:
    """A joint between one set `body:set`, under the scene key `of`, and the ground, without
    constraints yet; dimensions: those in which the joint exists."""
    side = side_of(parts, of, dimensions, "of")
    return Conditions(name, side, Side(None, side.d))


def massless_frame(name: str, side: Side, turns: bool = True) -> Side:
    """Massless frame at the mean point of a side, with the initial motion of that side's body and,
    with `turns`, its axes; else with an angle that is zero at the start (in space about z), which
    d + 1 rigid coordinates have. pose, velocity: rigid coordinates and rates, position first."""
    body, d = side.body, side.d
    assert body is not None
    pose, rate = body.initial().get(f"{body.name}.rigid", (body.pose, 0.0 * body.pose))
    pose, velocity = pose.copy(), rate.copy()
    if not turns:
        pose, velocity = np.zeros(d + 1), np.zeros(d + 1)
    pose[:d] = side.place()
    velocity[:d] = velocity_at(body.pose, rate, side.point)
    frame = FloatingBody(name=name, X=np.zeros((1, d)), inertia=None, pose=pose, velocity=velocity,
                 moves=True, points={"origin": np.array([0])})
    return Side(Place(frame, "origin", name, np.zeros(d)), d)


def _about_z(
    own: Sequence[FloatArray], other: Sequence[FloatArray], C: FloatArray
) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Pairs of directions, in space axes, without those that two sides rotating about z alone
    satisfy identically, and C (l, n), the constraints on their products, without the columns of
    these pairs and without rows that are then zero.

    InputError for a pair that is neither satisfied identically nor in the x-y plane.
    """
    kept: tuple[list[FloatArray], list[FloatArray], list[int]] = [], [], []
    for i, (d, e) in enumerate(zip(own, other, strict=True)):
        # along z and in the x-y plane: a pair of one of each stays perpendicular
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
