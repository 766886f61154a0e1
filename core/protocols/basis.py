"""Interfaces of trial bases: sets of trial vectors (atoms) for one block of unknowns."""

from typing import Protocol, runtime_checkable

from sparsemor.core.protocols.block_data import BlockData, Dictionary


class Basis(Protocol):
    """Trial basis of one block of unknowns, built from its snapshots or its matrices.

    needs_snapshots: True if `build` reads `data.snapshots`, so that a training run is required.
    """

    @property
    def needs_snapshots(self) -> bool: ...
    def build(self, data: BlockData) -> Dictionary: ...


@runtime_checkable
class BoundsAtoms(Protocol):
    """A basis whose options bound the number of its atoms (trial vectors) before it is built.

    Without it, up to n atoms are assumed for a block of n unknowns.
    """

    def most_atoms(self, size: int) -> int | None:
        """Largest number of atoms for a block of `size` unknowns; None if the options do not bound
        it."""
        ...


@runtime_checkable
class ChecksBlock(Protocol):
    """A basis that rejects unsuitable blocks of unknowns before any training run."""

    def unfit(self, data: BlockData, snapshots: int) -> str:
        """Reason why `build` would reject the block with so many snapshots (`data` has none yet);
        "" if it would not, or if only the snapshots can show it."""
        ...


@runtime_checkable
class CombinesBases(Protocol):
    """A basis made of others, which can do without those that do not fit a block."""

    def fitting(self, data: BlockData, snapshots: int) -> Basis | None:
        """This basis without those whose `build` would reject the block, None if no other is left.
        """
        ...


@runtime_checkable
class CentresSnapshots(Protocol):
    """A basis that may subtract the mean of the snapshots before it is computed."""

    @property
    def centred(self) -> bool: ...
