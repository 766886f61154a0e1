"""Interfaces of step solvers, which solve one time step of a full or reduced model."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, Self, runtime_checkable

import numpy as np
from typing_extensions import TypeVar

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.block_data import Dictionary
from sparsemor.core.protocols.integrator import State, StepFormula, StepOutcome, UpdateRules
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.term import ReportsResultants, WrapsTerm


@dataclass(frozen=True, slots=True, eq=False)
class ResultantSource:
    """A term that reports force resultants (a contact, say), its name in the input, and its columns
    (k,) among the unknowns."""

    name: str
    columns: IntArray
    term: ReportsResultants


@runtime_checkable
class StepMemory(Protocol):
    """State of a step solver between time steps, with its work arrays. The run owns it;
    `StepSolver.start` makes it and `StepSolver.solve` changes it, while the solver itself is
    immutable.

    Its fields are plain data, or objects that `start` makes at the same place
    (core/results/saved_state.py), so that a stopped run can be resumed. `__getstate__` omits work
    arrays.
    """

    def copy(self) -> Self:
        """Independent copy: steps from it and from the original give bitwise equal results, also in
        two threads at once."""
        ...


M = TypeVar("M", bound=StepMemory, default=Any)
"""Memory class of a step solver; for a solver of unknown class, whatever its own `start`
returns."""
M_contra = TypeVar("M_contra", bound=StepMemory, contravariant=True, default=Any)


class StepSolver(Protocol[M]):
    """Solver of one time step of a full or reduced model. Immutable: a step writes only to the
    memory passed to it.

    dictionaries: block -> map from reduced to full unknowns (no entry: block not reduced); rows:
    block -> sampled rows; elements_touched: block -> number of elements evaluated;
    supports(memory): block -> active atoms (selected trial vectors); notes: warnings for the user;
    facts: block -> numbers to report (condition of the sampled rows, interpolation points, elements
    kept).
    """

    @property
    def facts(self) -> Mapping[str, Mapping[str, float | int | str]]: ...
    @property
    def notes(self) -> tuple[Note, ...]: ...

    @property
    def layout(self) -> Layout: ...
    @property
    def dictionaries(self) -> Mapping[str, Dictionary]: ...
    @property
    def rows(self) -> Mapping[str, IntArray]: ...
    @property
    def elements_touched(self) -> Mapping[str, int]: ...
    def start(self, state: State) -> tuple[State, M]:
        """Initial state in the solver's unknowns with consistent rates, from a state of the full
        model; and the solver's memory."""
        ...

    def solve(self, step: StepFormula, memory: M) -> tuple[StepOutcome, M]: ...
    def supports(self, memory: M) -> Mapping[str, BoolArray]: ...
    def counters(self, memory: M) -> Mapping[str, int]:
        """Number of events since `start`: "factorizations", "support_changes", ..."""
        ...


@runtime_checkable
class RedrawsRows(Protocol[M_contra]):
    """A step solver that samples its rows again during the run. `rows` are the initial ones;
    `counters` then include "resamplings"."""

    def rows_at(self, memory: M_contra) -> Mapping[str, IntArray]:
        """Current sampled rows by block."""
        ...


@runtime_checkable
class FreezesSupport(Protocol[M_contra]):
    """A step solver with changing supports (active trial vectors) or rows that can be frozen at
    their current values, so that the stability check has a fixed time-step map to linearise."""

    def frozen(self, memory: M_contra) -> tuple[StepSolver, StepMemory]:
        """Step solver with fixed supports and rows, those of `memory`, and its memory."""
        ...


@runtime_checkable
class RespondsByBlock(Protocol):
    """A step solver that returns the linear response of each elastic block by itself."""

    def alone(self) -> Mapping[str, FloatArray]:
        """Elastic block -> derivative (s, 2 s) of the solution in its s active unknowns by their
        own history terms [r1; r2] of the step formula, all other unknowns fixed."""
        ...


@runtime_checkable
class RespondsExactly(Protocol):
    """A step solver with an exact derivative of its solution by the history terms of the step
    formula, instead of finite differences."""

    def response(self, step: StepFormula, x: FloatArray) -> FloatArray | None:
        """Derivative (n, 2 n) of the solution x (n,) of a step by the history terms [r1; r2]; None
        for a solver that has none. Raises RuntimeError where the Jacobian is singular."""
        ...


@runtime_checkable
class CountsLinearIterations(Protocol[M_contra]):
    """A step solver whose blocks are solved by iterative linear solvers."""

    def linear_iterations(self, memory: M_contra) -> Mapping[str, int]:
        """Block -> number of iterations of the linear solver since `start`."""
        ...


@runtime_checkable
class ReportsTerms(Protocol[M_contra]):
    """A step solver with terms (contacts, say) whose force resultants are recorded at the stored
    steps."""

    def resultant_sources(self, memory: M_contra | None) -> tuple[ResultantSource, ...]:
        """Terms with resultants after the step that left `memory`; None: before the first step,
        where only the names count."""
        ...


