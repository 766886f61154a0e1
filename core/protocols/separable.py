"""Separable equations of a flexible body: constant matrices times scalar functions of the rigid
motion.

All arrays of the mesh's size are constant; only a few scalars depend on the motion. Model reduction
projects the matrices on trial and test bases once (offline); a time step evaluates the scalars only
(docs/reference/equations.md, section 1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray
from sparsemor.core.protocols.body_frame import Frame
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.term import Term


@dataclass(frozen=True, slots=True, eq=False)
class Integrals:
    """Element integrals of a matrix of `shape` (n, m), which is their sum over the elements.

    rows (E, p), columns (E, q): matrix rows and columns of each element's entries, -1 for a node
    without an unknown; values (E, p, q).
    """

    rows: IntArray
    columns: IntArray
    values: FloatArray
    shape: tuple[int, int]

    @property
    def count(self) -> int:
        """Number of elements E."""
        return len(self.values)

    def part(self, elements: slice | IntArray) -> "Integrals":
        """Integrals of a subset of the elements, given by a slice or by numbers."""
        return Integrals(self.rows[elements], self.columns[elements], self.values[elements],
                         self.shape)

    def weighted(self, weights: FloatArray) -> Csr:
        """Weighted matrix (n, m): sum over elements of weights (E,) times integral; elements of
        weight 0 are not visited."""
        used = np.flatnonzero(weights)
        values = weights[used, None, None] * self.values[used]
        i = np.broadcast_to(self.rows[used, :, None], values.shape)
        j = np.broadcast_to(self.columns[used, None, :], values.shape)
        here = (i >= 0) & (j >= 0)
        return csr_array((values[here], (i[here], j[here])), shape=self.shape)

    def projected(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Projected element matrices left^T (integral) right, (E, k, r), with left (n, k), right
        (m, r)."""
        return np.asarray(np.einsum(
            "epk,epr->ekr", _gathered(left, self.rows),
            self.values @ _gathered(right, self.columns), optimize=True))


def _gathered(matrix: FloatArray, at: IntArray) -> FloatArray:
    """Rows of `matrix` at the unknowns of each element, (E, p, k); zero for a node without an
    unknown."""
    return np.where(at[:, :, None] >= 0, matrix[at], 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ElasticIntegrals:
    """Internal elastic force by elements: stiffness u - coupling T - given [1; amplitudes(t)].

    coupling: None without temperature unknowns; given (n, 1 + j): effect of prescribed
    temperatures. Inertia and damping are not included.
    """

    stiffness: Integrals
    coupling: Integrals | None
    given: Integrals
    amplitudes: tuple[Callable[[float], float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class HeatIntegrals:
    """Heat balance by elements: capacity T' + conductivity T - given [1; amplitudes(t)]. Surface
    convection and surface loads are not included."""

    capacity: Integrals
    conductivity: Integrals
    given: Integrals
    amplitudes: tuple[Callable[[float], float], ...]


Amplitude = Callable[[float], float]
"""Scalar function of time (s) that multiplies a constant load vector."""


@dataclass(frozen=True, slots=True, eq=False)
class StressStiffness:
    """Geometric stiffness of a body: the change of its stiffness by its stress.

    matrices: function of nodal displacements (N, d), m, and temperatures (N,), K, or None, that
    returns the stiffness and the geometric stiffness of the free displacements (n, n), N/m.
    nonlinear: True if the equations of the body contain it; prestressed: only that of its loads.
    """

    matrices: Callable[[FloatArray, FloatArray | None], tuple[Csr, Csr]]
    nonlinear: bool
    prestressed: bool = False


@dataclass(frozen=True, slots=True)
class LoadColumn:
    """Description of one load vector of a block of unknowns.

    name: of the load, for trial bases and reports; "" for a column that is no load. joint: True for
    a joint force of unknown size. prescribed: True for the effect of a prescribed temperature.
    """

    name: str
    joint: bool = False
    prescribed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ElasticLocal:
    """A term evaluated element by element, in the numbering of one elastic block: rows (m,),
    columns (n,), where `hot` (n,) is True for columns in the temperature block of the same body."""

    term: Term
    rows: IntArray
    columns: IntArray
    hot: BoolArray


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
    stress_stiffness: for checks of results, if the body offers it.
    damps: terms of the damping that are no sparse matrices (`Term.damps`).
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
    stress_stiffness: StressStiffness | None = None
    damps: tuple[ElasticLocal, ...] = ()

    def tangent(self, u: FloatArray, T: FloatArray) -> Csr:
        """Stiffness (n, n) of the local terms at displacements u (n,), m, at rest, and temperatures
        T of the body, K."""
        n = len(self.constant)
        found = csr_array((n, n))
        for part in self.local:
            at, zero = part.columns, np.zeros(len(part.columns))
            x = np.zeros(len(at))
            # columns that are hot are those of temperatures
            x[part.hot], x[~part.hot] = T[at[part.hot]], u[at[~part.hot]]
            J = part.term.jacobian(x, zero, zero, 0.0, zero, zero).tocoo()
            own = ~part.hot[J.col]
            found = found + csr_array(
                (J.data[own], (part.rows[J.row[own]], at[J.col[own]])), shape=(n, n))
        return csr_array(found)

    def damping_force(self, v: FloatArray) -> FloatArray:
        """Whole damping force on u with rates v, (n,) or columns (n, j)."""
        found = np.asarray(self.damping @ v)
        for part in self.damps:
            zero = np.zeros(len(part.columns))
            for force, rate in zip(found.reshape(len(v), -1).T, v.reshape(len(v), -1).T,
                                   strict=True):
                force[part.rows] += part.term.residual(zero, rate[part.columns], zero, 0.0)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class MovingBody:
    """Mechanical equations of one body.

    to_border (b, N): map from all N rigid coordinates and multipliers of the model to the b inputs
    of the body's frame, its rigid coordinates and attachment forces. origin (b,): added to them;
    the pose of a fixed frame, else zero. guide: prescribed motion of the frame, which is added too.
    elastic, thermal: names of its blocks of unknowns, "" if it has none. operators: those of its
    displacements, None for a rigid body.
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

    name: of the body, thermal: of the block; capacity, conductivity (n, n), constant (n,): W with
    T in K. columns (j,): description of each column of `loads` (n, j). integrals: capacity and
    conductivity by elements, if the body offers them. tables: heat loads that move over the body.
    local: terms evaluated element by element.
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
    found, all_times = np.empty((len(times), len(amplitudes))), times.tolist()
    for column, f in zip(found.T, amplitudes, strict=True):
        column[:] = [f(t) for t in all_times]
    return found


def positions(local: IntArray, chosen: IntArray) -> IntArray:
    """Positions of the values `chosen` in the sorted array `local`."""
    return np.searchsorted(local, chosen).astype(np.int64)
