"""Row sampling of one reducible block, and preconditioners of its sampled rows."""

from typing import Literal, Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.block_data import BlockData, Dictionary

RowsKept = Literal["none", "required", "ring"]
"""Rows that a sample contains in addition to those drawn: none, the required ones (joints and
localized loads), or these and all rows of elements along the path of moving loads."""


class Sampler(Protocol):
    """Row selection of one block: all of `required` and `m` more, sorted, distinct."""

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray: ...


@runtime_checkable
class ChoosesRowsKept(Protocol):
    """A sampler that does not simply keep all required rows."""

    @property
    def keeps(self) -> RowsKept: ...


@runtime_checkable
class SamplesNodes(Protocol):
    """A sampler that can take all rows of a node together."""

    @property
    def unit(self) -> Literal["dof", "node"]:
        """"node" where the rows of a node are taken together, "dof" where each stands alone."""
        ...


@runtime_checkable
class DrawsRequired(Protocol):
    """A sampler with the option `required`: prescribed rows are kept, or drawn like all others."""

    @property
    def required(self) -> bool: ...


class Preconditioner(Protocol):
    """P (m, m), nonsingular, for sampled rows A (m, k) applied to the atoms."""

    def check(self, rows: int, atoms: int) -> str:
        """"" when it is defined for this shape, else the reason in words."""
        ...

    def build(self, A: FloatArray) -> FloatArray: ...
