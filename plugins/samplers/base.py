"""Options and frame of all samplers here: which rows stay unasked, and what is taken at once."""

from abc import abstractmethod

import numpy as np

from sparsemor.core import BlockData, Dictionary, IntArray, Plugin, RowsKept
from sparsemor.plugins.samplers.row_pool import Required, Unit, kept_rows


class RowSampler(Plugin):
    """Keeps rows by option; a subclass fills `rows_beside`."""

    required: Required = True
    """Keep the rows that joints and localized loads act on (`ring`: also those of all elements
    along the path of moving loads), and choose the others to complement them. False, with `lhs` the
    published variant: they are treated like any other, and a run without one of them may be
    unstable."""
    unit: Unit = "dof"
    """`dof` takes single rows; `node` takes the rows of a node together."""

    @property
    def keeps(self) -> RowsKept:
        """Rows that a sample contains in addition to those drawn."""
        return "ring" if self.required == "ring" else "required" if self.required else "none"

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        """Sorted distinct rows: the required ones and m more. InputError when there are fewer."""
        return self.rows_beside(kept_rows(self.required, block, required), block, m, dictionary,
                                rng)

    @abstractmethod
    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        """The rows that are kept and m more, sorted."""
