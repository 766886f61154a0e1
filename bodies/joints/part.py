"""Constraints between attachments: what a built joint is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.linear_term import LinearEquations, LinearTerm
from sparsemor.bodies.targets import Target
from sparsemor.core.arrays import FloatArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.separable import Amplitude


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
    sampled, because a joint's reaction acts on few unknowns.
    """

    name: str
    ends: tuple[End, ...]
    targets: tuple[Amplitude, ...]
    localized: bool = True

    def blocks(self) -> Sequence[Block]:
        return [Block(self.name, "multiplier", len(self.targets))]

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
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
