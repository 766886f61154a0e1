"""What a body hands to the step solvers: constant operators and a small frame kernel.

Everything that is mesh-sized is a constant matrix; everything that changes with the motion is a
handful of scalars. A reducer multiplies the matrices by its trial and test maps once (offline)
and then only meets the scalars (equations.md, section 1: the separable structure).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols import Term

Amplitude = Callable[[float], float]
"""Time (s) to the factor of a constant load vector."""


class FrameWork:
    """Arrays that `Frame.evaluate` fills: p directions, b border unknowns, g generators.

    sigma (p,) multiplies the directions in the elastic rows; rows (b,) are the border equations;
    sigma_y (b, p), tau (b, p), H (b, b) their derivatives: d sigma = sigma_y^T dy,
    d rows = H dy + tau ds, with s = directions^T u. kappa (g,), mu (g,) multiply the generators
    on u and on u'; kappa_y, mu_y (b, g) are their derivatives. quad (b, 3, g): d rows / d of the
    quadratic forms (u.M_g u, u.M_g u', u.M_g u'').
    """

    __slots__ = ("H", "kappa", "kappa_y", "mu", "mu_y", "quad", "rows", "sigma", "sigma_y", "tau",
                 "views")

    def __init__(self, p: int, b: int, g: int) -> None:
        self.views: object = None  # a kernel's own views of these arrays, made once
        self.sigma, self.rows = np.zeros(p), np.zeros(b)
        self.sigma_y, self.tau, self.H = np.zeros((b, p)), np.zeros((b, p)), np.zeros((b, b))
        self.kappa, self.mu = np.zeros(g), np.zeros(g)
        self.kappa_y, self.mu_y = np.zeros((b, g)), np.zeros((b, g))
        self.quad = np.zeros((b, 3, g))


class Frame(Protocol):
    """The coupling of one body's rigid coordinates, attachment forces and elastic directions.

    Border unknowns: rigid coordinates first, then the forces on each attachment; border rows:
    rigid equations, then the attachments' positions. Its sums are exact in the rigid state.
    """

    @property
    def rigid_size(self) -> int: ...
    @property
    def border(self) -> int: ...
    @property
    def p(self) -> int: ...
    @property
    def generators(self) -> int: ...
    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        s: FloatArray, s1: FloatArray, s2: FloatArray, quadratic: FloatArray, t: float,
        work: FrameWork,
    ) -> None:
        """y, v, a (b,); s, s1, s2 (p,) = directions^T (u, u', u''); quadratic (3, g)."""
        ...

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """(direction, generator): that direction is M_g X, so it moves with the shape."""
        ...

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Frame":
        """The same frame about the shape `offset`: s = directions^T offset, quadratic (g,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ElasticOperators:
    """Constant matrices of one elastic block of n unknowns (free displacements).

    mass, damping, stiffness (n, n); generators g matrices (n, n), the first is the mass;
    directions (n, p); coupling (n, nT) with the thermal block, or None: the elastic rows are
    mass u'' + damping u' + stiffness u - coupling T - internal(t) + frame terms, where
    internal(t) = constant + loads @ amplitudes(t), loads (n, j).
    """

    mass: Csr
    damping: Csr
    stiffness: Csr
    generators: tuple[Csr, ...]
    directions: FloatArray
    coupling: Csr | None
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MovingBody:
    """One body as the mechanical step sees it. `to_border` (b, N) maps the global border.

    The global border is all rigid blocks followed by all multipliers; `to_border` picks the
    body's rigid coordinates and turns multipliers into forces on its attachments.
    elastic, thermal: name of its blocks, "" when the scene gives it none.
    """

    name: str
    frame: Frame
    to_border: FloatArray
    elastic: str
    thermal: str
    operators: ElasticOperators | None


@dataclass(frozen=True, slots=True, eq=False)
class HeatBody:
    """capacity T' + conductivity T - constant - loads @ amplitudes(t) + local terms = 0."""

    name: str
    thermal: str
    capacity: Csr
    conductivity: Csr
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...]
    local: tuple[Term, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Separated:
    """A model taken apart for the fast step. `other` are terms that fit nowhere here.

    border_rhs: functions whose values are subtracted from the multiplier rows.
    """

    moving: tuple[MovingBody, ...]
    heat: tuple[HeatBody, ...]
    border_size: int
    border_targets: tuple[tuple[int, Amplitude], ...]
    other: tuple[Term, ...]


def evaluate_amplitudes(amplitudes: Sequence[Amplitude], t: float) -> FloatArray:
    return np.array([f(t) for f in amplitudes], dtype=np.float64)


def positions(local: IntArray, chosen: IntArray) -> IntArray:
    """Where each of `chosen` sits in the sorted array `local`."""
    return np.searchsorted(local, chosen).astype(np.int64)
