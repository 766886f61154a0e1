"""Interfaces of step solvers, which solve one time step of a full or reduced model."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, Self

import numpy as np
from typing_extensions import TypeVar

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.integrator import (
    Integrator,
    State,
    StepFormula,
    StepOutcome,
    UpdateRules,
)
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.term import ReducedTerm, Term
from sparsemor.core.protocols.time_function import HeldFunction


@dataclass(frozen=True, slots=True, eq=False)
class ResultantSource:
    """A term that reports force resultants (a contact, say), its name in the input, and its columns
    (k,) among the unknowns."""

    name: str
    columns: IntArray
    term: Term | ReducedTerm


class StepMemory(ABC):
    """State of a step solver between time steps, with its work arrays. The run owns it;
    `StepSolver.start` makes it and `StepSolver.solve` changes it, while the solver itself is
    immutable.

    Its fields are plain data, or objects that `start` makes at the same place
    (core/results/checkpoint.py), so that a stopped run can be resumed. `__getstate__` omits work
    arrays.
    """

    __slots__ = ()

    @abstractmethod
    def copy(self) -> Self:
        """Independent copy: steps from it and from the original give bitwise equal results, also in
        two threads at once."""

    @property
    def restarts(self) -> bool:
        """True if `moved` begins a step at a state that was not computed, as adaptive time stepping
        requires."""
        return False

    def moved(self, x: FloatArray) -> None:
        """Sets x (n,) as the state at which the next step begins."""
        raise NotImplementedError


M = TypeVar("M", bound=StepMemory, default=Any)
"""Memory class of a step solver; for a solver of unknown class, whatever its own `start`
returns."""
M_contra = TypeVar("M_contra", bound=StepMemory, contravariant=True, default=Any)


class StepSolver(ABC, Generic[M]):
    """Solver of one time step of a full or reduced model. Immutable: a step writes only to the
    memory passed to it.

    dictionaries: block -> map from reduced to full unknowns (no entry: block not reduced); rows:
    block -> sampled rows; elements_touched: block -> number of elements evaluated; notes: warnings
    for the user; facts: block -> numbers to report (condition of the sampled rows, interpolation
    points, elements kept).
    """

    layout: Layout
    dictionaries: Mapping[str, Dictionary]
    rows: Mapping[str, IntArray]
    elements_touched: Mapping[str, int]
    notes: tuple[Note, ...]
    facts: Mapping[str, Mapping[str, float | int | str]]

    @abstractmethod
    def start(self, state: State) -> tuple[State, M]:
        """Initial state in the solver's unknowns with consistent rates, from a state of the full
        model; and the solver's memory."""

    @abstractmethod
    def solve(self, step: StepFormula, memory: M) -> tuple[StepOutcome, M]: ...

    def supports(self, memory: M) -> Mapping[str, BoolArray]:
        """Block -> active atoms (selected trial vectors), where atoms are selected."""
        return {}

    def counters(self, memory: M) -> Mapping[str, int]:
        """Number of events since `start`: "factorizations", "support_changes", ..."""
        return {}

    def rows_at(self, memory: M) -> Mapping[str, IntArray]:
        """Sampled rows by block that are in use; where these are drawn again during the run, `rows`
        are the initial ones, and `counters` include "resamplings"."""
        return self.rows

    def frozen(self, memory: M) -> "tuple[StepSolver, StepMemory]":
        """Step solver with fixed supports and rows, those of `memory`, and its memory, so that the
        stability check has a fixed time-step map to linearise."""
        return self, memory

    def alone(self) -> Mapping[str, FloatArray]:
        """Elastic block -> derivative (k, 2 k) of the solution in its k active unknowns by their
        own history terms [r1; r2] of the step formula, all other unknowns fixed; without the blocks
        for which it is not known."""
        return {}

    def response(self, step: StepFormula, x: FloatArray) -> FloatArray | None:
        """Exact derivative (n, 2 n) of the solution x (n,) of a step by the history terms [r1; r2];
        None where it is not known. Raises RuntimeError where the Jacobian is singular."""
        return None

    def linear_iterations(self, memory: M) -> Mapping[str, int]:
        """Block -> number of iterations of its iterative linear solver since `start`."""
        return {}

    def resultant_sources(self, memory: M | None) -> tuple[ResultantSource, ...]:
        """Terms (contacts, say) whose force resultants are recorded at the stored steps, after the
        step that left `memory`; None: before the first step, where only the names count."""
        return ()

    def many(self, rules: UpdateRules, h: float, steps: int) -> "ManySteps[M] | None":
        """A faster way for runs of `steps` steps in all of size h, s, by an integrator with these
        rules, such as compiled steps; None where there is none or it does not pay."""
        return None

    def machine_steps(self, of: "MachineRequest[M]") -> "MachineSteps":
        """Its steps as machine code that needs no Python, for a model that is exported. Raises
        InputError, with the reason, where there is none."""
        raise InputError("its reducer has no steps in machine code", "reducer")

    def linear_system(self) -> "LinearSystem":
        """Its equations as constant matrices. Raises InputError, with the reason, where they are
        not linear with constant coefficients."""
        raise InputError("its reducer has no constant matrices", "reducer")

    @property
    def leaves_mesh(self) -> bool:
        """True if the solver can do without the arrays of the mesh's size that served to prepare
        it, so that its model can be kept and run with other loads, by the methods below."""
        return False

    def projection(self, state: State) -> State:
        """State of the full model in the solver's unknowns; its rates need not be consistent."""
        raise NotImplementedError

    def without_mesh(self) -> "StepSolver":
        """The same step solver without such arrays; its `start` takes a state in its own unknowns
        and makes the rates consistent."""
        raise NotImplementedError

    def stepping_alike(self, copy: "StepSolver") -> "StepSolver":
        """A copy of the solver without mesh, made in this process, that takes its steps the same
        way (compiled, say)."""
        return copy

    def constraint_errors(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Values and time derivatives (l, 2) of the l constraint equations at a state in the
        solver's unknowns, zero where it fits the joints; and the magnitudes (l, 2) of their terms.
        Rotations count as 1 rad at least."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, eq=False)
class MachineRequest(Generic[M]):
    """What steps in machine code are made for: an integrator and its steps of size h, s; the state
    and memory at the start; inputs, functions of time that are set from outside; times (T,), s, at
    which the others are tabulated; about (o, 8), numbers (o, 10), weights (w,): o outputs of the
    state (`outputs` in reducers/step/compiled/without_python.py)."""

    integrator: Integrator
    h: float
    state: State
    memory: M
    inputs: Sequence[HeldFunction]
    times: FloatArray
    about: IntArray
    numbers: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MachineSteps:
    """Steps as an object file `code` with two functions, and their data at the start:

        int64_t sparsemor_step(double *f, int64_t *i, uint8_t *b, const double *t, const double *u)
        int64_t sparsemor_read(double *f, int64_t *i, uint8_t *b, double *y)

    The first takes a step, 1 if it converged; the second gives the outputs y. f, i, b: reals,
    integers and flags, which change; u: changes of the inputs from their first values; t: row of
    the step in `table` (T, c), of no columns where all functions are constant. outputs: number of
    outputs.
    """

    code: bytes
    reals: FloatArray
    integers: IntArray
    flags: BoolArray
    table: FloatArray
    outputs: int


@dataclass(frozen=True, slots=True, eq=False)
class LinearSystem:
    """Equations mass x'' + damping x' + stiffness x = force(t) of the n unknowns of a step solver;
    temperatures have no mass. Matrices (n, n)."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    force: Callable[[float], FloatArray]


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


S = TypeVar("S", bound=StepSolver, covariant=True)


@dataclass(frozen=True, eq=False)
class AroundSteps(StepSolver[Any], Generic[S]):
    """A step solver with the unknowns and properties of another one, `base`."""

    base: S

    def __post_init__(self) -> None:
        for name in ("layout", "dictionaries", "rows", "elements_touched", "notes", "facts"):
            object.__setattr__(self, name, getattr(self.base, name))


def resultant_sources(
    terms: Iterable[tuple[Term | ReducedTerm, IntArray]]
) -> tuple[ResultantSource, ...]:
    """The terms that report force resultants. terms: pairs of a term and its columns among the
    unknowns."""
    return tuple(ResultantSource(term.source, columns, term) for term, columns in terms
                 if term.histories)


def unavailable_resultants(terms: Iterable[ReducedTerm]) -> tuple[Note, ...]:
    """Warnings for reduced terms that omit elements on which their force resultants depend."""
    return tuple(information(
        f"contact {t.source}: this model evaluates a part of the facets, so the resultants of the "
        "contact are not known, and no history of it is kept", "resultants")
                 for t in terms if t.hides_resultants)


def resultants(known: Sequence[ResultantSource], state: State) -> Mapping[str, float]:
    """Force resultants `name.history` -> value at a state, for the given terms."""
    return {f"{a.name}.{what}": value for a in known
            for what, value in a.term.resultants(state.x[a.columns], state.v[a.columns], state.t)
            .items()}
