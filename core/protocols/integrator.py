"""Time: states, the substitution for the rates, functions of time."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.layout import Layout


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Unknowns and rates at time t (s). `memory` is the integrator's own (n, j) array."""

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    memory: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class StepFormula:
    """v = c1 x + r1, a = c2 x + r2 at the new time t; first-order unknowns use c1_first.

    r1, r2 have shape (n,) over the whole layout (Eq. 24 of the paper for BDF1).
    """

    t: float
    c1: float
    c2: float
    c1_first: float
    r1: FloatArray
    r2: FloatArray


class Integrator(Protocol):
    """An affine substitution for the rates. `order` is the observed order of accuracy."""

    @property
    def order(self) -> int: ...
    def start(self, layout: Layout, state: State) -> State:
        """The same state with this integrator's memory set."""
        ...

    def formula(self, layout: Layout, state: State, h: float) -> StepFormula: ...
    def advance(
        self, layout: Layout, state: State, formula: StepFormula, x: FloatArray, h: float
    ) -> State: ...


@runtime_checkable
class ChecksLayout(Protocol):
    """An integrator with warnings on models that it does not suit."""

    def notes(self, layout: Layout) -> tuple[Note, ...]:
        """Warnings before the first step, by the unknowns that there are."""
        ...


@runtime_checkable
class TimeFunction(Protocol):
    """A scalar function of time, for loads and prescribed motion."""

    def value(self, t: float) -> float: ...
    def rate(self, t: float) -> float: ...


@runtime_checkable
class HasCurvature(TimeFunction, Protocol):
    """A time function with its second derivative, from the right where it has a kink.

    Of a function without it, the start of a run takes finite differences of `rate`,
    scaled by the time step.
    """

    def curvature(self, t: float) -> float: ...
