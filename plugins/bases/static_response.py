"""Displacements under constant forces, temperatures under constant heat."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import (
    BlockData,
    BlockSolvers,
    Csr,
    Factorized,
    FloatArray,
    InputError,
    SolveFailed,
    Status,
    solve_or_fail,
)
from sparsemor.plugins.linear_solvers.auto import Auto

NULL_RTOL = 1e-10
"""|K 1|, relative to the largest entry of K, below which uniform temperature conducts nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """x = A^-1 b of one block, by the linear solver that the scene names for it."""

    factor: Factorized
    block: str

    def solve(self, b: FloatArray) -> FloatArray:
        """(n,) or (n, j), as b. Raises SolveFailed where an iteration stops short."""
        return solve_or_fail(self.factor, b, self.block)


def factorize(matrix: Csr, data: BlockData) -> Answers:
    """A matrix on the unknowns of `data`. InputError when it is singular."""
    solvers = BlockSolvers(data.solver or Auto())
    try:
        return Answers(solvers.factorize(data.name, matrix, data.places, "basis"), data.name)
    except SolveFailed as error:
        if error.status is not Status.SINGULAR:
            raise
        raise InputError(
            f"the stiffness of {data.name} is singular: something in it can move without force; "
            "hold it by a reference condition, or use a basis of snapshots") from None


def is_thermal(data: BlockData) -> bool:
    """Temperatures, or anything else of first order in time."""
    return data.order == 1


@dataclass(frozen=True, slots=True, eq=False)
class StaticSolver:
    """x = K^-1 f. An insulated block has K 1 = 0: then x grows uniformly and bends as

        K x = f - C 1 (1.f) / (1.C 1),    1.C x = 0,

    the shape that constant heat tends to, and `uniform` (n,) is 1; None where K is regular.
    """

    factor: Answers
    uniform: FloatArray | None
    growth: FloatArray
    """C 1 / (1.C 1), (n,); empty where K is regular."""

    @classmethod
    def of(cls, data: BlockData) -> "StaticSolver":
        one, K = np.ones(data.size), data.stiffness
        if np.abs(K @ one).max() > NULL_RTOL * np.abs(K.data).max(initial=0.0):
            return cls(factorize(K, data), None, np.zeros(0))
        growth = np.asarray(data.mass @ one)
        growth = growth / growth.sum()
        # K + t (e1 e1^T) pins one temperature: as sparse as K, and exact for balanced heat
        pinned = csr_array(K).copy()
        pinned[0, 0] += float(K.diagonal().max())
        return cls(factorize(pinned, data), one, growth)

    def __call__(self, F: FloatArray) -> FloatArray:
        """Responses (n, j) to the columns of F (n, j)."""
        if self.uniform is None:
            return np.asarray(self.factor.solve(np.ascontiguousarray(F)))
        balanced = F - np.outer(self.growth, F.sum(axis=0))
        X = np.asarray(self.factor.solve(np.ascontiguousarray(balanced)))
        return np.asarray(X - self.growth @ X)
