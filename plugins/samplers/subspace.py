"""Base class of samplers that compare rows of the atoms: sampled equations must distinguish
these."""

from abc import abstractmethod
from typing import Literal

import numpy as np
from pydantic import Field

from sparsemor.core import BlockData, Dictionary, FloatArray, InputError, IntArray
from sparsemor.plugins.samplers.base import RowSampler
from sparsemor.plugins.samplers.rows_by_node import GreedyRows, free_rows
from sparsemor.plugins.samplers.smallest_singular_pair import EPS

Of = Literal["operator", "atoms"]


class SpanSampler(RowSampler):
    """Base class of samplers that use the values of the atoms; a subclass defines `choose`."""

    of: Of = "operator"
    """Vectors whose rows are compared: `operator`: D times the atoms, with the operator D of a time
    step; `atoms`: the atoms themselves."""
    leading: int | None = Field(default=None, ge=1)
    """Number of leading atoms whose rows are compared; left out: all. All rows of a complete
    orthonormal basis have the same norm, so that none is better than another: there the atoms that
    carry the snapshots decide."""
    step: float | None = Field(default=None, gt=0.0)
    """Step size h in the operator D, s: stiffness + mass / h^2 for displacements, conductivity +
    capacity / h for temperatures. Left out: the operator of the scene's own step and integrator. A
    tenth or ten times the true one serves nearly as well."""

    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        free = free_rows(block.size, m, kept, block.name)
        rows = GreedyRows.of(block.coordinates, free, m, self.unit)
        self.choose(orthonormal(self._vectors(block, dictionary), block.name), rows, rng)
        return rows.numbers()

    @abstractmethod
    def choose(self, U: FloatArray, rows: GreedyRows, rng: np.random.Generator) -> None:
        """Takes rows until none is `left` to be taken. U (n, k): orthonormal columns."""

    def _vectors(self, block: BlockData, dictionary: Dictionary) -> FloatArray:
        """Vectors (n, k) whose rows are compared; columns that are only round-off are set to
        zero."""
        T = dictionary.atoms[:, : self.leading]
        if self.of == "atoms":
            return T
        D = block.operator
        if self.step is not None:
            # displacements have components, temperatures have none: that decides the order in time
            h = self.step**2 if block.component.any() else self.step
            D = block.stiffness + block.mass / h
        V = np.asarray(D @ T)
        largest = float(abs(D).sum(axis=1).max(initial=0.0)) * np.linalg.norm(T, axis=0)
        return np.where(np.linalg.norm(V, axis=0) > EPS * largest, V, 0.0)


def orthonormal(V: FloatArray, name: str) -> FloatArray:
    """Orthonormal basis Q (n, r): its first columns span the first independent columns of V (n, k).

    The order of the atoms is kept, and columns that depend on earlier ones are left out. Raises
    InputError when V is zero.
    """
    norms = np.linalg.norm(V, axis=0)
    V = V[:, norms > 0.0] / norms[norms > 0.0]
    if V.shape[1] == 0:
        raise InputError(f"all atoms of {name} vanish under its operator, so that no row is better "
                         "than another: use sampler: lhs", "sampler")
    Q, R = np.linalg.qr(V)
    fresh = np.zeros(V.shape[1], dtype=bool)
    fresh[: R.shape[0]] = np.abs(np.diag(R)) > max(V.shape) * EPS
    # a dependent column leaves a column of noise in Q, which later ones would be cleared of
    return np.asarray(Q if fresh.all() else np.linalg.qr(V[:, fresh])[0])
