"""Interfaces of trial bases: sets of trial vectors (atoms) for one block of unknowns."""

from abc import abstractmethod

from sparsemor.core.protocols.block_data import BlockData, Dictionary
from sparsemor.core.protocols.plugin import Plugin


class Basis(Plugin):
    """Trial basis of one block of unknowns, built from its snapshots or its matrices."""

    @property
    def needs_snapshots(self) -> bool:
        """True if `build` reads `data.snapshots`, so that a training run is required."""
        return True

    @abstractmethod
    def build(self, data: BlockData) -> Dictionary:
        """Dictionary of a block. Raises InputError for a block that it does not suit."""

    def most_atoms(self, size: int) -> int | None:
        """Largest number of atoms (trial vectors) for a block of `size` unknowns; None if the
        options do not bound it."""
        return None

    def unfit(self, data: BlockData) -> str:
        """Reason why `build` would reject the block, whose `data` have no snapshots yet; "" if it
        would not, or if only the snapshots can show it."""
        return ""

    def fitting(self, data: BlockData) -> "Basis | None":
        """What remains of this basis for a block that it does not fit: of a basis made of others,
        those that do; None if nothing remains."""
        return None
