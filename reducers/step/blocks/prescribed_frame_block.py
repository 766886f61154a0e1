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
from typing import ClassVar

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.reducers.step.blocks.elastic_block import (
    DisplacementBlock,
    History,
)
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
