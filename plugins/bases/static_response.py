"""Static responses: displacements under constant forces, temperatures under constant heat."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import BlockData, Csr, Factorized, FloatArray, InputError, SolveFailed, Status
from sparsemor.core.model.factorizations import BlockSolvers, solve_or_fail
from sparsemor.plugins.linear_solvers.auto import AutomaticSolver

NULL_RTOL = 1e-10
"""|K 1| relative to the largest entry of K, below which a uniform temperature causes no heat flow
(insulated body, singular K)."""


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """Factorized matrix A of one block, for x = A^-1 b by the linear solver that the scene
    selects."""

    factor: Factorized
    block: str

    def solve(self, b: FloatArray) -> FloatArray:
        """Solution x of A x = b, (n,) or (n, j) as b. Raises SolveFailed if an iteration does not
        converge."""
        return solve_or_fail(self.factor, b, self.block)


def factorize(matrix: Csr, data: BlockData) -> Answers:
    """Factorization of a matrix on the unknowns of `data`. Raises InputError when it is
    singular."""
    solvers = BlockSolvers(data.solver or AutomaticSolver())
    try:
        return Answers(solvers.factorize(data.name, matrix, data.places, "basis"), data.name)
    except SolveFailed as error:
        if error.status is not Status.SINGULAR:
            raise
        raise InputError(
            f"the stiffness of {data.name} is singular: something in it can move without force; "
            "hold it by a reference condition, or use a basis of snapshots") from None


def is_thermal(data: BlockData) -> bool:
    """True for temperatures, or any other field of first order in time."""
    return data.order == 1


@dataclass(frozen=True, slots=True, eq=False)
class StaticSolver:
    """Static solver x = K^-1 f, also for the singular conductivity of an insulated body (K 1 = 0).

    There the temperature grows uniformly under constant heat, and x is the shape that it tends to,

        K x = f - C 1 (1.f) / (1.C 1),    1.C x = 0.

    uniform (n,): the vector 1 in this case; None where K is regular.
    """

    factor: Answers
    uniform: FloatArray | None
    growth: FloatArray
    """Heat C 1 / (1.C 1), (n,), that raises the temperature uniformly, of unit total; empty where K
    is regular."""

    @classmethod
    def from_data(cls, data: BlockData) -> "StaticSolver":
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
        """Static responses (n, j) to the columns of F (n, j)."""
        if self.uniform is None:
            return np.asarray(self.factor.solve(np.ascontiguousarray(F)))
        balanced = F - np.outer(self.growth, F.sum(axis=0))
        X = np.asarray(self.factor.solve(np.ascontiguousarray(balanced)))
        return np.asarray(X - self.growth @ X)
