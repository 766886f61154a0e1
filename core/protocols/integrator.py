"""Time integration: states, and step formulas of an integrator."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ulp
from typing import TypeAlias

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.poses import steered, tangent
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Unknowns x, rates v and second derivatives a at time t (s). memory (n, j): further history
    that a multistep integrator needs."""

    t: float
    x: FloatArray
    v: FloatArray
    a: FloatArray
    memory: FloatArray


@dataclass(frozen=True, eq=False)
class UpdateRule:
    """Update of one kind of unknowns in a step of fixed size: with q the highest rate at the new
    time (second derivative a of second-order unknowns, rate v of first-order ones) and z = [x, v,
    a, columns of `State.memory`] at the old time,

        [x, v, a, memory] at the new time = new q + old z.

    new (3 + j,), old (3 + j, 3 + j). An implicit rule has new[0] > 0.
    """

    new: FloatArray
    old: FloatArray

    @cached_property
    def terms(self) -> tuple[tuple[tuple[int, float], ...], ...]:
        """For each row the numbers and factors of the entries of [z, q] that are not zero."""
        rows = np.column_stack((self.old, self.new)).tolist()
        return tuple(tuple((i, f) for i, f in enumerate(row) if f) for row in rows)


@dataclass(frozen=True, eq=False)
class UpdateRules:
    """Update rules of an integrator for steps of one size: of unknowns of second and of first order
    in time. Algebraic unknowns have no rates, and zeros in their memory."""

    second: UpdateRule
    first: UpdateRule

    @cached_property
    def factors(self) -> tuple[float, float, float]:
        """c1 and c2 of dv = c1 dx, da = c2 dx, and c1 of first-order unknowns."""
        second, first = self.second.new.tolist(), self.first.new.tolist()
        return second[1] / second[0], 1.0 / second[0], 1.0 / first[0]


