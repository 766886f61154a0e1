"""Pointwise laws: the contract between a constitutive or exchange law and the weak form.

A law maps values of the fields at a point, z = (z_1, .., z_c), such as temperature, its rate, its
gradient or the displacement gradient, to the factors y = (y_1, .., y_m) of test functions or of
their derivatives. The weak form adds

    r = integral of sum_i y_i(z, x, t) D_i phi

to the left-hand side of the equations, where D_i phi is the test function or one of its spatial
derivatives. Heat that leaves the body counts positive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.core import FloatArray, Quantity
from sparsemor.core.protocols.term import LawArrays


@dataclass(frozen=True, slots=True)
class Variable:
    """One scalar of a field at a point.

    quantity: TEMPERATURE or DISPLACEMENT; component: 0 for temperature; axis: spatial derivative
    with respect to this coordinate, None for the value; rate: time derivative; bend: second
    difference of a first-order unknown over the last steps (`StepFormula`).
    """

    quantity: Quantity
    component: int = 0
    axis: int | None = None
    rate: bool = False
    bend: bool = False

    @property
    def of_values(self) -> Variable:
        """The variable whose rate or second difference this is."""
        return replace(self, rate=False, bend=False)

    @property
    def kind(self) -> int:
        """0 for a value, 1 for a rate, 2 for a second difference."""
        return 2 if self.bend else int(self.rate)


TEMPERATURE = Variable(Quantity.TEMPERATURE)
"""Temperature T, K."""
TEMPERATURE_RATE = Variable(Quantity.TEMPERATURE, rate=True)
"""Rate of temperature, K/s."""


TEMPERATURE_BEND = Variable(Quantity.TEMPERATURE, bend=True)
"""Second difference of temperature, K/s^2."""


def temperature_gradient(d: int) -> tuple[Variable, ...]:
    """Components of the temperature gradient in d dimensions, K/m."""
    return tuple(Variable(Quantity.TEMPERATURE, 0, j) for j in range(d))


def displacement_gradient(d: int) -> tuple[Variable, ...]:
    """Components du_i/dx_j of the displacement gradient, row by row: u_1,1, u_1,2, ..."""
    return tuple(Variable(Quantity.DISPLACEMENT, i, j) for i in range(d) for j in range(d))


class Response(NamedTuple):
    """Values of a law and its derivatives.

    y: m arrays; derivatives: (i, j) -> dy_i/dz_j for entries that are not zero everywhere. Arrays
    broadcast with those of the variables.
    """

    y: Sequence[FloatArray]
    derivatives: Mapping[tuple[int, int], FloatArray | float]


class GreenLagrange(NamedTuple):
    """Stress of Green-Lagrange strains less the linear one, with constant properties (`law`) in d
    dimensions; reference: temperature without stress, K, None where temperature has no effect and
    is no variable."""

    law: Law
    d: int
    reference: float | None


class PointwiseLaw(Protocol):
    """A law at a point of a body or of its surface.

    reads: the variables z; tests: the test functions or their derivatives that y multiplies, all of
    one quantity and without rates. degree: degree of the polynomials that the quadrature integrates
    exactly on linear elements. Immutable; equal arguments give equal results.
    """

    @property
    def reads(self) -> Sequence[Variable]: ...
    @property
    def tests(self) -> Sequence[Variable]: ...
    @property
    def degree(self) -> int: ...
    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        """y and dy/dz at E elements of Q points each.

        z: one array (E, Q) for each variable, (E, 1) where it is constant in an element; x (d, E,
        Q): coordinates in the body frame, m; t: s.
        """
        ...

    def arrays(self) -> LawArrays | None:
        """The law as a function on arrays with its numbers; None without one, and then steps of the
        model are not compiled."""
        return None

    @property
    def green_lagrange(self) -> GreenLagrange | None:
        """Constants of a stress that is a polynomial of the displacement gradient and temperature;
        None for all other laws."""
        return None


class StressLaw(PointwiseLaw, Protocol):
    """A law of stress. linear: True if the stress at given temperatures is a linear function of the
    displacements plus a constant, False otherwise."""

    @property
    def linear(self) -> bool: ...
