"""Sampled elastic rows of all bodies with atom selection, with the bordered unknowns condensed.

At the solution of a step the rows of the border (rigid coordinates and multipliers) are satisfied,
and they are so stiff relative to the sampled rows that the least-squares problem of both is nearly
that of the sampled rows with rigid coordinates and multipliers eliminated:

    residual(c + d) = r + J d,   J = B - P Z F,   Z = S H^-1 T,

with P the columns that couple elastic rows to the frame, F the functionals of the displacements in
the border rows, and S, H, T the derivatives of the border. P, F and B are constant, so that the
Gram matrix of J takes a few small products:

    B'B - F'M - M'F,   M = Z' P'B - 1/2 (Z' P'P Z) F.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import blas, lapack

from sparsemor.core import FloatArray
from sparsemor.reducers.sparse.joint_problem import BORDER
from sparsemor.reducers.sparse.sampled_residual import SampledBody
from sparsemor.reducers.sparse.screen_rows import diagonal
from sparsemor.reducers.step.condensed_newton import Mechanics
from sparsemor.reducers.step.iteration_state import Workspace
from sparsemor.reducers.step.left_inverse import squares


class Constants:
    """Block-diagonal constant matrices of all bodies: B (m, k) and F (p, k), both with columns
    divided by the column lengths `lengths` (k,) of B, P (m, p), and their Gram products."""

    def __init__(self, bodies: Sequence[SampledBody]) -> None:
        self.numbers = [s.number for s in bodies]
        B, self.P = diagonal([s.B for s in bodies]), diagonal([s.P for s in bodies])
        self.squares = squares(B)
        self.seen = self.squares > 0.0
        self.squares[~self.seen] = 1.0
        self.lengths = np.sqrt(self.squares)
        B, self.F = B / self.lengths, diagonal([s.F for s in bodies]) / self.lengths
        self.Bt, self.Pt = np.ascontiguousarray(B.T), np.ascontiguousarray(self.P.T)
        self.BB, self.PB, self.PP = np.asfortranarray(B.T @ B), self.P.T @ B, self.P.T @ self.P


@dataclass(frozen=True, slots=True, eq=False)
class Eliminated:
    """Sampled rows linearised in one step, with rigid coordinates and multipliers condensed.

    S (p, N), H (N, N): derivatives of the factors sigma of P and of the border rows with respect to
    the N border unknowns; ZF (p, k); gram (k, k): Gram matrix of J, upper triangle in Fortran
    order; lengths (k,): column lengths of the joint least squares of sampled and border rows, in
    which border rows are scaled by the square roots of `weights` (N,).
    """

    still: Constants
    S: FloatArray
    H: FloatArray
    ZF: FloatArray
    gram: FloatArray
    lengths: FloatArray
    weights: FloatArray

    @classmethod
    def of(
        cls, mechanics: Mechanics, work: Workspace, still: Constants
    ) -> "Eliminated | None":
        """Condensation with the derivatives that the last `solve` of the mechanics left in `work`;
        None where the border matrix is singular."""
        bodies, works, F = mechanics.bodies, work.frames, still.F
        S = np.concatenate([works[i].sigma[:-1].T.dot(bodies[i].to_border) for i in still.numbers])
        T = np.concatenate([works[i].tau.T.dot(bodies[i].to_border) for i in still.numbers]).T
        H = np.zeros((mechanics.size, mechanics.size))
        if not mechanics.size:
            return cls(still, S, H, 0.0 * F, still.BB, np.ones(len(still.BB)), np.zeros(0))
        for b, w in zip(bodies, works, strict=True):
            H += b.to_border.T.dot(w.border[:, :-1].dot(b.to_border))
        answer, singular = lapack.dgesv(H, T)[2:]
        if singular:
            return None
        Z = S.dot(answer)
        ZF, TF = Z.dot(F), T.dot(F)
        M = Z.T.dot(still.PB - 0.5 * still.PP.dot(ZF))
        # reads the transposes in Fortran order: nothing is copied but B'B
        gram = blas.dsyr2k(-1.0, F.T, M.T, 1.0, still.BB)
        TF *= TF
        weights = BORDER**2 / (TF.dot(still.squares) + (H * H).sum(axis=1))
        return cls(still, S, H, ZF, gram, np.sqrt(1.0 + weights.dot(TF)), weights)

    def slope(self, r: FloatArray) -> FloatArray:
        """Gradient J'r (k,) for a residual r (m,)."""
        return np.asarray(self.still.Bt.dot(r) - self.still.Pt.dot(r).dot(self.ZF))

    def gives(self) -> tuple[FloatArray, FloatArray]:
        """Finite stiffness of the border rows: V (N, m) and V J (N, k), with which the squared norm
        of the joint least squares is r'r - (V r)'(V r)."""
        if not len(self.H):
            return np.zeros((0, len(self.still.P))), np.zeros((0, len(self.gram)))
        V = np.linalg.solve(self.H.T, (self.still.P.dot(self.S)).T)
        V /= np.sqrt(self.weights)[:, None]
        return V, V.dot(self.still.Bt.T) - V.dot(self.still.P).dot(self.ZF)

    def hidden(self, y: FloatArray) -> float:
        """Squared norm of the border unknowns y (N,), each multiplied by the length of its
        column."""
        columns = squares(self.still.P.dot(self.S)) + self.weights.dot(self.H * self.H)
        return float(columns.dot(y * y))
