"""Force elements: forces between two sides by a law, without a constraint between them.

The law acts on rigid coordinates. A flexible side is represented by a massless frame that is
constrained to its set; the multipliers are the forces that it passes on.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.joints.conditions import Conditions, constant, massless_frame
from sparsemor.bodies.joints.part import JointPart
from sparsemor.bodies.joints.side import Side, sides_of
from sparsemor.core import Block, Equations, FrameItem, InputError, Part, Plugin, TimeFunction


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Prescribed part of the force of a spring: factor load(t) - k s(t) - c s'(t), with its length
    or angle at rest s = offset + sign rest(t), stiffness k and damping c."""

    stiffness: float
    damping: float
    offset: float
    rest: TimeFunction | None
    load: TimeFunction | None
    sign: float = 1.0
    factor: float = 1.0

    def __call__(self, t: float) -> float:
        f = -self.stiffness * self.offset
        if self.rest is not None:
            f -= self.sign * (
                self.stiffness * self.rest.value(t) + self.damping * self.rest.rate(t))
        return f if self.load is None else f + self.factor * self.load.value(t)


@dataclass(frozen=True, slots=True, eq=False)
class ForceElementPart:
    """Force element of a scene: an item of the frame of body `own`, which reads the coordinates of
    body `reads` ("" for one at rest). held: constraints of massless frames, None for rigid sides;
    adjusted: these frames."""

    name: str
    own: Body
    item: FrameItem
    reads: str
    held: JointPart | None
    adjusted: Mapping[str, Body] = field(default_factory=dict)
    localized: bool = True

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier."""
        return () if self.held is None else self.held.components

    def blocks(self) -> Sequence[Block]:
        return () if self.held is None else self.held.blocks()

    def contribute(self, equations: Equations) -> None:
        if self.held is not None:
            self.held.contribute(equations)
        self.own.frame_item(equations, self.item, None,
                            reads=f"{self.reads}.rigid" if self.reads else "")


class ForceElement(Plugin):
    """Base class of force elements between two of `body:set` and `ground`.

    dimensions: dimensions in which it exists; turns: True if it acts on rotations, False if on
    points.
    """

    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    turns: ClassVar[bool] = False

    between: tuple[str, str]
    """The two sides: each a set `body:set`, or `ground`."""

    def build(self, name: str, parts: Mapping[str, Part]) -> ForceElementPart:
        ends = sides_of(parts, self.between, self.dimensions)
        if any(s.body is not None and s.body.guide is not None for s in ends):
            raise InputError(
                "a force element of bodies whose motion is computed in a rigid stage: drop "
                "rigid_stage from the scene")
        sides, held, frames = [], [], {}
        for end, which in zip(ends, ("first", "second"), strict=True):
            if not end.flexible:
                sides.append(end)
                continue
            frame = massless_frame(f"{name}.{which}", end, self.turns)
            assert frame.body is not None
            sides.append(frame)
            held.append(self._held(name, end, frame))
            frames[frame.body.name] = frame.body
        for more in held[1:]:
            held[0].add(more)
        own, other = sides if sides[0].reads else sides[::-1]
        if own.body is None or not own.reads:
            raise InputError("no side can move", "between")
        item = self.item(own, other, own is sides[0])
        return ForceElementPart(
            name, own.body, item, other.reads, held[0].joint() if held else None, frames)

    @abstractmethod
    def item(self, own: Side, other: Side, first: bool) -> FrameItem:
        """Item of the frame of `own`, which moves; first: True if it is the first side of the
        scene."""

    def _held(self, name: str, end: Side, frame: Side) -> Conditions:
        """Constraints of a massless frame to a flexible side; its rotation is that of the set, or
        zero."""
        made = Conditions(name, end, frame)
        made.meet()
        if self.turns:
            made.no_turn()
        elif end.d == 2:
            made.linear([(frame, np.array([[0.0, 0.0, 1.0]]))], [constant(0.0)])
        else:
            x, y, _ = np.eye(3)
            still = Conditions(name, frame, Side(None, 3))
            still.no_relative_rotation([x], [y])
            made.add(still)
        return made
