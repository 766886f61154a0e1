"""Equations of a model for its analyses: residual, tangents and linearised equations, at full order
or projected on the trial bases of a reducer.

    r(x, x', x'', t) = 0,    x = offset + T c,    projected: T^T r(offset + T c, ...) = 0

All physics are in the terms of the model; nothing here knows one. Projected terms are
`Term.compress`, which visits no node of the mesh for separable terms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array

from sparsemor.core import (
    Csr,
    Dictionary,
    FloatArray,
    IntArray,
    Layout,
    Model,
    ReducedTerm,
    State,
    Term,
    Trial,
)
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.model.equations import system_jacobian, system_residual
from sparsemor.core.protocols.layout import Quantity

RATE, ACCELERATION = 1e12, 1e24
"""Factors c of rates and accelerations with which damping and mass are differences of Jacobians,
which are affine in them: (J(c) - K) / c has a rounding error of 1e-16 K / c."""


@dataclass(frozen=True, slots=True, eq=False)
class Tangents:
    """Derivatives (n, n) of the residual by x, x' and x'': stiffness K, damping D (gyroscopic
    matrix and heat capacity included), mass M."""

    K: Csr
    D: Csr
    M: Csr


def stiffness_to_mass(K: Csr, M: Csr) -> float:
    """Mean ratio of the diagonals of stiffness and mass, 1/s2, of unknowns with mass; 1 without."""
    mass = M.diagonal()
    some = mass > 0.0
    return float(np.mean(np.abs(K.diagonal()[some]) / mass[some])) if some.any() else 1.0


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedTerm(Term):
    """Galerkin projection of a term as a term of the reduced unknowns: rows (l,), columns (k,);
    test (l, m): left factor of its m rows. whole: the term of the model; trial: its unknowns as an
    affine function of the reduced ones; term: the product of all three. exact_in_time: no time
    derivatives of constraints are given, so that finite differences are taken."""

    rows: IntArray
    columns: IntArray
    whole: Term
    trial: Trial
    test: FloatArray
    term: ReducedTerm

    @classmethod
    def from_term(
        cls, term: Term, full: Layout, small: Layout, bases: Mapping[str, Dictionary]
    ) -> "ProjectedTerm":
        """A term of the model, projected on the trial bases of its blocks."""
        rows, test, _ = _trial(term.rows, full, small, bases)
        columns, atoms, offset = _trial(term.columns, full, small, bases)
        trial, left = Trial(atoms, offset), np.ascontiguousarray(test.T)
        return cls(rows, columns, term, trial, left, term.compress(trial, left))

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.term.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array(self.term.jacobian(x, v, a, t, c1, c2))

    def restrict(self, keep: IntArray) -> "ProjectedTerm":
        test = self.test[keep]
        return ProjectedTerm(self.rows[keep], self.columns, self.whole, self.trial, test,
                         self.whole.compress(self.trial, test))

    def compress(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        return CompressedLocal.of(self, trial, left)

    @property
    def exact_in_time(self) -> bool:
        return False


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """Equations of a model in the unknowns c of an analysis.

    layout: these unknowns, n of them; bases: block -> its trial basis, none at full order.
    """

    model: Model
    bases: Mapping[str, Dictionary]
    layout: Layout
    terms: tuple[Term, ...]

    @classmethod
    def from_model(cls, model: Model, bases: Mapping[str, Dictionary]) -> "System":
        layout = model.layout.resized({n: d.atoms.shape[1] for n, d in bases.items()})
        if not bases:
            return cls(model, bases, layout, model.terms)
        return cls(model, bases, layout, tuple(
            ProjectedTerm.from_term(t, model.layout, layout, bases) for t in model.terms))

    def residual(self, s: State) -> FloatArray:
        """Residual (n,) in a state of its unknowns."""
        return system_residual(self.layout, self.terms, s.x, s.v, s.a, s.t)

    def jacobian(self, s: State, c1: float = 0.0, c2: float = 0.0) -> Csr:
        """Jacobian (n, n), csc, with dv = c1 dx (of first-order unknowns too) and da = c2 dx."""
        k1, k2 = np.zeros(self.layout.size), np.zeros(self.layout.size)
        k1[self.layout.second], k1[self.layout.first] = c1, c1
        k2[self.layout.second] = c2
        return csc_array(system_jacobian(
            self.layout, self.terms, s.x, s.v, s.a, s.t, k1, k2))

    def tangents(self, s: State) -> Tangents:
        """Stiffness, damping and mass in a state."""
        K = self.jacobian(s)
        D = (self.jacobian(s, RATE) - K) / RATE
        M = (self.jacobian(s, 0.0, ACCELERATION) - K) / ACCELERATION
        return Tangents(K, csc_array(D), csc_array(M))

    def full(self, x: FloatArray) -> FloatArray:
        """Unknowns of the model (N,) from those of the system (n,)."""
        found = self.direction(x)
        for name, d in self.bases.items():
            found[self.model.layout[name]] += d.offset
        return found

    def direction(self, change: FloatArray) -> FloatArray:
        """Changes (N,) or (N, k) of the model's unknowns from those of the system, real or
        complex."""
        if not self.bases:
            return change.copy()
        found = np.zeros((self.model.layout.size, *change.shape[1:]), change.dtype)
        for b in self.layout:
            own = change[self.layout[b.name]]
            found[self.model.layout[b.name]] = (
                self.bases[b.name].atoms @ own if b.name in self.bases else own)
        return found

    def test(self, force: FloatArray) -> FloatArray:
        """Forces (n,) on the system's unknowns from those on the model's (N,)."""
        if not self.bases:
            return force
        return np.concatenate([
            self.bases[b.name].atoms.T @ force[self.model.layout[b.name]] if b.name in self.bases
            else force[self.model.layout[b.name]] for b in self.layout])

    def start(self, t: float) -> State:
        """Initial values of the model at the time t, at rest."""
        x = np.zeros(self.layout.size)
        for b in self.layout:
            own = self.model.x0[self.model.layout[b.name]]  # of a reduced block: coefficients
            if b.name in self.bases:
                d = self.bases[b.name]
                own = least_squares_coefficients(d.atoms, (own - d.offset)[:, None])[:, 0]
            x[self.layout[b.name]] = own
        zero = np.zeros(self.layout.size)
        return State(t, x, zero, zero, np.zeros((self.layout.size, 0)))

    def state(self, s: State) -> State:
        """State of the model from one of the system."""
        return State(s.t, self.full(s.x), self.direction(s.v), self.direction(s.a),
                     np.zeros((self.model.layout.size, 0)))

    @property
    def mechanical(self) -> IntArray:
        """Numbers of displacements, rigid coordinates and multipliers of joints."""
        layout = self.layout
        return np.concatenate([np.arange(layout.second.start, layout.second.stop),
                               np.arange(layout.algebraic.start, layout.algebraic.stop)])

    @property
    def thermal(self) -> IntArray:
        """Numbers of temperatures."""
        return np.arange(self.layout.first.start, self.layout.first.stop)

    def sizes(self) -> FloatArray:
        """Magnitude (N,) of a large motion of each unknown of the model: the size of the body,
        1 rad, 1 K; of multipliers 0."""
        layout, found = self.model.layout, np.zeros(self.model.layout.size)
        extent = {n: b.extent or 1.0 for n, b in self.model.bodies.items()}
        for b in layout:
            own = np.ones(b.size) if b.kind.order else np.zeros(b.size)
            if b.kind.quantity is Quantity.DISPLACEMENT:
                own[:] = extent[b.owner]
            elif b.kind.quantity is Quantity.POSE:  # positions first: 2 of 3 in the plane
                own[:2 if b.size == 3 else 3] = extent[b.owner]
            found[layout[b.name]] = own
        return found

    def motion(self, change: FloatArray) -> float:
        """Largest change of the model's unknowns (N,), real, relative to large motions."""
        size = self.sizes()
        some = size > 0.0
        return float((np.abs(change[some]) / size[some]).max(initial=0.0))


def _trial(
    numbers: IntArray, full: Layout, small: Layout, bases: Mapping[str, Dictionary]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Numbers (k,) of the reduced unknowns of the blocks that contain `numbers` (m,), and the
    affine map from these to the unknowns there: atoms (m, k) and offset (m,)."""
    names: Sequence[str] = full.containing(numbers) if len(numbers) else ()
    found = np.concatenate([np.zeros(0, np.int64), *(small.numbers(n) for n in names)])
    atoms, offset = np.zeros((len(numbers), len(found))), np.zeros(len(numbers))
    for name in names:
        at = full[name]
        mine = np.flatnonzero((numbers >= at.start) & (numbers < at.stop))
        local, columns = numbers[mine] - at.start, np.searchsorted(found, small.numbers(name))
        if name in bases:
            atoms[np.ix_(mine, columns)] = bases[name].atoms[local]
            offset[mine] = bases[name].offset[local]
        else:
            atoms[mine, columns[local]] = 1.0
    return found, atoms, offset