@dataclass(frozen=True, slots=True, eq=False)
class StepFormula:
    """Unknowns and rates at the end t of a step as functions of the departure d (n,) from the free
    motion, which has zero second derivatives (rates, for first-order unknowns) at t:

        second order: x = free + d,  v = free_rate + c1 d,  a = c2 d
        first order:  x = free + d,  v = c1_first d
        algebraic:    x = d

    free, free_rate (n,). Equivalent are v = c1 x + r1 and a = c2 x + r2 (Eq. 24 of the paper for
    BDF1), but where c2 = 1/(beta h^2) is large they lose digits: x of size 1 is rounded to 1e-16,
    c2 x to 1e-16 c2.

    h: size of the step, s; before (n,): unknowns x0 at its start. With them a of first-order
    unknowns is 2 (x0 - x + h v)/h^2: zero where v = (x - x0)/h, and the second difference of the
    last three values where v is the formula of BDF2.
    """

    t: float
    c1: float
    c2: float
    c1_first: float
    layout: Layout
    free: FloatArray
    free_rate: FloatArray
    h: float = 0.0
    before: FloatArray | None = None

    @property
    def c2_first(self) -> float:
        """da/dx of first-order unknowns, whose a is the second difference of `at`."""
        excess = round(self.h * self.c1_first - 1.0, 12)
        return 2.0 * excess / self.h**2 if self.h > 0.0 else 0.0

    def steer(self, d: FloatArray) -> FloatArray:
        """A guess d (n,) of the departure, with quaternions near their free motion, in place."""
        for at in self.layout.quaternions:
            steered(d[at : at + 4], self.free[at : at + 4])
        return d

    @property
    def r1(self) -> FloatArray:
        """History terms (n,) of v = c1 x + r1; zero for algebraic unknowns."""
        layout, r1 = self.layout, self.free_rate.copy()
        r1[layout.second] -= self.c1 * self.free[layout.second]
        r1[layout.first] -= self.c1_first * self.free[layout.first]
        return r1

    @property
    def r2(self) -> FloatArray:
        """History terms (n,) of a = c2 x + r2; zero but for second-order unknowns."""
        second, r2 = self.layout.second, np.zeros(len(self.free))
        r2[second] = -self.c2 * self.free[second]
        return r2

    def with_history(self, r1: FloatArray, r2: FloatArray) -> "StepFormula":
        """The same formula with other history terms r1, r2 (n,)."""
        layout = self.layout
        second, first = layout.second, layout.first
        free, rate = np.zeros(len(r1)), np.zeros(len(r1))
        free[second], free[first] = -r2[second] / self.c2, -r1[first] / self.c1_first
        rate[second] = r1[second] + self.c1 * free[second]
        return replace(self, free=free, free_rate=rate)

    def at(
        self, d: FloatArray, differences: bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unknowns x and rates v, a, (n,) each, for the departure d (n,) from the free motion;
        without the second `differences` a of first-order unknowns, which only some terms read,
        these are zero."""
        second, first = self.layout.second, self.layout.first
        v, a = self.free_rate.copy(), np.zeros(len(d))
        v[second] += self.c1 * d[second]
        np.multiply(d[second], self.c2, out=a[second])
        np.multiply(d[first], self.c1_first, out=v[first])
        x = self.free + d
        if differences and self.before is not None and first.stop > first.start:
            a[first] = second_difference(self.before[first], x[first], v[first], self.h)
        return x, v, a

    def departure(self, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Departure d (n,) from the free motion of a state x with rates v, a, to the digits of the
        highest rates."""
        second, first, d = self.layout.second, self.layout.first, x.copy()
        d[second], d[first] = a[second] / self.c2, v[first] / self.c1_first
        return d


def second_difference(x0: FloatArray, x: FloatArray, v: FloatArray, h: float) -> FloatArray:
    """2 (x0 - x + h v)/h^2, zero within the round-off of its terms."""
    found = (x0 - x) + h * v
    found[np.abs(found) <= ROUNDING * np.finfo(np.float64).eps * np.abs(x)] = 0.0
    return 2.0 * found / h**2


ROUNDING = 16.0
"""Distance of two times that are the same but for round-off, in units of the last place."""


SETTLED = 40
"""Number of steps after which an integrator's history has settled."""


def same_time(t: float) -> float:
    """Distance of times near t, s, that are the same but for round-off."""
    return ROUNDING * ulp(t)


def next_time(t: float, h: float) -> float:
    """End of the step of h (s) that begins at t: a multiple n h where t is one, since a sum of
    steps would be rounded again in each of them."""
    end = t + h
    whole = round(end / h) * h if end / h < 2.0**53 else end
    return whole if abs(whole - end) <= same_time(end) else end


def differences(integrator: "Integrator") -> int:
    """Number of earlier values whose differences give the rate of first-order unknowns: 1 for
    (x - x0)/h, 2 for (3 x - 4 x0 + x_)/(2 h), 0 for another formula."""
    rule, z, past = integrator.rules(1.0).first, None, [0.0, 0.0, 0.0]
    fits = {1, 2}
    # arbitrary values x at steps of size 1; q: the rate that the rule has for them
    for n, x in enumerate((0.0, 0.3, -1.1, 0.7, 2.0, -0.4)):
        past = [x, *past[:2]]
        z = np.zeros(len(rule.new)) if z is None else z
        q = (x - float(rule.old[0] @ z)) / float(rule.new[0])
        z = rule.new * q + rule.old @ z
        if n > 1:
            rates = {1: past[0] - past[1], 2: 1.5 * past[0] - 2.0 * past[1] + 0.5 * past[2]}
            fits = {k for k in fits if abs(rates[k] - q) <= 1e-9}
    return min(fits, default=0)


def step_formula(
    rules: UpdateRules, layout: Layout, state: State, h: float, end: float | None = None
) -> StepFormula:
    """Formula of the step of size h (s) from a state. end: its end time, s, if not h later."""
    # [z, q] of `UpdateRule` with the highest rate q = 0; rows 0 and 1 of a rule are x and v
    parts: list[FloatArray | None] = [state.x, state.v, state.a, *state.memory.T, None]
    free, rate = np.zeros(len(state.x)), np.zeros(len(state.x))
    for at, rule in ((layout.second, rules.second), (layout.first, rules.first)):
        if at.stop > at.start:
            _add(rule.terms[0], parts, at, free)
            _add(rule.terms[1], parts, at, rate)
    free.flags.writeable = rate.flags.writeable = False
    end = next_time(state.t, h) if end is None else end
    return StepFormula(end, *rules.factors, layout, free, rate, h, state.x)


def new_state(
    rules: UpdateRules, layout: Layout, state: State, t: float, x: FloatArray, v: FloatArray,
    a: FloatArray, *, linear: bool = False
) -> State:
    """State at the end t of a step from `state`, with unknowns x and rates v, a (n,); those of
    unit quaternions are made consistent with their length. linear: True for small changes of
    states, whose quaternions have no length of 1."""
    memory = np.zeros((len(x), state.memory.shape[1]))
    # z of `UpdateRule`; row 2 of a rule is a, from row 3 on come the columns of the memory
    old = state.x, state.v, state.a, *state.memory.T
    if layout.first.stop > layout.first.start:
        a = a.copy()
        a[layout.first] = 0.0
        _add(rules.first.terms[2], (*old, v), layout.first, a)
    for j in range(memory.shape[1]):
        _add(rules.second.terms[3 + j], (*old, a), layout.second, memory[:, j])
        _add(rules.first.terms[3 + j], (*old, v), layout.first, memory[:, j])
    if layout.quaternions and not linear:
        v, a = v.copy(), a.copy()
        for start in layout.quaternions:
            at = slice(start, start + 4)
            tangent(x[at], v[at], a[at])
    return State(t, x, v, a, memory)


@dataclass(frozen=True, slots=True, eq=False)
class StepOutcome:
    """Solution of one time step in the unknowns of the step solver (reduced ones for a reduced
    model), and its status. block: name of the block in which the solution failed, if it did.

    x (n,): unknowns; iterations: of the mechanics where they are solved after the heat, which has
    its own; rates: their rates v and a, which a solver of increments knows to more digits
    than the step formula gives for x (core/protocols/integrator.py); None: those of the formula;
    remaining: estimated error that the iteration leaves, relative to the largest value of each part
    of the unknowns, 0 for a direct solution.
    """

    x: FloatArray
    status: Status
    iterations: int
    block: str = ""
    detail: str = ""
    rates: tuple[FloatArray, FloatArray] | None = None
    remaining: float = 0.0


def advanced(
    rules: UpdateRules, layout: Layout, state: State, formula: StepFormula, outcome: StepOutcome, *,
    linear: bool = False
) -> State:
    """State at the end of a step from `state`, solved by `outcome`; linear: as in
    `new_state`."""
    if outcome.rates is None:
        v, a = formula.at(outcome.x - formula.free)[1:]
    else:
        v, a = outcome.rates
    return new_state(rules, layout, state, formula.t, outcome.x, v, a, linear=linear)


def with_history(
    integrator: "Integrator", layout: Layout, state: State, slope: FloatArray, h: float
) -> State:
    """State with the history (`State.memory`) that steps of h, s, leave of a motion with these x,
    v, a and a constant slope (n,) of the highest rates, which `Integrator.start` takes as 0."""
    if not slope.any():
        return integrator.start(layout, state)
    rules = integrator.rules(h)
    second, first = slope * 0.0, slope * 0.0
    second[layout.second], first[layout.first] = slope[layout.second], slope[layout.first]

    def at(t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, v, a at the time t, s, from now, with x''' = slope (x'' of first-order unknowns)."""
        a = state.a + t * second
        v = state.v + t * (a - 0.5 * t * second) + t * first
        x = state.x + t * (v - 0.5 * t * first) - t * t * (0.5 * a - t * second / 6.0)
        fixed = layout.algebraic
        x[fixed], v[fixed] = state.x[fixed], state.v[fixed]
        return x, v, a

    # SETTLED steps of this motion that end at the state
    past = integrator.start(layout, State(state.t, *at(-SETTLED * h), state.memory))
    for n in range(1 - SETTLED, 1):
        past = new_state(rules, layout, past, state.t, *at(n * h), linear=True)
    return replace(state, memory=past.memory)


def _add(
    terms: Sequence[tuple[int, float]], parts: Sequence[FloatArray | None], at: slice,
    total: FloatArray
) -> None:
    """Adds the numbered parts times their factors in the unknowns `at` to `total`; a part that is
    None is left out."""
    into = total[at]
    for i, factor in terms:
        part = parts[i]
        if part is not None:
            into += part[at] if factor == 1.0 else factor * part[at]


@dataclass(frozen=True, slots=True, eq=False)
class NextStep:
    """Step of size h (s) from a state, to be taken. rules: those of the integrator for this h; end:
    end time, s."""

    rules: UpdateRules
    layout: Layout
    state: State
    h: float
    end: float


Solve: TypeAlias = Callable[[StepFormula], StepOutcome]
"""Solution of the equations with a formula for the rates at its time."""


class Integrator(Plugin):
    """Implicit time integrator. The formulas of its solves are linear in the highest rates at the
    time of the solve; by default a step is one solve, with update rules that are linear in the old
    state, too."""

    @property
    @abstractmethod
    def order(self) -> int:
        """Order of accuracy."""

    @abstractmethod
    def rules(self, h: float) -> UpdateRules:
        """Update rules of a step of size h, s."""

    def advance(self, solve: Solve, step: NextStep) -> tuple[StepOutcome, State]:
        """Outcome of a step and the state at its end, that of its start after a failure.

        An integrator with several stages calls `solve` several times, always with the factors of
        `rules`, for which step solvers are prepared; its loads are those at the time of the solve.
        """
        rules, layout, state = step.rules, step.layout, step.state
        formula = step_formula(rules, layout, state, step.h, step.end)
        outcome = solve(formula)
        return outcome, advanced(rules, layout, state, formula, outcome) if (
            outcome.status.ok) else state

    @property
    def one_solve(self) -> bool:
        """True for steps of one solve, to which compiled steps, the stability check and the error
        estimate are limited."""
        return type(self).advance is Integrator.advance

    def start(self, layout: Layout, state: State) -> State:
        """Initial state with the integrator's history `memory` filled; by default it has none."""
        return replace(state, memory=np.zeros((state.x.size, 0)))

    def notes(self, layout: Layout) -> tuple[Note, ...]:
        """Warnings before the first step, derived from the kinds of unknowns (second-order,
        first-order, algebraic) in the layout."""
        return ()
