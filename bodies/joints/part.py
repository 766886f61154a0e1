"""Constraints between attachments: what a built joint is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.linear_term import LinearEquations, LinearTerm
from sparsemor.bodies.planar.items import Reaction
from sparsemor.bodies.targets import Target
from sparsemor.core.arrays import FloatArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.separable import Amplitude
from sparsemor.core.tables import Table


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """One attachment of a joint. C (l, 2) or (l, 3): its share of the l constraint rows."""

    target: Target
    C: FloatArray

    @property
    def body(self) -> PlanarBody:
        assert isinstance(self.target.body, PlanarBody)
        return self.target.body


@dataclass(frozen=True, slots=True, eq=False)
class JointPart:
    """Rows sum_i C_i (position, angle of attachment i) - targets(t) = 0, with l multipliers.

    A multiplier is a force (N) or moment (N m). localized: its rows are kept when rows are
    sampled, because a joint's reaction acts on few unknowns. reactions: multipliers (T, l) that are
    known: then they are forces on each side, and there is neither an unknown nor a constraint.
    """

    name: str
    ends: tuple[End, ...]
    targets: tuple[Amplitude, ...]
    localized: bool = True
    reactions: Table | None = None

    def known(self, reactions: Table) -> "JointPart":
        """The same joint with multipliers (T, l) that are given, N and N m."""
        return replace(self, reactions=reactions)

    @property
    def inert(self) -> bool:
        """Whether no unknown could satisfy its constraints: in a rigid stage, a joint of bodies
        that do not move there. The flexible stage then has it as a constraint."""
        bodies = [end.target.body for end in self.ends]
        return not any(b.moves or b.elasticity is not None for b in bodies)

    def blocks(self) -> Sequence[Block]:
        if self.reactions is not None or self.inert:
            return ()
        return [Block(self.name, "multiplier", len(self.targets))]

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        if self.inert:
            return []
        if self.reactions is not None:
            return [_reaction(end, self.reactions, layout) for end in self.ends]
        lam = np.arange(layout.size)[layout[f"{self.name}.multiplier"]]
        terms: list[Term] = []
        for end in self.ends:
            body = end.body
            item, vectors = body.attachment(end.target.mean(), end.C.shape[1] == 3)
            terms.append(body.frame_term(layout, item, vectors, lam, end.C))
        n = len(self.targets)
        empty = np.zeros((n, 0))
        terms.append(LinearTerm(self.name, lam, np.zeros(0, np.int64), LinearEquations(
            empty, empty, np.zeros(n), np.eye(n), self.targets)))
        return terms


def _reaction(end: End, multipliers: Table, layout: Layout) -> Term:
    """The force of a joint on one of its sides: its multipliers through the side's share of the
    constraint rows."""
    item, vectors = end.body.attachment(end.target.mean(), end.C.shape[1] == 3)
    known = Reaction(item.point, multipliers.through(end.C.T))
    return end.body.frame_term(layout, known, vectors)
