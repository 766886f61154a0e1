"""Step solvers: the solution of one time step of a full or reduced model."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, Self, runtime_checkable

from typing_extensions import TypeVar

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.block_data import Dictionary
from sparsemor.core.protocols.integrator import State, StepFormula
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.term import ReportsResultants, WrapsTerm
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class ResultantSource:
    """A term with resultants, its name in the scene, and its columns (k,) among the unknowns."""

    name: str
    columns: IntArray
    term: ReportsResultants


@dataclass(frozen=True, slots=True, eq=False)
class StepOutcome:
    """x (n,) in the step solver's own layout. block: where it failed, if it did."""

    x: FloatArray
    status: Status
    iterations: int
    block: str = ""
    detail: str = ""


@runtime_checkable
class StepMemory(Protocol):
    """State of a step solver between time steps, and the arrays that a step works in. Owned by the
    run, made by `StepSolver.start`, changed by `StepSolver.solve`; the solver itself is immutable.

    Its fields are plain data, or objects of which `start` makes one in the same place
    (core/results/saved_state.py), so that a stopped run can be continued. Working arrays are left
    out of `__getstate__`.
    """

    def copy(self) -> Self:
        """Separate memory of the same state: steps from it and from this one give equal bits, also
        in two threads at once."""
        ...


M = TypeVar("M", bound=StepMemory, default=Any)
"""Class of a step solver's own memory. A solver of an unknown class (`StepSolver` alone) takes what
its own `start` has returned."""
M_contra = TypeVar("M_contra", bound=StepMemory, contravariant=True, default=Any)


class StepSolver(Protocol[M]):
    """Solves one step of one (full or reduced) model. Immutable: a step writes only to the memory
    that it is given.

    `dictionaries` maps block names to the map back to full unknowns (absent: kept as they are);
    `rows`, `elements_touched`: per block; `supports(memory)`: active atoms per budgeted block;
    `notes`: what a user should know before trusting the run; `facts`: block name ->
    numbers worth reporting (condition of its rows, interpolation points, elements kept).
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
        """From a full-order state to this solver's state (consistent rates) and memory."""
        ...

    def solve(self, step: StepFormula, memory: M) -> tuple[StepOutcome, M]: ...
    def supports(self, memory: M) -> Mapping[str, BoolArray]: ...
    def counters(self, memory: M) -> Mapping[str, int]:
        """"factorizations", "support_changes", ... counted since `start`."""
        ...


@runtime_checkable
class RedrawsRows(Protocol[M_contra]):
    """A step solver whose rows change during the run. `rows` are those of the start; `counters`
    then hold "resamplings"."""

    def rows_at(self, memory: M_contra) -> Mapping[str, IntArray]:
        """The rows in use, per block."""
        ...


@runtime_checkable
class FreezesSupport(Protocol[M_contra]):
    """A step solver whose supports or rows change, and that can be held at those of a memory; the
    stability check then sees a fixed step map."""

    def frozen(self, memory: M_contra) -> tuple[StepSolver, StepMemory]:
        """A step solver on the supports and rows that `memory` is at, and its memory."""
        ...


@runtime_checkable
class RespondsByBlock(Protocol):
    """A step solver with the response of each elastic block alone."""

    def alone(self) -> Mapping[str, FloatArray]:
        """Elastic block -> (s, 2 s) response of its active unknowns to their own r1 and r2,
        everything else held."""
        ...


@runtime_checkable
class RespondsExactly(Protocol):
    """A step solver with the derivative of its solution, better than finite differences."""

    def response(self, step: StepFormula, x: FloatArray) -> FloatArray:
        """(n, 2 n) derivative of the solution x (n,) of a step by [r1; r2]."""
        ...


@runtime_checkable
class CountsLinearIterations(Protocol[M_contra]):
    """A step solver whose blocks are solved by iterative linear solvers."""

    def linear_iterations(self, memory: M_contra) -> Mapping[str, int]:
        """Block -> iterations since `start`."""
        ...


@runtime_checkable
class ReportsTerms(Protocol[M_contra]):
    """A step solver with terms whose resultants are kept at the stored steps."""

    def resultant_sources(self, memory: M_contra | None) -> tuple[ResultantSource, ...]:
        """Those terms after the step that left `memory` (None: only their names count)."""
        ...


@runtime_checkable
class Restarts(StepMemory, Protocol):
    """The memory of a step solver whose next step may start at a state that it did not compute,
    as error-controlled steps need."""

    def moved(self, x: FloatArray) -> None:
        """The next step starts at x (n,)."""
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
    """Those of the terms, each with its columns, that have resultants."""
    return tuple(ResultantSource(term.source, columns, term) for term, columns in terms
                 if isinstance(term, ReportsResultants) and term.histories)


def unavailable_resultants(terms: Iterable[object]) -> tuple[Note, ...]:
    """A sentence for each reduced term that leaves out what its resultants depend on."""
    return tuple(information(
        f"contact {t.source}: this model evaluates a part of the facets, so the resultants of the "
        "contact are not known, and no history of it is kept", "resultants")
                 for t in terms if isinstance(t, WrapsTerm)
                 and isinstance(t.term, ReportsResultants) and not t.histories)


def resultant_sources_of(
    solver: StepSolver, memory: StepMemory | None
) -> tuple[ResultantSource, ...]:
    """Terms with resultants of a step solver, () where it has none."""
    return solver.resultant_sources(memory) if isinstance(solver, ReportsTerms) else ()


def resultants(known: Sequence[ResultantSource], state: State) -> Mapping[str, float]:
    """`name.history` -> value at a state."""
    return {f"{a.name}.{what}": value for a in known
            for what, value in a.term.resultants(state.x[a.columns], state.v[a.columns], state.t)
            .items()}
