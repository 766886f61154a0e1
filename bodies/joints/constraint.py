"""Constraint rows with a multiplier each: what a built joint is in the plane and in space alike."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.linear_term import LinearEquations, LinearTerm
from sparsemor.core.arrays import IntArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.separable import Amplitude
from sparsemor.core.tables import Table


class Constraint(ABC):
    """Rows: what the bodies do - targets(t) = 0, with as many multipliers.

    localized: its rows are kept when rows are sampled, because a joint's reaction acts on few
    unknowns. reactions: what acts on its sides when that is known: then there is neither an unknown
    nor a constraint.
    """

    __slots__ = ()  # the fields are those of the joints, in the order that each takes them
    name: str
    targets: tuple[Amplitude, ...]
    localized: bool
    reactions: Table | None

    @property
    @abstractmethod
    def bodies(self) -> Sequence[AnyBody]:
        """Those that it holds."""

    @property
    def inert(self) -> bool:
        """Whether no unknown could satisfy its constraints: in a rigid stage, a joint of bodies
        that do not move there. The flexible stage then has it as a constraint."""
        return not any(b.moves or b.elasticity is not None for b in self.bodies)

    @property
    @abstractmethod
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier."""

    def blocks(self) -> Sequence[Block]:
        if self.reactions is not None or self.inert:
            return ()
        return [Block(self.name, "multiplier", len(self.targets))]

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        if self.inert:
            return []
        if self.reactions is not None:
            return self._acting(layout, self.reactions)
        multipliers = np.arange(layout.size)[layout[f"{self.name}.multiplier"]]
        n = len(self.targets)
        empty = np.zeros((n, 0))
        told = LinearTerm(self.name, multipliers, np.zeros(0, np.int64), LinearEquations(
            empty, empty, np.zeros(n), np.eye(n), self.targets))
        return [*self._holding(layout, multipliers), told]

    @abstractmethod
    def _holding(self, layout: Layout, multipliers: IntArray) -> Sequence[Term]:
        """What the bodies put into the rows, and the multipliers (l,), global numbers, into theirs.
        """

    @abstractmethod
    def _acting(self, layout: Layout, reactions: Table) -> Sequence[Term]:
        """Known reactions as forces on the sides."""
