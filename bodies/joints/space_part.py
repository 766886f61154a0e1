"""What a built joint in space is: conditions of bodies, summed to constraint rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sparsemor.bodies.body import NO_NUMBERS
from sparsemor.bodies.joints.sides import Side
from sparsemor.bodies.joints.wrench import SIZE, wrenches
from sparsemor.bodies.linear_term import LinearEquations, LinearTerm
from sparsemor.bodies.spatial import nodal
from sparsemor.bodies.spatial.body import SpatialBody
from sparsemor.bodies.spatial.items import Attachment, Item, Reaction
from sparsemor.core.arrays import FloatArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.separable import Amplitude
from sparsemor.core.tables import Table


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
class SpaceJoint:
    """Rows: sum of the conditions - targets(t) = 0, with as many multipliers: forces on the first
    side (N, space axes), then moments (N m) or forces across the lines (N). adjusted: a frame
    without mass between two flexible bodies; the rows of its weld come last. sides: those with a
    body; reactions: force and moment (wrench.py) on each of them that are known: then they act,
    and there is neither an unknown nor a constraint."""

    name: str
    sides: tuple[Side, ...]
    conditions: tuple[Condition, ...]
    targets: tuple[Amplitude, ...]
    adjusted: Mapping[str, SpatialBody] = field(default_factory=dict)
    localized: bool = True
    reactions: Table | None = None

    @property
    def handed(self) -> int:
        """Columns that `known` takes."""
        return SIZE * len(self.sides)

    def handed_on(
        self, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
    ) -> FloatArray:
        """(T, 6 s) what `known` takes, of multipliers (T, l) along a motion (T, n)."""
        return wrenches(self, times, multipliers, poses)

    def known(self, reactions: Table) -> "SpaceJoint":
        """The same joint with forces and moments on its sides that are given."""
        return replace(self, reactions=reactions, adjusted={})

    @property
    def inert(self) -> bool:
        """Whether no unknown could satisfy its constraints (as JointPart.inert)."""
        bodies = [side.body for side in self.sides if side.body is not None]
        return not any(b.moves or b.elasticity is not None for b in bodies)

    def blocks(self) -> Sequence[Block]:
        if self.reactions is not None or self.inert:
            return ()
        return [Block(self.name, "multiplier", len(self.targets))]

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        if self.inert:
            return []
        if self.reactions is not None:
            return [t for i, side in enumerate(self.sides)
                    for t in self._reaction(layout, side, i, self.reactions)]
        lam = np.arange(layout.size)[layout[f"{self.name}.multiplier"]]
        terms: list[Term] = []
        for c in self.conditions:
            read = np.arange(layout.size)[layout[f"{c.other}.rigid"]] if c.other else NO_NUMBERS
            terms.append(c.body.frame_term(layout, c.item, c.vectors, lam, c.C, read))
        n = len(self.targets)
        empty = np.zeros((n, 0))
        terms.append(LinearTerm(self.name, lam, np.zeros(0, np.int64), LinearEquations(
            empty, empty, np.zeros(n), np.eye(n), self.targets)))
        return terms

    def _reaction(
        self, layout: Layout, side: Side, number: int, reactions: Table
    ) -> Sequence[Term]:
        """What is known acts on the displacements of a side; nothing where they are held."""
        if not side.flexible or side.body is None:
            return ()
        mine = reactions.columns(SIZE * number + np.arange(SIZE))
        vectors = nodal.along(side.mean())
        # a joint that lets its sides turn makes no moment, and its set may be a single point
        turning = None if all(isinstance(c.item, Attachment) for c in self.conditions) else (
            side.turning)
        if turning is not None:
            vectors = np.concatenate([vectors, turning], axis=1)
        return [side.body.frame_term(layout, Reaction(mine, turning is not None), vectors)]
