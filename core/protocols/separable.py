"""Separable equations of a body: constant matrices times scalar functions of the rigid motion.

Arrays of the mesh's size are constant matrices; what changes with the motion is a handful of
scalars. A reducer multiplies the matrices by its trial and test bases once (offline); a step
evaluates the scalars only (docs/equations.md, section 1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy import zeros

from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray
from sparsemor.core.protocols.element_integrals import ElasticIntegrals, HeatIntegrals
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.term import Term

Amplitude = Callable[[float], float]
"""Time (s) to the factor of a constant load vector."""


class FrameWork:
    """Arrays that `Frame.evaluate` fills: p directions, b border unknowns, g generators.

    sigma (b + 1, p): its last row multiplies the directions in the elastic rows, row i is the
    derivative of that by border unknown i. border (b, b + 1): H = d rows / dy and, as last
    column, the border equations' rows. tau (b, p): d rows = H dy + tau ds with s = directions^T u.
    coefficients (2 g + 1,) = kappa, mu, 1: the generators act on u as sum kappa_g M_g u and on
    the history as sum mu_g M_g r1. For the exact Jacobian only: kappa_y, mu_y (b, g) are the
    derivatives of the factors on u and u' by the border unknowns, quad (b, 3, g) = d rows / d of
    the forms (u.M_g u, u.M_g u', u.M_g u'').
    """

    __slots__ = ("border", "coefficients", "kappa_y", "mu_y", "quad", "sigma", "tau", "views")

    def __init__(self, p: int, b: int, g: int) -> None:
        self.views: object = None  # a kernel's own views of these arrays, made once
        self.sigma, self.border, self.tau = zeros((b + 1, p)), zeros((b, b + 1)), zeros((b, p))
        self.coefficients = zeros(2 * g + 1)
        self.coefficients[-1] = 1.0
        self.kappa_y, self.mu_y, self.quad = zeros((b, g)), zeros((b, g)), zeros((b, 3, g))


@dataclass(frozen=True, slots=True)
class LoadColumn:
    """One load column of a block.

    name: of the load, for bases and reports; "" where the column is no load. joint: whether it is
    the force of a joint, whose size is an unknown. prescribed: whether a prescribed temperature
    makes it.
    """

    name: str
    joint: bool = False
    prescribed: bool = False


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
        s: FloatArray, s1: FloatArray, s2: FloatArray, form: FloatArray, forms: FloatArray,
        t: float, work: FrameWork,
    ) -> None:
        """Fill `work` at border unknowns y and rates v, a (b,), t in s.

        u' = c1 u + r1, u'' = c2 u + r2 enter as functionals: s, s1, s2 (p,) = directions^T
        (u, r1, r2), form (g,) = u.M_g u, forms (2 g,) = u.M_g r1 and u.M_g r2.
        """
        ...

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float, t: float,
        work: FrameWork,
    ) -> None:
        """For a body with an elastic block whose border is known: fill the last row of
        `work.sigma` and the coefficients, which do not depend on displacements; no more.
        """
        ...

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        """After `evaluate`: kappa_y, mu_y and quad, which only the exact Jacobian needs."""
        ...

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """(direction, generator): that direction is M_g X, so it moves with the shape."""
        ...

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Frame":
        """The same frame about the shape `offset`: s = directions^T offset, quadratic (g,)."""
        ...

    def time_derivative(self, order: int, t: float, h: float) -> "Frame | None":
        """The frame whose attachment rows are the partial derivative by time of order 1 or 2 of
        this one's, from the right at t, s; None where that is zero. h: time step, s."""
        ...


class FrameItem(Protocol):
    """A part of a frame's equations: inertia, a force, an attachment."""

    @property
    def forces(self) -> int:
        """Number of its forces that are unknown: those of a joint, its multipliers."""
        ...

    def names(self, source: str) -> tuple[str, ...]:
        """Load name of each of its directions; "" where it only serves the frame's rows."""
        ...


class BodyFrame(Frame, Protocol):
    """A frame whose equations are a sum of items."""

    @property
    def items(self) -> Sequence[FrameItem]: ...
    @property
    def without_push(self) -> Sequence[FrameItem]:
        """Items that `drive` cannot evaluate although they act on displacements."""
        ...
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyFrame": ...
    def time_derivative(self, order: int, t: float, h: float) -> "BodyFrame | None": ...


@dataclass(frozen=True, slots=True, eq=False)
class ElasticLocal:
    """A local term on one elastic block: rows (m,) positions in the block, columns (n,) positions
    in it or, where `hot` (n,), in the thermal block of the body."""

    term: Term
    rows: IntArray
    columns: IntArray
    hot: BoolArray


@runtime_checkable
class EvaluatesManyTimes(Frame, Protocol):
    """A frame whose `drive` can be evaluated at many times in one call; else it is called once for
    each time."""

    def drive_along(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float, times: FloatArray
    ) -> FloatArray:
        """(T, 2 g + p): kappa, mu, sigma in a row for border unknowns and rates (T, b) at times
        (T,), s."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ElasticOperators:
    """Constant matrices of one elastic block of n unknowns (free displacements).

    mass, damping, stiffness (n, n); generators g matrices (n, n), the first is the mass, none for
    a frame at rest;
    directions (n, p); coupling (n, nT) with the thermal block, or None: the elastic rows are
    mass u'' + damping u' + stiffness u - coupling T - internal(t) + frame terms, where
    internal(t) = constant + loads @ amplitudes(t) + tables at t, loads (n, j). columns (p,) and
    load_names (j,) say what each direction and load is, for bases and reports. integrals: the
    internal force by elements, where the body can give it (`element_integrals`); tables: loads
    that move over it. local: terms that are evaluated by elements and added to the rows; they read
    the block itself and the body's temperatures.
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
    columns: tuple[LoadColumn, ...] = ()
    load_names: tuple[str, ...] = ()
    integrals: Callable[[], ElasticIntegrals] | None = None
    tables: tuple[LoadTable, ...] = ()
    local: tuple[ElasticLocal, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MovingBody:
    """One body as the mechanical step sees it. `to_border` (b, N) maps the global border.

    The global border is all rigid blocks followed by all multipliers; `to_border` picks the
    body's rigid coordinates and turns multipliers into forces on its attachments; origin (b,) is
    added to that: the pose of a frame that does not move, else zero. guide: the motion of a frame
    that is given, whose pose, rates and accelerations are added in the same way.
    elastic, thermal: name of its blocks, "" when the scene gives it none.
    """

    name: str
    frame: Frame
    to_border: FloatArray
    origin: FloatArray
    elastic: str
    thermal: str
    operators: ElasticOperators | None
    guide: FrameHistory | None = None


@dataclass(frozen=True, slots=True, eq=False)
class HeatBody:
    """capacity T' + conductivity T - constant - loads @ amplitudes(t) - tables + local terms = 0.

    columns (j,): meaning of each column of `loads` (n, j). integrals: capacity and conduction by
    elements, where the body can give them (`element_integrals`); tables: heat that moves over it.
    """

    name: str
    thermal: str
    capacity: Csr
    conductivity: Csr
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...]
    local: tuple[Term, ...]
    columns: tuple[LoadColumn, ...] = ()
    integrals: Callable[[], HeatIntegrals] | None = None
    tables: tuple[LoadTable, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class HeatCoupling:
    """A T + B T' in the rows of the thermal block `rows`, T the temperatures of the block `columns`
    of another body. term: the same in the general form."""

    rows: str
    columns: str
    A: Csr
    B: Csr
    term: Term


@dataclass(frozen=True, slots=True, eq=False)
class Separated:
    """A model's equations as operators of its blocks. `other` are terms that fit nowhere here.
    couplings: between thermal blocks of different bodies, which are then solved together.

    border_rhs: functions whose values are subtracted from the multiplier rows. step: the time step
    of the scene, s: the scale of finite differences in time.
    """

    moving: tuple[MovingBody, ...]
    heat: tuple[HeatBody, ...]
    border_size: int
    border_targets: tuple[tuple[int, Amplitude], ...]
    other: tuple[Term, ...]
    step: float
    couplings: tuple[HeatCoupling, ...] = ()

    @property
    def heat_groups(self) -> tuple[tuple[HeatBody, ...], ...]:
        """Thermal blocks that couplings connect; most groups have one member."""
        group = {b.thermal: i for i, b in enumerate(self.heat)}
        for c in self.couplings:
            low, high = sorted((group[c.rows], group[c.columns]))
            group = {name: low if i == high else i for name, i in group.items()}
        return tuple(tuple(b for b in self.heat if group[b.thermal] == i)
                     for i in sorted(set(group.values())))

    @property
    def elastic_local(self) -> tuple[Term, ...]:
        """Local terms of all elastic blocks."""
        return tuple(part.term for m in self.moving if m.operators is not None
                     for part in m.operators.local)

    @property
    def between(self) -> tuple[Term, ...]:
        """All terms that couple blocks of different bodies, or fit nowhere."""
        return (*(c.term for c in self.couplings), *self.other)

    @property
    def rigid_equations(self) -> bool:
        """Is anything rigid unknown, or may a term ask for it?"""
        return bool(self.border_size or self.other)


def evaluate_amplitudes(amplitudes: Sequence[Amplitude], t: float) -> FloatArray:
    return np.array([f(t) for f in amplitudes], dtype=np.float64)


def amplitudes_along(amplitudes: Sequence[Amplitude], times: FloatArray) -> FloatArray:
    """(T, j) at times (T,), s: they are functions of one time."""
    values = [[f(t) for f in amplitudes] for t in times.tolist()]
    return np.array(values, dtype=np.float64).reshape(len(times), len(amplitudes))


def positions(local: IntArray, chosen: IntArray) -> IntArray:
    """Positions of `chosen` in the sorted array `local`."""
    return np.searchsorted(local, chosen).astype(np.int64)
