"""Values of the constraints g(x, t), and their first and second total time derivatives.

With velocities v and zero accelerations

    g'  = G v + dg/dt,      g'' = (d/ds G(x + s v, t)) v + 2 (dG/dt) v + d2g/dt2,      G = dg/dx.

Partial time derivatives are exact if the prescribed functions have exact derivatives. The
derivative along v is a sixth-order central difference of exact Jacobians over a rotation of 1e-2
rad or one time step, whichever is shorter, so that the result does not depend on units of time or
length or on the distance to the origin.
"""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.poses import PLANAR_POSE
from sparsemor.core.protocols.term import Term
from sparsemor.core.protocols.time_function import derivative_from_right

ROTATION = 1e-2
"""Largest rotation between two points of the finite difference, rad."""
ROUND_OFF = 1e-14
"""Relative error of positions that is tolerated in a velocity over one step."""


def motion_step(layout: Layout, v: FloatArray, h: float) -> float:
    """Step, s, of the finite difference of constraint Jacobians: the time step h, or less if a
    body rotates by more than ROTATION in h. (The norm of a quaternion's rate is half the angular
    rate.)"""
    turning = 0.0
    for b in layout:
        if b.kind.quantity is Quantity.POSE:
            rates = v[layout[b.name]][2 if b.size == PLANAR_POSE else 3 :]
            turning = max(turning, float(np.abs(rates).max(initial=0.0)))
    return min(h, ROTATION / turning) if turning > 0.0 else h


def along_motion(s: float) -> tuple[tuple[float, float], ...]:
    """Places p and weights w of central differences of sixth order in steps of s: a function has
    the derivative sum w f(p) at 0, exactly zero for a constant."""
    return tuple([(sign * k * s, sign * weight / (60.0 * s))
                  for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)) for sign in (1, -1)])


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """Constraint equations of a model, the rows of all its Lagrange multipliers. h: time step,
    s."""

    layout: Layout
    terms: tuple[Term, ...]
    h: float

    @classmethod
    def from_terms(cls, layout: Layout, terms: tuple[Term, ...], h: float) -> "Constraints":
        """Constraints among the residual terms of a model: those in the rows of multipliers."""
        rows = layout.algebraic
        here = ((t, np.flatnonzero((t.rows >= rows.start) & (t.rows < rows.stop))) for t in terms)
        return cls(layout, tuple(t.restrict(keep) for t, keep in here if len(keep)), h)

    def values(self, x: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
        """Values g (l,) of the constraints, and the magnitude (l,) of their terms, sum |G_j x_j|.
        """
        found, size = self._zero(), self._zero()
        for term in self.terms:
            j = term.columns
            zero = np.zeros(len(j))
            self._add(found, term, term.residual(x[j], zero, zero, t))
            self._add(size, term, abs(self._jacobian(term, x, t)) @ np.abs(x[j]))
        return found, size

    def rate(self, x: FloatArray, v: FloatArray, t: float) -> tuple[FloatArray, FloatArray]:
        """Time derivative g' (l,) of the constraints, and the magnitude (l,) to compare it with:
        sum |G_j v_j| + |dg/dt|, plus the change of dg/dt in one step and the round-off of G x over
        one step."""
        v = self._second(v)  # g depends on second-order unknowns only
        found, size = self._zero(), self._zero()
        for term in self.terms:
            J, j = self._jacobian(term, x, t), term.columns
            partial_rate, partial_second = (self._of_time(term, x, t, order) for order in (1, 2))
            self._add(found, term, J @ v[j] + partial_rate)
            self._add(size, term, abs(J) @ np.abs(v[j]) + np.abs(partial_rate)
                      + self.h * np.abs(partial_second)
                      + ROUND_OFF / self.h * (abs(J) @ np.abs(x[j])))
        return found, size

    def curvature(self, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Second time derivative g'' (l,) of the constraints at zero accelerations."""
        v = self._second(v)
        found = self._zero()
        for s, weight in along_motion(motion_step(self.layout, v, self.h)):
            found += weight * self._moving(x + s * v, v, t)
        for term in self.terms:
            mixed = self._mixed(term, x, v[term.columns], t)
            self._add(found, term, 2.0 * mixed + self._of_time(term, x, t, 2))
        return found

    def _of_time(self, term: Term, x: FloatArray, t: float, order: int) -> FloatArray:
        """Partial derivative (m,) of a term by time, of order 1 or 2."""
        zero, xj = np.zeros(len(term.columns)), x[term.columns]
        if not term.exact_in_time:
            return derivative_from_right(
                lambda s: term.residual(xj, zero, zero, s), order, t, self.h)
        of_time = term.time_derivative(order, t, self.h)
        return np.zeros(len(term.rows)) if of_time is None else (
            of_time.residual(xj, zero, zero, t))

    def _mixed(self, term: Term, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Mixed derivative (dG/dt) v (m,) of a term; v: velocities at its columns."""
        if not term.exact_in_time:
            return derivative_from_right(
                lambda s: np.asarray(self._jacobian(term, x, s) @ v), 1, t, self.h)
        of_time = term.time_derivative(1, t, self.h)
        return np.zeros(len(term.rows)) if of_time is None else (
            np.asarray(self._jacobian(of_time, x, t) @ v))

    def _moving(self, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Constraint Jacobian times velocities, G(x, t) v (l,)."""
        found = self._zero()
        for term in self.terms:
            self._add(found, term, self._jacobian(term, x, t) @ v[term.columns])
        return found

    def _jacobian(self, term: Term, x: FloatArray, t: float) -> Csr:
        j = term.columns
        zero = np.zeros(len(j))
        return term.jacobian(x[j], zero, zero, t, zero, zero)

    def _second(self, v: FloatArray) -> FloatArray:
        """Velocities v (n,) with zeros for all but the second-order unknowns."""
        found = np.zeros(len(v))
        found[self.layout.second] = v[self.layout.second]
        return found

    def _zero(self) -> FloatArray:
        return np.zeros(self.layout.algebraic.stop - self.layout.algebraic.start)

    def _add(self, to: FloatArray, term: Term, values: FloatArray) -> None:
        np.add.at(to, term.rows - self.layout.algebraic.start, values)
