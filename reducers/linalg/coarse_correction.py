"""Coarse correction of a full-order elastic step: frame-rotation terms solved in the lowest modes.

A step on a prescribed frame solves (D + N) u = b, where N = sum_g kappa_g M_g contains the terms of
the frame's rotation and is small relative to D, by the iteration u <- D^-1 (b - N u). Its error
decays most slowly in the lowest modes of (D, M), a few of which are much softer than the others.
After each solve the equation is therefore satisfied in their span Z:

    (Z^T (D + N) Z) y = -Z^T N d,   u <- u + Z y,   d: change of u by the solve,

with Z^T D Z = 1: a coarse correction (Nicolaides 1987, doi 10.1137/0724027) at the cost of a few
dense columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from sparsemor.core import Factorized, FloatArray, SolveFailed, Status
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.core.protocols.separable import ElasticOperators

MODES, SPARE, POWER, MARGIN = 32, 8, 4, 2.0
"""Number of modes in the coarse space, additional vectors of the subspace iteration, number of its
iterations, and safety factor of the estimated contraction factor."""


@dataclass(frozen=True, slots=True, eq=False)
class CoarseCorrection:
    """Coarse space Z (n, r) of the lowest modes and its products with the g matrices M_g of the
    rotation.

    left_generators (g, r, n): Z^T M_g; generators (g, r, r): Z^T M_g Z. contraction (s^2):
    multiplied by sum |kappa_g| an estimate from above of the contraction factor after the
    correction. r = 0: no correction.
    """

    Z: FloatArray
    left_generators: FloatArray
    generators: FloatArray
    contraction: float

    @classmethod
    def from_operators(
        cls, ops: ElasticOperators, factor: Factorized, block: str
    ) -> "CoarseCorrection":
        """Coarse space of an elastic block by subspace iteration with the factorized operator D.

        Raises SolveFailed, naming the block, where the linear solver does not converge or the
        operators have no modes in floating point.
        """
        n, g = len(ops.constant), len(ops.generators)
        # solvers that iterate take their right-hand sides one by one
        kept = MODES if not factor.iterative and n >= 8 * MODES else 0
        if not g:
            return cls(np.zeros((n, 0)), np.zeros((0, 0, n)), np.zeros((0, 0, 0)), 0.0)
        # without a coarse space one vector still gives the lowest mode, for `contraction`
        X = np.random.default_rng(0).standard_normal((n, kept + SPARE if kept else 1))
        for _ in range(POWER if kept else 2 * POWER):
            MX = np.asarray(ops.mass @ X)
            Y = np.asarray(solve_or_fail(factor, MX, block))
            # of span Y: Y^T D Y = Y^T M X, and M in it
            small = Y.T @ MX
            try:
                values, V = linalg.eigh(Y.T @ (ops.mass @ Y), 0.5 * (small + small.T))
            except (linalg.LinAlgError, ValueError):  # not definite, or not finite
                size = float(np.abs(small).max())
                raise SolveFailed(
                    Status.SINGULAR, 0.0, block, "the stiffness of its step has no modes in "
                    f"floating point: mass over stiffness is {size:.3g}") from None
            X = Y @ V[:, ::-1]
        # eigenvalues of M relative to D, s^2: the largest belong to the lowest modes
        values = np.maximum(values[::-1], 0.0)
        Z = np.ascontiguousarray(X[:, :kept])
        ZtM = np.stack([np.ascontiguousarray((M.T @ Z).T) for M in ops.generators])
        last = values[kept - 1] if kept else values[0]
        return cls(Z, ZtM, ZtM @ Z, MARGIN * float(np.sqrt(values[0] * last)))

    def correction(self, d: FloatArray, kappa: Sequence[float]) -> FloatArray:
        """Correction Z y (n,) after a solve that changed u by d (n,); kappa (g,): factors of the
        M_g."""
        A, right = np.eye(self.Z.shape[1]), np.zeros(self.Z.shape[1])
        for ZtM, ZtMZ, k in zip(self.left_generators, self.generators, kappa, strict=True):
            if k:
                A += k * ZtMZ
                right -= k * ZtM.dot(d)
        return np.asarray(self.Z.dot(np.linalg.solve(A, right)))
