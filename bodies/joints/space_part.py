"""Built joint in space: conditions of bodies, summed to constraint rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames.constraints import Slide
from sparsemor.bodies.frames.items import Attachment, Item, Reaction
from sparsemor.bodies.joints.constraint import Constraint
from sparsemor.bodies.joints.space_attachment import Side
from sparsemor.bodies.joints.wrench import SIZE, holding, wrenches
from sparsemor.bodies.spatial_body import SpatialBody
from sparsemor.core import Equations, FloatArray, Table
from sparsemor.core.protocols.separable import Amplitude


@dataclass(frozen=True, slots=True, eq=False)
class Condition:
    """One item of a body with its nodal directions; rows of the joint are C (l, forces) @ its
    rows. other: the body whose rigid coordinates it reads, "" for none."""

    body: SpatialBody
    item: Item
    vectors: FloatArray | None
    C: FloatArray
    other: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class SpaceJoint(Constraint):
    """In space: the sum of the conditions. Multipliers are forces on the first side (N, space
    axes), then moments (N m) or forces across the lines (N). adjusted: a frame without mass between
    two flexible bodies; the rows of its weld come last. sides: those with a body; reactions: force
    and moment (wrench.py) on each of them."""

    name: str
    sides: tuple[Side, ...]
    conditions: tuple[Condition, ...]
    targets: tuple[Amplitude, ...]
    adjusted: Mapping[str, SpatialBody] = field(default_factory=dict)
    localized: bool = True
    reactions: Table | None = None

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        return tuple(self._component(row) for row in range(len(self.targets)))

    def _component(self, row: int) -> tuple[str, str]:
        """Coordinates give forces along the axes of space, lines forces across them, pairs of
        directions moments."""
        c = next(c for c in self.conditions if c.C[row].any())
        if isinstance(c.item, Attachment):
            along = np.flatnonzero(c.C[row])
            return ("force " + "xyz"[along[0]], "N") if len(along) == 1 else ("force", "N")
        return ("force across the axis", "N") if isinstance(c.item, Slide) else ("moment", "N m")

    @property
    def reaction_count(self) -> int:
        """Columns that `known` takes. InputError for an item that has no wrench."""
        for c in self.conditions:
            holding(c.item)
        return SIZE * len(self.sides)

    def reactions_passed_on(
        self, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
    ) -> FloatArray:
        """(T, 6 s) what `known` takes, of multipliers (T, l) along a motion (T, n)."""
        return wrenches(self, times, multipliers, poses)

    def known(self, reactions: Table) -> "SpaceJoint":
        """The same joint with forces and moments on its sides that are given."""
        return replace(self, reactions=reactions, adjusted={})

    @property
    def bodies(self) -> Sequence[AnyBody]:
        return [side.body for side in self.sides if side.body is not None]

    def _holding(self, equations: Equations, multipliers: str) -> None:
        for c in self.conditions:
            c.body.frame_item(equations, c.item, c.vectors, multipliers=multipliers, C=c.C,
                              reads=f"{c.other}.rigid" if c.other else "")

    def _acting(self, equations: Equations, reactions: Table) -> None:
        for i, side in enumerate(self.sides):
            self._reaction(equations, side, i, reactions)

    def _reaction(
        self, equations: Equations, side: Side, number: int, reactions: Table
    ) -> None:
        """Prescribed reactions on the displacements of a side; none where these are fixed."""
        if not side.flexible or side.body is None:
            return
        mine = reactions.columns(SIZE * number + np.arange(SIZE))
        vectors = nodal.along(side.mean())
        # a joint that lets its sides turn makes no moment, and its set may be a single point
        turning = None if all(isinstance(c.item, Attachment) for c in self.conditions) else (
            side.turning)
        if turning is not None:
            vectors = np.concatenate([vectors, turning], axis=1)
        side.body.frame_item(equations, Reaction(mine, turning is not None), vectors)
