"""Interfaces of joints: options of a joint, the built joint, and optional methods."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.part import Part
from sparsemor.core.protocols.prescribed_motion import FrameHistory


class JointPlugin(Protocol):
    """Options of a joint, from which `build` makes the joint once the bodies are built. parts:
    bodies by name. InputError keys are relative to the joint's own input entry (`between`)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> "Joint": ...


class Joint(Part, Protocol):
    """A built joint: constraint equations with one Lagrange multiplier each, in a block of unknowns
    `name.multiplier`; or a force element, such as a spring, without constraints."""


@runtime_checkable
class NamesMultipliers(Protocol):
    """A built joint with a name and unit for each of its Lagrange multipliers."""

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier, such as ("force x", "N")."""
        ...


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


@runtime_checkable
class HasForceLaw(Protocol):
    """A built joint whose force is no multiplier but follows from the motion of its sides. It is
    recorded with the results."""

    @property
    def law(self) -> ForceLaw: ...
    @property
    def recorded(self) -> tuple[str, str]:
        """Name and unit of the force, such as ("tension", "N")."""
        ...

    @property
    def moved_by(self) -> tuple[str | FrameHistory, str | FrameHistory]:
        """Block of rigid coordinates of each side, or its motion where it is no unknown."""
        ...


@runtime_checkable
class PrescribesReactions(Protocol):
    """A built joint that can be replaced by its reaction forces, as after a rigid-body
    pre-simulation."""

    def known(self, reactions: Table) -> Part:
        """Joint replaced by prescribed reactions (T, l), N and N m, without unknowns."""
        ...


@runtime_checkable
class PassesReactionsOn(Protocol):
    """A built joint whose prescribed reactions differ from its multipliers and are computed from
    them."""

    @property
    def reaction_count(self) -> int:
        """Number of reaction components that `PrescribesReactions.known` takes."""
        ...

    def reactions_passed_on(
        self, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Reactions (T, reaction_count) for `PrescribesReactions.known`, from multipliers (T, l)
        and the bodies' poses (T, n) at times (T,), s."""
        ...
