"""The lowest modes of an elastic block, in which what turns with its frame is solved for.

A step on a given frame solves (D + N) u = b, N = sum_g kappa_g M_g small against D, by
u <- D^-1 (b - N u). Its error shrinks by what N counts in the lowest modes of (D, M), a few of
which are much softer than the others. So after each solve the equation is satisfied in their
span Z:

    (Z^T (D + N) Z) y = -Z^T N d,   u <- u + Z y,   d the change by the solve,

Z^T D Z = 1: a coarse correction (Nicolaides 1987, doi 10.1137/0724027), at the price of a few dense
columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from sparsemor.core import (
    ElasticOperators,
    Factorized,
    FloatArray,
    SolveFailed,
    Status,
    solve_or_fail,
)

MODES, SPARE, POWER, MARGIN = 32, 8, 4, 2.0
"""Modes that are kept, others that are iterated with them, steps of the subspace iteration, and the
margin on how much M counts against D."""


@dataclass(frozen=True, slots=True, eq=False)
class CoarseCorrection:
    """Z (n, r); seen (g, r, n): Z^T M_g; small (g, r, r): Z^T M_g Z. left: s^2, times sum |kappa_g|
    by how much an error shrinks, an estimate on the safe side. r = 0: nothing is corrected."""

    Z: FloatArray
    seen: FloatArray
    small: FloatArray
    left: float

    @classmethod
    def of(cls, ops: ElasticOperators, factor: Factorized, block: str) -> "CoarseCorrection":
        """Raises SolveFailed, naming the block, where an iteration stops short, and where numbers
        are too extreme for modes."""
        n, g = len(ops.constant), len(ops.generators)
        # solvers that iterate take their right-hand sides one by one
        kept = MODES if not factor.iterative and n >= 8 * MODES else 0
        if not g:
            return cls(np.zeros((n, 0)), np.zeros((0, 0, n)), np.zeros((0, 0, 0)), 0.0)
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
        values = np.maximum(values[::-1], 0.0)
        Z = np.ascontiguousarray(X[:, :kept])
        seen = np.stack([np.ascontiguousarray((M.T @ Z).T) for M in ops.generators])
        last = values[kept - 1] if kept else values[0]
        return cls(Z, seen, seen @ Z, MARGIN * float(np.sqrt(values[0] * last)))

    def correction(self, d: FloatArray, kappa: Sequence[float]) -> FloatArray:
        """Z y (n,) for a change d (n,)."""
        A, right = np.eye(self.Z.shape[1]), np.zeros(self.Z.shape[1])
        for seen, small, k in zip(self.seen, self.small, kappa, strict=True):
            if k:
                A += k * small
                right -= k * seen.dot(d)
        return np.asarray(self.Z.dot(np.linalg.solve(A, right)))