@runtime_checkable
class LeavesMesh(Protocol):
    """A step solver that can do without the arrays of the mesh's size that served to prepare it, so
    that its model can be kept and run with other loads."""

    def projection(self, state: State) -> State:
        """State of the full model in the solver's unknowns; its rates need not be consistent."""
        ...

    def without_mesh(self) -> StepSolver:
        """The same step solver without such arrays; its `start` takes a state in its own unknowns
        and makes the rates consistent."""
        ...

    def stepping_alike(self, copy: StepSolver) -> StepSolver:
        """A copy of the solver without mesh, made in this process, that takes its steps the same
        way (compiled, say)."""
        ...

    def constraint_errors(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Values and time derivatives (l, 2) of the l constraint equations at a state in the
        solver's unknowns, zero where it fits the joints; and the magnitudes (l, 2) of their terms,
        with rotations of 1 rad at least."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class StepBlock:
    """Solved steps: times t (T,), s; z (T, 3 + j, n), unknowns x, rates v, second derivatives a and
    columns of `State.memory` at the end of each; numbers of iterations, and estimated remaining
    errors (`StepOutcome`)."""

    t: Sequence[float] = ()
    z: FloatArray = field(default_factory=lambda: np.empty((0, 3, 0)))
    iterations: Sequence[int] = ()
    remaining: Sequence[float] = ()

    def __len__(self) -> int:
        return len(self.t)

    def state(self, i: int) -> State:
        """State at the end of step i."""
        z = self.z[i]
        return State(self.t[i], z[0], z[1], z[2], z[3:].T)


class ManySteps(Protocol[M_contra]):
    """Solution of several successive steps of one size in one call."""

    def advance(self, state: State, memory: M_contra, count: int) -> StepBlock:
        """Solves up to `count` steps from `state`, and changes `memory` as `StepSolver.solve` does;
        fewer, or none, where a step needs `solve`."""
        ...


@runtime_checkable
class SolvesManySteps(Protocol[M_contra]):
    """A step solver with a faster way for several steps of one size, such as compiled steps."""

    def many(self, rules: UpdateRules, h: float, steps: int) -> ManySteps[M_contra] | None:
        """The faster way for a run of `steps` steps of size h, s, by an integrator with these
        rules; None where there is none or it does not pay."""
        ...


@runtime_checkable
class Restarts(StepMemory, Protocol):
    """Memory of a step solver that can begin a step at a state that it did not compute, as adaptive
    time stepping requires."""

    def moved(self, x: FloatArray) -> None:
        """Sets x (n,) as the state at which the next step begins."""
        ...


S = TypeVar("S", bound=StepSolver, covariant=True)


@dataclass(frozen=True, eq=False)
class AroundSteps(Generic[S]):
    """A step solver that delegates its properties to `base`, which has the same unknowns."""

    base: S

    @property
    def layout(self) -> Layout:
        return self.base.layout

    @property
    def dictionaries(self) -> Mapping[str, Dictionary]:
        return self.base.dictionaries

    @property
    def rows(self) -> Mapping[str, IntArray]:
        return self.base.rows

    @property
    def elements_touched(self) -> Mapping[str, int]:
        return self.base.elements_touched

    @property
    def facts(self) -> Mapping[str, Mapping[str, float | int | str]]:
        return self.base.facts

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.base.notes


def resultant_sources(terms: Iterable[tuple[object, IntArray]]) -> tuple[ResultantSource, ...]:
    """The terms that report force resultants. terms: pairs of a term and its columns among the
    unknowns."""
    return tuple(ResultantSource(term.source, columns, term) for term, columns in terms
                 if isinstance(term, ReportsResultants) and term.histories)


def unavailable_resultants(terms: Iterable[object]) -> tuple[Note, ...]:
    """Warnings for reduced terms that omit elements on which their force resultants depend."""
    return tuple(information(
        f"contact {t.source}: this model evaluates a part of the facets, so the resultants of the "
        "contact are not known, and no history of it is kept", "resultants")
                 for t in terms if isinstance(t, WrapsTerm)
                 and isinstance(t.term, ReportsResultants) and not t.histories)


def resultant_sources_of(
    solver: StepSolver, memory: StepMemory | None
) -> tuple[ResultantSource, ...]:
    """Terms of a step solver that report force resultants, () if there are none."""
    return solver.resultant_sources(memory) if isinstance(solver, ReportsTerms) else ()


def resultants(known: Sequence[ResultantSource], state: State) -> Mapping[str, float]:
    """Force resultants `name.history` -> value at a state, for the given terms."""
    return {f"{a.name}.{what}": value for a in known
            for what, value in a.term.resultants(state.x[a.columns], state.v[a.columns], state.t)
            .items()}
