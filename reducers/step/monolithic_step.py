"""Step solver that solves for all unknowns of a model together."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from sparsemor.core import (
    BoolArray,
    Dictionary,
    FloatArray,
    IntArray,
    Layout,
    Note,
    ReducedTerm,
    State,
    Status,
    StepFormula,
    StepOutcome,
    StepSolver,
    Term,
)
from sparsemor.core.model.equations import rate_factors
from sparsemor.core.protocols.step_solver import ResultantSource, resultant_sources
from sparsemor.core.protocols.term import LocalCopy
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.jacobian_factors import Matrix
from sparsemor.reducers.step.local_copies import state_of
from sparsemor.reducers.step.newton_loop import Ended, KeptJacobian, Loop, StepEquations
from sparsemor.reducers.step.predictor import Predictor, block_starts
from sparsemor.reducers.step.step_memory import RunMemory

EXTRAPOLATION_ERROR = 1e-2
"""Relative error above which an extrapolation is no better a guess than the last state."""
Checked = tuple[Term | ReducedTerm, IntArray]
"""A term that checks steps, with its columns."""


class WholeEquations(StepEquations):
    """Equations of a whole step. terms: evaluated in each iteration, each with the numbers of its
    unknowns; checks: terms that can reject a converged step, with theirs."""

    @property
    @abstractmethod
    def terms(self) -> Sequence[tuple[Term | ReducedTerm, IntArray]]: ...
    @property
    @abstractmethod
    def checks(self) -> Sequence[Checked]: ...

    @abstractmethod
    def slope(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix:
        """Jacobian (n, n) at a state, dense or csc, for dv = c1 dx and da = c2 dx; c1, c2 (n,)."""


@dataclass(eq=False, kw_only=True)
class WholeMemory(RunMemory):
    """State between steps of the whole-step solver.

    order: order of the extrapolation with the least error in the last step. near: number of a term
    -> its local copy (local_copies.py), stored as the state at which it was made; searches: number
    of such copies so far. equations: those of this run, with their working arrays.
    """

    kept: KeptJacobian
    order: int = 1
    near: dict[int, LocalCopy | FloatArray] = field(default_factory=dict)
    searches: int = 0
    equations: Any = None

    def __getstate__(self) -> dict[str, object]:
        state = {**vars(self), "near": {i: state_of(kept) for i, kept in self.near.items()}}
        del state["equations"]
        return state

    def copy(self) -> Self:
        """Independent copy; local copies of terms are immutable and shared."""
        return replace(super().copy(), kept=self.kept.copy(), near=dict(self.near),
                       equations=None)

    def at_newest(self) -> "WholeMemory":
        """Independent memory with the same local copies of terms, for an evaluation at the last
        state."""
        past = Predictor(1, self.newest, self.past.starts)
        kept = KeptJacobian.empty(len(past.starts))
        return WholeMemory(past=past, kept=kept, near=dict(self.near))

    def moved(self, x: FloatArray) -> None:
        super().moved(x)
        self.order = 1


@dataclass(frozen=True, slots=True, eq=False)
class WholeStepper(StepSolver[WholeMemory]):
    """Step solver for the equations of a whole step. limits: largest permitted |coefficient| of a
    block, beyond which a run counts as divergent. points: number of past states to extrapolate;
    elements_touched: block -> elements that an evaluation visits; rows: sampled rows of each block;
    facts: block -> numbers to report."""

    equations: WholeEquations
    loop: Loop
    elements_touched: Mapping[str, int]
    points: int
    dictionaries: Mapping[str, Dictionary] = field(default_factory=dict)
    rows: Mapping[str, IntArray] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    facts: Mapping[str, Mapping[str, float | int | str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "layout", self.equations.layout)

    def start(self, state: State) -> tuple[State, WholeMemory]:
        starts = block_starts(self.layout)
        return state, WholeMemory(
            past=Predictor(self.points, state.x, starts), kept=KeptJacobian.empty(len(starts)))

    def solve(self, step: StepFormula, memory: WholeMemory) -> tuple[StepOutcome, WholeMemory]:
        """A step for all unknowns together, from the extrapolation of past states of the order that
        was best in the last step; d (n,): departure from the free motion of the step."""
        if memory.equations is None:
            memory.equations = self.equations.working(memory)
        equations, past = memory.equations, memory.past
        guess = past.ring.predict(memory.order)[: past.n]
        d = step.steer(guess - step.free)  # quaternions: near their free motion, not its opposite
        equations.begin(step, d)
        ended = self.loop.solve(equations, step, d, memory.kept, past.newest)
        memory.factorizations = memory.kept.factorizations
        if ended.status.ok:
            self._remember(ended.d, step, memory)
        outcome = rejected_step(outcome_of(ended, step), equations.checks, step)
        # limits: block -> largest |coefficient|; its keys are also the blocks to check
        bad = next(beyond_limits(outcome.x, self.layout, self.limits, self.limits), None)
        return (bad if outcome.status.ok and bad else outcome), memory

    def _remember(self, d: FloatArray, step: StepFormula, memory: WholeMemory) -> None:
        """Stores an accepted step, and chooses the order of the next extrapolation: that with the
        least error in this step, relative to the largest value of each block so far (`top`); blocks
        of multipliers are not `judged`."""
        past, x, starts = memory.past, step.free + d, self.loop.starts
        self.loop.remember(x, d, step, memory.kept)
        guesses = past.ring.guesses()[:, : past.n]  # (orders, n)
        errors = np.maximum.reduceat(np.abs(guesses - x), starts, axis=1)  # (orders, blocks)
        missed = (errors / np.maximum(memory.kept.top, 1e-300))[:, self.loop.judged].max(
            axis=1, initial=0.0)
        past.push(x, d)
        # a motion that no order came close to is not extrapolated
        memory.order = int(missed.argmin()) + 1 if missed.min() <= EXTRAPOLATION_ERROR else 1

    def resultant_sources(self, memory: WholeMemory | None) -> tuple[ResultantSource, ...]:
        if memory is None:
            return resultant_sources(self.equations.terms)
        # what is reported must not change how the run goes on
        return resultant_sources(self.equations.working(memory.at_newest()).terms)

    def supports(self, memory: WholeMemory) -> Mapping[str, BoolArray]:
        return memory.supports

    def counters(self, memory: WholeMemory) -> Mapping[str, int]:
        return {"factorizations": memory.factorizations,
                "support_changes": memory.support_changes, "searches": memory.searches}


def checked(terms: Iterable[tuple[Term | ReducedTerm, IntArray]]) -> tuple[Checked, ...]:
    """The terms that can reject steps, each with the numbers of its unknowns."""
    return tuple((t, columns) for t, columns in terms if t.rejects)


def rejected_step(
    outcome: StepOutcome, terms: Sequence[Checked], step: StepFormula
) -> StepOutcome:
    """The outcome, or status "not converged" where a term rejects it: for example a surface has
    passed through another one, where no contact force acts. terms: those that check steps, each
    with the numbers of its unknowns."""
    if not (outcome.status.ok and terms):
        return outcome
    rates = outcome.rates or step.at(outcome.x - step.free)[1:]
    v = rates[0]
    for term, columns in terms:
        # 1 / c1 is about the size of the step, s
        why = term.check_step(outcome.x[columns], v[columns], step.t, 1.0 / step.c1)
        if why:
            return replace(outcome, status=Status.NOT_CONVERGED, detail=why)
    return outcome


def beyond_limits(
    x: FloatArray, layout: Layout, limits: Mapping[str, float], blocks: Iterable[str]
) -> Iterator[StepOutcome]:
    """Failures of the blocks among `blocks` with values that are not finite or exceed their limits,
    largest permitted |coefficient| of a block."""
    for name in blocks:
        top, limit = float(np.abs(x[layout[name]]).max(initial=0.0)), limits.get(name, np.inf)
        if not top < np.inf:
            yield StepOutcome(x, Status.NOT_FINITE, 1, name)
        elif top > limit:
            detail = f"largest coefficient {top:.3g}, {limit:.3g} allowed"
            yield StepOutcome(x, Status.DIVERGED, 1, name, detail)


def outcome_of(ended: Ended, step: StepFormula) -> StepOutcome:
    """The end of an iteration as the outcome of the step, with rates if it succeeded."""
    x, v, a = step.at(ended.d)
    if not ended.status.ok:
        return StepOutcome(x, ended.status, ended.iterations, ended.block, ended.detail)
    return StepOutcome(x, ended.status, ended.iterations, rates=(v, a), remaining=ended.remaining)


def linear_response(equations: WholeEquations, step: StepFormula, x: FloatArray) -> FloatArray:
    """Linear response (n, 2 n) of the solution x of a step to changes of its history terms, by the
    exact Jacobian; dense. Raises RuntimeError where that is singular.

    With v = c1 x + r1 and a = c2 x + r2 a step solves R(x, v, a, t) = 0, so that
    dx = -J^-1 (C dr1 + M dr2), with C = dR/dv, M = dR/da and J = dR/dx + c1 C + c2 M.
    """
    layout, t = equations.layout, step.t
    here = equations.working()
    c1, c2 = rate_factors(layout, step.c1, step.c2, step.c1_first)
    at = x, c1 * x + step.r1, c2 * x + step.r2, t
    zero, one = np.zeros(layout.size), np.ones(layout.size)
    K = here.slope(*at, zero, zero)
    C, M = here.slope(*at, one, zero) - K, here.slope(*at, zero, one) - K
    factor = here.factorize(here.slope(*at, c1, c2))
    return np.asarray(-factor.solve(np.hstack([C, M])))


@dataclass(frozen=True, eq=False)
class WholeNewton:
    """Solution of a whole step with its exact Jacobian, where a cheaper one does not contract, as
    for the large displacements of a soft body. make: function that assembles the equations when
    they are first needed."""

    make: Callable[[], WholeEquations]
    tolerances: Tolerances

    @cached_property
    def equations(self) -> WholeEquations:
        return self.make()

    @cached_property
    def loop(self) -> Loop:
        return Loop(self.equations.layout, self.tolerances)

    def solve(
        self, step: StepFormula, past: Predictor, kept: KeptJacobian, sizes: KeptJacobian
    ) -> StepOutcome:
        """Solution of a step, the first that converges: from the extrapolation of past states with
        the kept Jacobian; from there with a new one in each iteration ("textbook"); from the newest
        state with a new one in each. Its `iterations` are those of all attempts. kept: Jacobian of
        this method, and largest magnitude of each block (`top`) and of its highest rates (`rate`)
        so far, (blocks,), to which changes are relative; sizes: the same of the cheaper method."""
        if not len(kept.top):  # first step of the run that needs this
            kept.top, kept.rate = (np.zeros(len(past.starts)) for _ in range(2))
        before = self.loop.largest(np.abs(past.ring.rows[:, : past.n]).max(axis=0))
        kept.top = np.maximum(np.maximum(kept.top, sizes.top), before)
        kept.rate = np.maximum(kept.rate, sizes.rate)
        guess, newest, iterations = past.guess(step), past.newest - step.free, 0
        for d, textbook in ((guess, False), (guess, True), (newest, True)):
            equations = self.equations.working()
            if textbook:
                equations.price = 0  # a new Jacobian in each iteration (`StepEquations`)
                kept.forget()
            equations.begin(step, d)
            ended = self.loop.solve(equations, step, d, kept, past.newest)
            iterations += ended.iterations
            if ended.status.ok:
                break
        if not ended.status.ok:
            kept.forget()
        return outcome_of(ended._replace(iterations=iterations), step)
