"""Constraints between attachments: what a built joint is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.frames.plane_items import Reaction
from sparsemor.bodies.joints.constraint import Constraint
from sparsemor.bodies.planar_body import PlanarBody
from sparsemor.bodies.targets import Target
from sparsemor.core import Equations, FloatArray, Table
from sparsemor.core.protocols.separable import Amplitude


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
class JointPart(Constraint):
    """In the plane: sum_i C_i (position, angle of attachment i), i over the ends.

    A multiplier is a force (N) or moment (N m); so are reactions: multipliers (T, l).
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
    def components(self) -> tuple[tuple[str, str], ...]:
        wide = [np.pad(np.abs(end.C), ((0, 0), (0, 3 - end.C.shape[1]))) for end in self.ends]
        return tuple(named_row(row) for row in np.sum(wide, axis=0))

    @property
    def bodies(self) -> Sequence[AnyBody]:
        return [end.target.body for end in self.ends]

    def _holding(self, equations: Equations, multipliers: str) -> None:
        for end in self.ends:
            item, vectors = end.body.attachment(end.target.mean(), end.C.shape[1] == 3)
            end.body.frame_item(equations, item, vectors, multipliers=multipliers, C=end.C)

    def _acting(self, equations: Equations, reactions: Table) -> None:
        for end in self.ends:
            _reaction(end, reactions, equations)


def named_row(row: FloatArray) -> tuple[str, str]:
    """Name and unit of the multiplier of a constraint row (3,) on x, y and the angle."""
    along = np.flatnonzero(row)
    if len(along) == 1:
        return (("force x", "N"), ("force y", "N"), ("moment", "N m"))[along[0]]
    return ("force", "N") if len(along) and along[-1] < 2 else ("force and moment", "N or N m")


def _reaction(end: End, multipliers: Table, equations: Equations) -> None:
    """The force of a joint on one of its sides: its multipliers through the side's share of the
    constraint rows."""
    item, vectors = end.body.attachment(end.target.mean(), end.C.shape[1] == 3)
    known = Reaction(item.point, multipliers.through(end.C.T))
    end.body.frame_item(equations, known, vectors)
