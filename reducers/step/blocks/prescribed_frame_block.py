"""Elastic block of a body whose frame motion is prescribed: linear, without coupling to rigid
unknowns.

With D = K + c1 D_m + c2 M constant (D_m: damping) and the increment d from a prediction u0, v0, a0
(elastic_block.py), its rows times D^-1 read

    d + sum_g (kappa_g + c1 mu_g) D^-1 M_g d = b,
    b = -D^-1 (h + P sigma + sum_g kappa_g M_g u0 + mu_g M_g v0),

with h the terms of the prediction and loads, P the columns that couple to the frame, M_g constant
matrices. sigma, kappa and mu depend on time only (core/protocols/separable.py), so no moments and
quadratic forms of u are needed.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sparsemor.core import Factorized, FloatArray, IntArray
from sparsemor.core.protocols import ElasticOperators
from sparsemor.reducers.linalg.coarse_correction import CoarseCorrection
from sparsemor.reducers.step.acceptance import LEAST
from sparsemor.reducers.step.blocks.elastic_block import (
    DisplacementBlock,
    History,
    predicted_forces,
    rounded,
    solved_by_iteration,
)
from sparsemor.reducers.step.blocks.elastic_local import FullLocal, LocalForces
from sparsemor.reducers.step.predictor import Prediction
from sparsemor.reducers.step.time_tables import TimeTable


class Past(History):
    """Constants of one step, and its last iterate.

    kappa, mu (g,): factors of the frame's rotation; weights = kappa + c1 mu (g,); d, image: last
    iterate (None at the start) and its image; turning: range of the g in which kappa or mu is not
    zero; bound: upper bound of the contraction factor; rest: the part of b that depends on time
    only.
    """

    __slots__ = ("bound", "d", "image", "kappa", "mu", "rest", "turning", "weights")

    def __init__(
        self, at: Prediction, c1: float, c2: float, table: FloatArray, g: int
    ) -> None:
        super().__init__(at, c1, c2)
        self.kappa, self.mu = table[:g], table[g : 2 * g]
        self.weights = self.kappa + c1 * self.mu
        acts = np.flatnonzero((self.kappa != 0.0) | (self.mu != 0.0)).tolist()
        self.turning = (acts[0], acts[-1] + 1) if acts else (0, 0)
        self.d: FloatArray | None = None

    image: FloatArray
    bound: float
    rest: FloatArray


class PrescribedBlock(DisplacementBlock):
    """Displacements on a frame whose motion is prescribed. proved: True if `contraction` is an
    upper bound in the Euclidean norm of the unknowns, False if it is an estimate."""

    proved: ClassVar[bool]

    @abstractmethod
    def time_table(self, drive: TimeTable) -> TimeTable:
        """Tabulated functions of time of a step: the frame's kappa, mu and sigma in `drive`, and
        others that depend on time only."""

    @abstractmethod
    def begin(self, at: Prediction, c1: float, c2: float, table: FloatArray) -> Past:
        """Constants of a step from the prediction; table: values of `time_table` at its time."""

    @abstractmethod
    def improve(self, d: FloatArray, past: Past) -> FloatArray:
        """One iteration: b - sum_g (kappa_g + c1 mu_g) D^-1 M_g d, followed by a correction in the
        lowest modes."""

    @abstractmethod
    def contraction(self, past: Past) -> float:
        """Bound or estimate of the factor by which `improve` reduces an error; 0.0 without
        rotation."""

    @abstractmethod
    def noise(self, d: FloatArray, past: Past) -> float:
        """Norm of the errors of the increment d due to rounding of the terms of the equations."""


@dataclass(frozen=True, slots=True, eq=False)
class FullPrescribed(PrescribedBlock):
    """Full order: D factorized, one right-hand side per iteration, and a coarse correction in the
    lowest modes. Its contraction factor is estimated by Ritz values, which are lower bounds of
    eigenvalues, times a safety factor."""

    proved: ClassVar[bool] = False
    ops: ElasticOperators
    factor: Factorized
    coarse: CoarseCorrection
    active: IntArray | None = None
    local: LocalForces | None = None

    @classmethod
    def of(cls, ops: ElasticOperators, factor: Factorized, block: str) -> "FullPrescribed":
        """Block with its coarse space. Raises SolveFailed, naming the block, where an iteration
        does not converge."""
        return cls(ops, factor, CoarseCorrection.of(ops, factor, block),
                   local=FullLocal(ops.local) if ops.local else None)

    @property
    def iterates(self) -> bool:
        return self.factor.iterative

    def time_table(self, drive: TimeTable) -> TimeTable:
        return drive

    def begin(self, at: Prediction, c1: float, c2: float, table: FloatArray) -> Past:
        o, g = self.ops, len(self.ops.generators)
        past = Past(at, c1, c2, table, g)
        h = predicted_forces(o, o.mass @ at.a, at)
        sigma = table[2 * g :]
        if sigma.any():
            h += o.directions @ sigma
        for M, kappa, mu in zip(o.generators, past.kappa, past.mu, strict=True):
            if kappa or mu:
                h += M @ (kappa * at.x + mu * at.v)
        past.h, past.u = h, at.x
        return past

    def improve(self, d: FloatArray, past: Past) -> FloatArray:
        right = past.h if past.local is None else past.h + past.local.rows(d)
        for M, weight in zip(self.ops.generators, past.weights, strict=True):
            if weight:
                right = right + M @ (weight * d)
        if not self.factor.iterative:
            new = -self.factor.solve(right)
            if not past.weights.any():
                return new
            return new + self.coarse.correction(new - d, past.weights.tolist())
        return -solved_by_iteration(self.ops, self.factor, right, -d, past)

    def contraction(self, past: Past) -> float:
        turning = self.coarse.left * float(np.abs(past.weights).sum())
        return turning if self.local is None else max(turning, LEAST)

    def noise(self, d: FloatArray, past: Past) -> float:
        return rounded(self.ops, self.factor, d, past)
