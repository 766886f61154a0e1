"""Elastic block of one body inside a step, with its elimination from the bordered Newton system.

The unknown is the increment d of the displacements from a prediction: u = u0 + d, u' = v0 + c1 d,
u'' = a0 + c2 d. With D = K + c1 D_m + c2 M constant (D_m: damping), the elastic rows times D^-1
read

    d + z + E sigma = 0,   z = D^-1 (h + sum_g kappa_g M_g u + mu_g M_g u'),   E = D^-1 P,

with h = M a0 + D_m v0 + K u0 less loads, P the columns that couple to the frame ("directions"), M_g
constant matrices, and the scalars sigma, kappa, mu of the frame's motion. Increments keep the
digits of accelerations: c2 is 1/(beta h^2) (Bottasso, Bauchau and Cardona 2007, doi
10.1137/050638503). Full order solves with the factorized D; a reduced block has D^-1 applied to all
matrices in advance. The iteration is the same for both.
"""

from abc import ABC, abstractmethod

from sparsemor.core import FloatArray, IntArray, Status
from sparsemor.core.protocols import FrameWork
from sparsemor.reducers.step.blocks.elastic_local import LocalForces, StepForces
from sparsemor.reducers.step.predictor import Prediction


class History:
    """One elastic block in a step: constants from its prediction, and terms at the last iterate.

    at: the prediction; u (s,): predicted displacements of the active unknowns; h: terms of the
    prediction and loads; products: of the prediction and its rates with M_g and P; local: local
    terms, None where there are none. Of an iterative linear solver: its number of iterations in
    this step, the norm of its residual, and status and message of a solve that did not converge.

    At the increment d: s (3, p) = P^T (u, u', u''); forms (3 g,) = u.M_g (u, u', u''); stack: rows
    M_g u, then M_g u', and if reduced times D^-1, and h + P^T d as the last row; terms: what
    one method leaves for the next.
    """

    __slots__ = ("at", "c1", "c2", "failure", "forms", "h", "iterations", "local", "products",
                 "residual", "s", "stack", "terms", "u")

    def __init__(self, at: Prediction, c1: float, c2: float) -> None:
        self.at, self.c1, self.c2 = at, c1, c2
        self.iterations, self.residual = 0, 0.0
        self.local: StepForces | None = None
        self.failure: tuple[Status, str] | None = None

    forms: FloatArray
    h: FloatArray
    products: FloatArray
    s: FloatArray
    stack: FloatArray
    terms: tuple[FloatArray, ...]
    u: FloatArray


class DisplacementBlock(ABC):
    """Base class of one body's displacements in a step. active: numbers of the unknowns that are
    solved for, None for all; local: terms that are evaluated at each iterate."""

    active: IntArray | None
    local: LocalForces | None

    @property
    def iterates(self) -> bool:
        """True if its linear solver is iterative."""
        return False

    def rates(self, k: int) -> tuple[FloatArray, FloatArray] | None:
        """D^-1 D_m and D^-1 M on k atoms, (s, k) each for s active ones: minus the block's response
        to the history terms r1 and r2 of the step formula; None at full order."""
        return None


class ElasticBlock(DisplacementBlock):
    """Displacements of a body whose frame has unknowns."""

    @abstractmethod
    def begin(self, at: Prediction, c1: float, c2: float) -> History:
        """A step from the prediction, at d = 0."""

    @abstractmethod
    def move(self, d: FloatArray, history: History) -> None:
        """Products of the displacements with P and M_g at the increment d (s,)."""

    @abstractmethod
    def condensed(self, d: FloatArray, history: History, work: FrameWork) -> FloatArray:
        """P^T times the elastic rows and their derivatives by the border unknowns, with the frame
        evaluated at d: (p, b + 1), columns P^T E sigma_y, then P^T (d + z + E sigma)."""

    @abstractmethod
    def increment(self, history: History, dy: FloatArray) -> FloatArray:
        """Increment -(z + E sigma) of the block (s,), for border unknowns (b,) less dy than those
        of `condensed`."""

    @abstractmethod
    def response(self, sigma: FloatArray) -> FloatArray:
        """Displacements E sigma (s,) due to factors sigma (p,) of the frame directions."""

    @abstractmethod
    def noise(self, d: FloatArray, history: History, factors: FloatArray) -> float:
        """Norm of the errors of the increment d due to rounding of the terms of the elastic rows;
        factors (2 g + 1,) = [kappa, mu, 1]."""
