"""What a built joint in space is: conditions of bodies, summed to constraint rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from sparsemor.bodies.linear_term import LinearEquations, LinearTerm
from sparsemor.bodies.spatial.body import NO_NUMBERS, SpatialBody
from sparsemor.bodies.spatial.items import Item
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
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
    without mass between two flexible bodies; the rows of its weld come last."""

    name: str
    conditions: tuple[Condition, ...]
    targets: tuple[Amplitude, ...]
    adjusted: Mapping[str, SpatialBody] = field(default_factory=dict)
    localized: bool = True

    def known(self, reactions: Table) -> NoReturn:
        """InputError: its forces cannot be given, as those of a plane joint can."""
        raise InputError("the joint is in space, and a rigid stage is known for plane bodies only: "
                         "drop rigid_stage, or give its bodies in the plane")

    def blocks(self) -> Sequence[Block]:
        return [Block(self.name, "multiplier", len(self.targets))]

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
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
