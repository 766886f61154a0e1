"""Time integration: states, step formulas of an integrator, and functions of time."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.layout import Layout


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Unknowns x, rates v and second derivatives a at time t (s). memory (n, j): further history
    that a multistep integrator needs."""

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    memory: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class StepFormula:
    """Step formula of an implicit integrator: v = c1 x + r1, a = c2 x + r2 at the new time t;
    first-order unknowns (temperatures) use c1_first instead of c1.

    r1, r2 (n,): history terms of all unknowns (Eq. 24 of the paper for BDF1).
    """

    t: float
    c1: float
    c2: float
    c1_first: float
    r1: FloatArray
    r2: FloatArray


class Integrator(Protocol):
    """Implicit time integrator that expresses rates as affine functions of the new unknowns.
    `order`: order of accuracy."""

    @property
    def order(self) -> int: ...
    def start(self, layout: Layout, state: State) -> State:
        """Initial state with the integrator's history `memory` filled."""
        ...

    def formula(self, layout: Layout, state: State, h: float) -> StepFormula: ...
    def advance(
        self, layout: Layout, state: State, formula: StepFormula, x: FloatArray, h: float
    ) -> State: ...


@runtime_checkable
class ChecksLayout(Protocol):
    """An integrator with warnings for models that it does not suit."""

    def notes(self, layout: Layout) -> tuple[Note, ...]:
        """Warnings before the first step, derived from the kinds of unknowns (second-order,
        first-order, algebraic) in the layout."""
        ...


@runtime_checkable
class TimeFunction(Protocol):
    """Scalar function of time, with its rate, for loads and prescribed motion."""

    def value(self, t: float) -> float: ...
    def rate(self, t: float) -> float: ...


@runtime_checkable
class HasCurvature(TimeFunction, Protocol):
    """A function of time with an exact second derivative, from the right at a kink.

    For functions without it, the initial accelerations use finite differences of `rate`, scaled by
    the time step.
    """

    def curvature(self, t: float) -> float: ...
