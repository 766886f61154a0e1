"""Joints: the plugin of a scene's entry, the built joint, and its optional abilities."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.part import Part


class JointPlugin(Protocol):
    """A joint of the scene, built once its bodies are. InputError keys are relative to its own
    entry (`between`)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> "Joint": ...


class Joint(Part, Protocol):
    """A built joint: constraint rows with one multiplier each, in a block `name.multiplier`."""


@runtime_checkable
class NamesMultipliers(Protocol):
    """A built joint with a name and a unit for each of its multipliers."""

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier, such as ("force x", "N")."""
        ...


@runtime_checkable
class PrescribesReactions(Protocol):
    """A built joint that can be replaced by its reaction forces, as the flexible stage does."""

    def known(self, reactions: Table) -> Part:
        """The same joint with prescribed reactions (T, l), N and N m, and no unknowns."""
        ...


@runtime_checkable
class PassesReactionsOn(Protocol):
    """A built joint whose prescribed reactions are not its multipliers but made from them."""

    @property
    def reaction_count(self) -> int:
        """Number of columns that `known` takes."""
        ...

    def reactions_passed_on(
        self, times: FloatArray, multipliers: FloatArray, poses: Mapping[str, FloatArray]
    ) -> FloatArray:
        """(T, columns) for `known`, from multipliers (T, l) and body poses (T, n) at times (T,)."""
        ...
