"""Trial bases: dictionaries of atoms for one reducible block."""

from typing import Protocol, runtime_checkable

from sparsemor.core.protocols.block_data import BlockData, Dictionary


class Basis(Protocol):
    """Dictionary of one block, built from its snapshots or its matrices.

    needs_snapshots: whether `build` reads `data.snapshots`, so that a training run has to come
    first.
    """

    @property
    def needs_snapshots(self) -> bool: ...
    def build(self, data: BlockData) -> Dictionary: ...


@runtime_checkable
class BoundsAtoms(Protocol):
    """A basis whose number of atoms is bounded by its options, before anything is built.

    Without it, a block of n unknowns is taken to get up to n atoms.
    """

    def most_atoms(self, size: int) -> int | None:
        """Largest number of atoms for a block of `size` unknowns; None where options do not say."""
        ...


@runtime_checkable
class ChecksBlock(Protocol):
    """A basis that refuses unsuitable blocks before any training run."""

    def unfit(self, data: BlockData, snapshots: int) -> str:
        """Why `build` would refuse the block, given so many snapshots (`data` has none of them
        yet), "" where it would not, or where only the snapshots can show it."""
        ...


@runtime_checkable
class CentresSnapshots(Protocol):
    """A basis that may subtract the mean of the snapshots first."""

    @property
    def centred(self) -> bool: ...
