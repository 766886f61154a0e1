"""Separable equations of a flexible body: constant matrices times scalar functions of the rigid
motion.

All arrays of the mesh's size are constant; only a few scalars depend on the motion. Model reduction
projects the matrices on trial and test bases once (offline); a time step evaluates the scalars only
(docs/equations.md, section 1).
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
"""Scalar function of time (s) that multiplies a constant load vector."""


class FrameWork:
    """Work arrays of `Frame.evaluate`: equations and derivatives of a floating frame of reference
    with p directions (constant vectors on the displacements u), b inputs y (rigid coordinates, then
    attachment forces) and g generators (constant matrices M_g).

    sigma (b + 1, p): the last row multiplies the directions in the elastic equations, row i is its
    derivative by y_i. border (b, b + 1): H = d rows / dy, and in the last column the rigid and
    attachment equations ("rows"). tau (b, p): d rows = H dy + tau ds with s = directions^T u.
    coefficients (2 g + 1,) = kappa, mu, 1: forces sum kappa_g M_g u + sum mu_g M_g u'. For the
    exact Jacobian only: kappa_y, mu_y (b, g) are the derivatives of kappa and mu by y, quad (b, 3,
    g) those of the rows by the forms (u.M_g u, u.M_g u', u.M_g u'').
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
    """Description of one load vector of a block of unknowns.

    name: of the load, for trial bases and reports; "" for a column that is no load. joint: True for
    a joint force of unknown size. prescribed: True for the effect of a prescribed temperature.
    """

    name: str
    joint: bool = False
    prescribed: bool = False


class Frame(Protocol):
    """Floating frame of reference of one body: coupling of rigid coordinates, attachment forces and
    elastic displacements.

    Inputs: rigid coordinates, then the forces on each attachment; equations: rigid equations of
    motion, then the positions of the attachments. They are exact for a rigid body.
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
        s: FloatArray, forms: FloatArray, t: float, work: FrameWork,
    ) -> None:
        """Fills `work` for the inputs y (rigid coordinates and attachment forces), their rates v
        and second derivatives a, all (b,), at time t, s; derivatives are for dv = c1 dy, da = c2 dy
        and likewise for the displacements u.

        These enter as functionals only: s (3, p) = directions^T (u, u', u''), and forms (3 g,) =
        u.M_g u, u.M_g u', u.M_g u''.
        """
        ...

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, t: float, work: FrameWork
    ) -> None:
        """Fills the last row of `work.sigma` and `work.coefficients` for a body with prescribed
        motion; these do not depend on displacements. y, v, a (b,): inputs as in `evaluate`; t:
        s."""
        ...

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        """Fills `work.kappa_y`, `mu_y` and `quad` after `evaluate`; only the exact Jacobian needs
        them."""
        ...

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """Pairs (direction, generator g) of directions that are M_g X with reference positions X,
        and so change with an offset of the displacements."""
        ...

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Frame":
        """Frame for displacements measured from a shape `offset`: s = directions^T offset (p,),
        quadratic (g,) = offset.M_g offset."""
        ...

    def time_derivative(self, order: int, t: float, h: float) -> "Frame | None":
        """Frame whose attachment equations are the partial time derivative, of order 1 or 2, from
        the right at t (s); None if it is zero. h: time step, s."""
        ...


class FrameItem(Protocol):
    """One contribution to the equations of a floating frame: inertia, a force, or an attachment of
    a joint."""

    @property
    def forces(self) -> int:
        """Number of unknown forces, the multipliers of a joint; 0 for other contributions."""
        ...

    def names(self, source: str) -> tuple[str, ...]:
        """Load name of each direction; "" for one that is no load vector. source: name of the joint
        or load."""
        ...


class BodyFrame(Frame, Protocol):
    """A floating frame whose equations are a sum of contributions (inertia, forces,
    attachments)."""

    @property
    def items(self) -> Sequence[FrameItem]: ...
    @property
    def without_push(self) -> Sequence[FrameItem]:
        """Contributions that act on displacements but that `drive` cannot evaluate for a prescribed
        motion."""
        ...
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyFrame": ...
    def time_derivative(self, order: int, t: float, h: float) -> "BodyFrame | None": ...


@dataclass(frozen=True, slots=True, eq=False)
class ElasticLocal:
    """A term evaluated element by element, in the numbering of one elastic block: rows (m,),
    columns (n,), where `hot` (n,) is True for columns in the temperature block of the same body."""

    term: Term
    rows: IntArray
    columns: IntArray
    hot: BoolArray


@runtime_checkable
class EvaluatesManyTimes(Frame, Protocol):
    """A floating frame that evaluates `drive` at many times in one call; for other frames `drive`
    is called once per time."""

    def drive_along(
        self, y: FloatArray, v: FloatArray, a: FloatArray, times: FloatArray
    ) -> FloatArray:
        """Coefficients kappa, mu and last row of sigma, side by side, (T, 2 g + p), for inputs,
        rates and second derivatives (T, b) at times (T,), s."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ElasticOperators:
    """Constant matrices and loads of one elastic block of n free displacements u. Elastic
    equations:

        mass u'' + damping u' + stiffness u - coupling T - internal(t) + frame terms = 0,
        internal(t) = constant + loads @ amplitudes(t) + time-tabulated loads

    mass, damping, stiffness (n, n); coupling (n, nT) with the temperatures, or None; loads (n, j).
    generators: g matrices (n, n) with factors that depend on the rigid motion, the first is the
    mass; none for a frame at rest. directions (n, p): vectors by which rigid motion and joint
    forces act on u. columns (p,), load_names (j,): description of each direction and load.
    integrals: internal force by elements, if the body offers it. tables: loads that move over the
    body. local: terms evaluated element by element, which read u and the body's temperatures only.
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
    """Mechanical equations of one body.

    to_border (b, N): map from all N rigid coordinates and multipliers of the model to the b inputs
    of the body's frame, its rigid coordinates and attachment forces. origin (b,): added to them;
    the pose of a fixed frame, else zero. guide: prescribed motion of the frame, which is added too.
    elastic, thermal: names of its blocks of unknowns, "" if it has none.
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
    """Heat equation of one temperature block: capacity T' + conductivity T - constant - loads @
    amplitudes(t) - tables + local terms = 0.

    columns (j,): description of each column of `loads` (n, j). integrals: capacity and conductivity
    by elements, if the body offers them. tables: heat loads that move over the body. local: terms
    evaluated element by element.
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
    """Heat exchange A T + B T' in the rows of temperature block `rows`, T being the temperatures of
    block `columns` of another body. term: the same as a residual term."""

    rows: str
    columns: str
    A: Csr
    B: Csr
    term: Term


@dataclass(frozen=True, slots=True, eq=False)
class Separated:
    """Equations of a model as operators of its blocks of unknowns, with couplings between
    temperature blocks of different bodies, and `other` terms that fit neither.

    border_size: number of rigid coordinates and multipliers; border_targets: position among them
    and prescribed function of time, which is subtracted from the constraint row. step: time step,
    s, from which finite differences in time are scaled.
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
        """Temperature blocks grouped by heat exchange, to be solved together; most groups have one
        member."""
        group = {b.thermal: i for i, b in enumerate(self.heat)}
        for c in self.couplings:
            low, high = sorted((group[c.rows], group[c.columns]))
            group = {name: low if i == high else i for name, i in group.items()}
        return tuple(tuple(b for b in self.heat if group[b.thermal] == i)
                     for i in sorted(set(group.values())))

    @property
    def elastic_local(self) -> tuple[Term, ...]:
        """Terms of all elastic blocks that are evaluated element by element."""
        return tuple(part.term for m in self.moving if m.operators is not None
                     for part in m.operators.local)

    @property
    def between(self) -> tuple[Term, ...]:
        """All terms that are not part of the operators of one block."""
        return (*(c.term for c in self.couplings), *self.other)

    @property
    def rigid_equations(self) -> bool:
        """True if there are rigid coordinates or multipliers to solve for, or terms outside the
        block operators."""
        return bool(self.border_size or self.other)


def evaluate_amplitudes(amplitudes: Sequence[Amplitude], t: float) -> FloatArray:
    return np.array([f(t) for f in amplitudes], dtype=np.float64)


def amplitudes_along(amplitudes: Sequence[Amplitude], times: FloatArray) -> FloatArray:
    """Amplitudes (T, j) of loads at times (T,), s."""
    values = [[f(t) for f in amplitudes] for t in times.tolist()]
    return np.array(values, dtype=np.float64).reshape(len(times), len(amplitudes))


def positions(local: IntArray, chosen: IntArray) -> IntArray:
    """Positions of the values `chosen` in the sorted array `local`."""
    return np.searchsorted(local, chosen).astype(np.int64)
