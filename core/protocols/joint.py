"""Contracts of joints: options of a joint, and the built joint."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.body import Part
from sparsemor.core.protocols.connector import Connector, ConnectorPlugin
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.prescribed_motion import FrameHistory


class ForceLaw(Protocol):
    """Force of a force element, such as a spring, as a function of the motion of its two sides."""

    def __call__(
        self, times: FloatArray, motion: Sequence[tuple[FloatArray, FloatArray]]
    ) -> FloatArray:
        """Force (T,), N or N m, at times (T,), s. motion: of each side rigid coordinates and their
        rates (T, n)."""
        ...

    def bounded_angle(
        self, times: FloatArray, own: FloatArray, other: FloatArray
    ) -> FloatArray | None:
        """Angles (T,), rad, on which the force depends at times (T,), s, for poses (T, n) of its
        two sides, where these determine it between -2 pi and 2 pi only; else None."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class RecordedForce:
    """Force of a force element, recorded with the results: its law, its name and unit, such as
    ("tension", "N"), and for each side the block of its rigid coordinates, or its motion where it
    is no unknown."""

    law: ForceLaw
    component: tuple[str, str]
    moved_by: tuple[str | FrameHistory, str | FrameHistory]


class Joint(Connector):
    """A built joint: constraint equations with one Lagrange multiplier each, in a block of unknowns
    `name.multiplier`; or a force element, such as a spring, without constraints."""

    __slots__ = ()

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier, such as ("force x", "N"); () if they are not named."""
        return ()

    @property
    def force(self) -> RecordedForce | None:
        """Force that is no multiplier but follows from the motion of its sides; None if there is
        none to record."""
        return None

    def compliant(self, compliance: FloatArray, note: Note | None) -> "Joint | None":
        """The joint with constraints g = compliance * multipliers, (l,), m/N or rad/(N m), because
        they depend on those of other joints: multipliers are then those of least norm. note: a
        warning about that. None if it cannot be."""
        return None

    def known(self, reactions: Table) -> "Joint | None":
        """The joint replaced by prescribed reactions (T, reaction_count), N and N m, without
        unknowns, as after a rigid-body pre-simulation; None if it cannot be."""
        return None

    @property
    def reaction_count(self) -> int:
        """Number of reaction components that `known` takes; by default one for each multiplier."""
        return sum(block.size for block in self.blocks())

    def reactions_passed_on(
        self, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Reactions (T, reaction_count) for `known`, from multipliers (T, l) and the bodies' poses
        (T, n) at times (T,), s; by default the multipliers."""
        return multipliers


class JointPlugin(ConnectorPlugin):
    """Options of a joint, from which `build` makes the joint once the bodies are built."""

    @abstractmethod
    def build(self, name: str, parts: Mapping[str, Part]) -> Joint: ...
