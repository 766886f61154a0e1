"""Base class of row samplers: options for rows that are always kept and for whole nodes."""

from abc import abstractmethod

import numpy as np

from sparsemor.core import (
    BlockData,
    Dictionary,
    IntArray,
    RowsKept,
    Sampler,
)
from sparsemor.plugins.samplers.rows_by_node import Required, Unit, kept_rows


class RowSampler(Sampler):
    """Base class of samplers, which select the rows (equations) of a block that a reduced model
    evaluates; a subclass defines `rows_beside`."""

    required: Required = True
    """True: keep the rows that joints and localized loads act on (`ring`: also those of all
    elements along the path of moving loads), and choose the others to complement them. False, with
    `lhs` the published variant: these rows are sampled like all others, and a run without one of
    them may be unstable."""
    unit: Unit = "dof"
    """`dof` selects single rows; `node` selects the rows of a node together."""

    @property
    def keeps(self) -> RowsKept:
        """Rows that a sample contains in addition to those drawn: of joints and localized loads
        (`required`), also of elements along the path of moving loads (`ring`), or `none`."""
        return "ring" if self.required == "ring" else "required" if self.required else "none"

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        """Sorted distinct rows: those always kept and m more. Raises InputError when there are
        fewer."""
        return self.rows_beside(kept_rows(self.required, block, required), block, m, dictionary,
                                rng)

    @abstractmethod
    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        """Sorted rows: those in `kept` and m more."""
