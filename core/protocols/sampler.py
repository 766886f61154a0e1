"""Interfaces of samplers, which select rows of the equations for hyper-reduction, and of
preconditioners of the sampled rows."""

from typing import Literal, Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.block_data import BlockData, Dictionary

RowsKept = Literal["none", "required", "ring"]
"""Rows that are always kept in addition to the sampled ones: none; those that joints and localized
loads act on; or these and all rows of elements along the path of moving loads."""


class Sampler(Protocol):
    """Selection of equation rows of one block of unknowns: all rows `required` and `m` further
    ones, sorted and distinct."""

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
    """A sampler that may keep other rows than those that joints and localized loads act on."""

    @property
    def keeps(self) -> RowsKept: ...


@runtime_checkable
class SamplesNodes(Protocol):
    """A sampler that can select all rows of a mesh node together."""

    @property
    def unit(self) -> Literal["dof", "node"]:
        """"node" if all rows of a node are selected together, "dof" if rows are selected
        separately."""
        ...


@runtime_checkable
class DrawsRequired(Protocol):
    """A sampler with the option `required`: True if the rows of joints and localized loads are
    always kept, False if they are sampled like all others."""

    @property
    def required(self) -> bool: ...


class Preconditioner(Protocol):
    """Left preconditioner of the sampled equations: nonsingular P (m, m) for the matrix A (m, k) of
    m sampled rows and k atoms (trial vectors). Where it is defined for m <= k only, m = k
    compressed rows are given to it."""

    def check(self, rows: int, atoms: int) -> str:
        """Reason why P is not defined for this number of rows and atoms, "" if it is."""
        ...

    def build(self, A: FloatArray) -> FloatArray: ...
