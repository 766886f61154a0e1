"""Interfaces of samplers, which select rows of the equations for hyper-reduction, and of
preconditioners of the sampled rows."""

from abc import abstractmethod
from typing import Literal

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.basis import BlockData, Dictionary
from sparsemor.core.protocols.plugin import Plugin

RowsKept = Literal["none", "required", "ring"]
"""Rows that are always kept in addition to the sampled ones: none; those that joints and localized
loads act on; or these and all rows of elements along the path of moving loads."""


class Sampler(Plugin):
    """Selection of equation rows of one block of unknowns."""

    @property
    def keeps(self) -> RowsKept:
        """Rows that a sample contains in addition to the m drawn ones: none of them, the required
        ones, or these and the ring, all rows of elements along the path of moving loads."""
        return "required"

    @property
    def whole_nodes(self) -> bool:
        """True if the rows of a node are drawn together."""
        return False

    @abstractmethod
    def sample(
        self, block: BlockData, m: int, dictionary: Dictionary, rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        """Row numbers of `block`, sorted and distinct: all rows `required`, and m more. dictionary:
        trial basis of the block."""


class Preconditioner(Plugin):
    """Left preconditioner of the sampled equations: nonsingular P (m, m) for the matrix A (m, k) of
    m sampled rows and k atoms (trial vectors). Where it is defined for m <= k only, m = k
    compressed rows are given to it."""

    def check(self, rows: int, atoms: int) -> str:
        """Reason why P is not defined for this number of rows and atoms, "" if it is."""
        return ""

    @abstractmethod
    def build(self, A: FloatArray) -> FloatArray:
        """Matrix P (m, m) for A (m, k)."""
