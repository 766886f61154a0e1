"""The sampled rows of all selecting bodies with the border of a step eliminated.

At the solution of a step the border rows hold, and they are so stiff against the sampled rows
that the joint least squares is nearly that of the sampled rows with rigid coordinates and
multipliers eliminated:

    residual(c + d) = r + J d,   J = B - P Z F,   Z = S H^-1 T,

P directions, F functionals of the displacements, S, H, T the border's derivatives. P, F, B are
constant, so that the Gram matrix of J takes a few small products:

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
    """Side by side: B (m, k) with columns over `lengths` (k,), P (m, p), F (p, k) over the same,
    and their Gram products."""

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
    """S (p, N), H (N, N): derivatives by the border of the directions' factors sigma and of the
    border rows; ZF (p, k); gram (k, k): upper triangle, Fortran order; lengths (k,) of
    J's columns together with those in the border rows, which are scaled by the roots of `weights`
    (N,) in the joint least squares."""

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
        """With the derivatives that the last `solve` of the mechanics left in `work`; None where
        the border is singular."""
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
        """J'r for r (m,)."""
        return np.asarray(self.still.Bt.dot(r) - self.still.Pt.dot(r).dot(self.ZF))

    def gives(self) -> tuple[FloatArray, FloatArray]:
        """Compliance of the border to r: V (N, m) and V J (N, k),
        with which the joint least squares is that of r'r - (V r)'(V r)."""
        if not len(self.H):
            return np.zeros((0, len(self.still.P))), np.zeros((0, len(self.gram)))
        V = np.linalg.solve(self.H.T, (self.still.P.dot(self.S)).T)
        V /= np.sqrt(self.weights)[:, None]
        return V, V.dot(self.still.Bt.T) - V.dot(self.still.P).dot(self.ZF)

    def hidden(self, y: FloatArray) -> float:
        """Squared norm of the border unknowns y (N,), each times the length of its column."""
        columns = squares(self.still.P.dot(self.S)) + self.weights.dot(self.H * self.H)
        return float(columns.dot(y * y))
