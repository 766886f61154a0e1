"""Constraint rows with a multiplier each: what a built joint is in the plane and in space alike."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.terms.field_kinds import MULTIPLIER
from sparsemor.core import Block, Equations, Table
from sparsemor.core.protocols.separable import Amplitude


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
        """True if no unknown could satisfy its constraints: in a rigid stage, a joint of bodies
        that do not move there. The flexible stage then has it as a constraint."""
        return not any(b.moves or b.elasticity is not None for b in self.bodies)

    @property
    @abstractmethod
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier."""

    def blocks(self) -> Sequence[Block]:
        if self.reactions is not None or self.inert:
            return ()
        return [Block(self.name, MULTIPLIER, len(self.targets))]

    def contribute(self, equations: Equations) -> None:
        if self.inert:
            return
        if self.reactions is not None:
            self._acting(equations, self.reactions)
            return
        block = f"{self.name}.multiplier"
        self._holding(equations, block)
        equations.constraint(block, self.targets)

    @abstractmethod
    def _holding(self, equations: Equations, multipliers: str) -> None:
        """Contributions of the bodies to the constraint rows, and of the multipliers to theirs."""

    @abstractmethod
    def _acting(self, equations: Equations, reactions: Table) -> None:
        """Prescribed reactions as forces on the sides."""
