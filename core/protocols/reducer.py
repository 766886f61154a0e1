"""Interfaces of model reduction: reducers, the assembled models that they reduce, and offline data
such as snapshots."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, Self, TypeAlias, TypeVar

import numpy as np

from sparsemor.core.arrays import Arrays, Csr, FloatArray, IntArray
from sparsemor.core.errors import Fault
from sparsemor.core.notes import Note
from sparsemor.core.protocols.basis import Basis, BlockData, Dictionary
from sparsemor.core.protocols.body import Part
from sparsemor.core.protocols.integrator import Integrator, State
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.linear_solver import DofLocations, Factorized, LinearSolver
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.separable import Separated
from sparsemor.core.protocols.step_solver import StepSolver
from sparsemor.core.protocols.term import Term

T = TypeVar("T")


class StepFactors(NamedTuple):
    """Time step h, s, and factors of the step formula v = c1 x + r1, a = c2 x + r2; c1_first
    replaces c1 for first-order unknowns."""

    h: float
    c1: float
    c2: float
    c1_first: float


@dataclass(frozen=True, slots=True)
class Recording:
    """Recording of training snapshots: one every `every` steps of size `step`, s, computed by
    `integrator`.

    end: end time of the training run, s. If the integrator's order is above 1, the last snapshot is
    x + h^2 a of the initial state. runs: number of training runs of equal length, whose snapshots
    follow each other.
    """

    integrator: Integrator
    step: float
    every: int
    end: float = 0.0
    runs: int = 1


class AssembledModel(ABC):
    """Assembled model: layout of the unknowns, equations and initial values.

    terms: residual terms of all equations; by_part: the same by the body, joint, contact or load
    that contributes them; separated: the same equations as operators of each
    block, for fast steps; x0, v0 (n,): initial values and rates. required: row numbers of each
    reducible (elastic or thermal) block that joints and localized loads act on; loaded: the same
    for each joint or load by name. starts: list with the consistent initial state once it is
    computed, empty before; made: what `once` has kept.
    """

    __slots__ = ()
    layout: Layout
    parts: Mapping[str, Part]
    by_part: Mapping[str, tuple[Term, ...]]
    separated: Separated
    x0: FloatArray
    v0: FloatArray
    required: Mapping[str, IntArray]
    loaded: Mapping[str, Mapping[str, IntArray]]
    starts: list[State]
    made: dict[object, Any]

    def once(self, key: tuple[object, ...], make: Callable[[], T]) -> T:
        """What `make` returns: kept with the model under this key, which tells all that it depends
        on besides the model, for its further runs."""
        if key not in self.made:
            self.made[key] = make()
        found: T = self.made[key]
        return found

    @property
    @abstractmethod
    def terms(self) -> tuple[Term, ...]: ...
    @abstractmethod
    def reducible(self) -> tuple[str, ...]:
        """Names of the elastic and thermal blocks."""

    @abstractmethod
    def places(self, name: str) -> DofLocations:
        """Node coordinates and components of the unknowns of an elastic or thermal block."""

    @abstractmethod
    def linear_solver(self, name: str) -> LinearSolver:
        """Linear solver that the user chose for an elastic or thermal block."""

    @abstractmethod
    def factorize(
        self, name: str, A: Csr, purpose: str = "steps", places: DofLocations | None = None
    ) -> Factorized:
        """Factorization of a matrix A (n, n) of an elastic or thermal block by its linear solver;
        places: node coordinates of its unknowns, if they are not those of the block."""

    @abstractmethod
    def block_data(
        self, name: str, snapshots: FloatArray | None = None, step: StepFactors | None = None
    ) -> BlockData:
        """Matrices, load vectors and node coordinates of an elastic or thermal block; snapshots (n,
        M); step: size and factors of the time steps that it is reduced for."""

    @abstractmethod
    def ring(self, name: str) -> IntArray:
        """Sorted row numbers of a block that belong to elements along the path of moving loads."""

    @abstractmethod
    def with_separated(self, separated: Separated) -> Self:
        """Copy of the model with other block operators."""


class OfflineProducts(Protocol):
    """Offline data of model reduction: snapshots of the training run and results computed from
    them, kept in a cache.

    trained: True if some trial basis needs snapshots; recording: how they were recorded, None for
    snapshots supplied by the caller.
    """

    @property
    def trained(self) -> bool: ...
    @property
    def recording(self) -> Recording | None: ...

    def snapshots(self, name: str) -> FloatArray:
        """Snapshots (n, M) of a block; the training run is made at the first call."""
        ...

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        """Trial basis of a block, and the largest coefficient of its snapshots in this basis (0
        without snapshots). step: of the reduced run, for bases that depend on it."""
        ...

    def remember(
        self, kind: str, depends: Sequence[object], make: Callable[[], Arrays]
    ) -> Arrays:
        """Arrays of one offline result, from the cache or computed by `make`. depends: all data on
        which they depend except the training run."""
        ...

    def learning(self, count: int) -> "OfflineProducts":
        """Offline data of the first `count` snapshots alone, or of all training runs but the last
        if there are several, without a cache."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ReducedProblem:
    """Input of a reducer: the model to reduce, its time integration and offline data.

    step: time step h, s. offline: snapshots and trial bases. rng: the only source of randomness.
    steps: number of steps of the run, 0 if it is not known; estimated: True if the error of the run
    is to be estimated where the reducer leaves that open; every: number of steps from one estimate
    to the next in a run that is resumed, 0 for a new one.
    """

    model: AssembledModel
    integrator: Integrator
    step: float
    offline: OfflineProducts
    rng: np.random.Generator
    steps: int = 0
    estimated: bool = False
    every: int = 0


@dataclass(frozen=True, slots=True)
class TrialRun:
    """Reduced run over the training run, whose snapshots are its reference.

    method: reducer and what its bases were learned from, in words; atoms: block -> number of atoms;
    errors: block -> largest error relative to the largest change of the block, `inf` for a run that
    failed; holdout: the same in the part of the training run that the bases have not learned, empty
    without such a part; ms: CPU time per step, ms, None for a projection of the snapshots, which is
    no run; elements: number of elements visited per step.
    """

    method: str
    atoms: Mapping[str, int]
    errors: Mapping[str, float]
    holdout: Mapping[str, float]
    ms: float | None
    elements: int = 0


@dataclass(frozen=True, slots=True)
class Choice:
    """Reducer that was chosen by trial runs.

    reducer: its options, as in a scene; trials: all trial runs, the chosen reducer last; reasons:
    what speaks for and against the choice, one sentence each; doubts: the same where the tolerance
    is not met.
    """

    reducer: Mapping[str, object]
    trials: tuple[TrialRun, ...]
    reasons: tuple[str, ...]
    doubts: tuple[str, ...] = ()


ErrorAction: TypeAlias = Literal["warn", "stop", "fall_back", "enrich"]
"""What a run does where its estimated error exceeds the tolerance."""


@dataclass(frozen=True, slots=True)
class ErrorLimit:
    """Largest permitted estimate of a block's error, relative to its largest change, what the run
    does beyond it, and the number of steps from one estimate to the next (0: none is given).
    at_few_steps: whether the error is estimated without such a number, at few steps; `auto`: where
    the caller wants it (`ReducedProblem.estimated`)."""

    tolerance: float = 0.1
    action: ErrorAction = "warn"
    every: int = 0
    at_few_steps: Literal["auto", "on", "off"] = "off"


class ErrorEstimator(Protocol):
    """Estimator of the error x_full - x_reduced of a reduced run against the full-order run of the
    same steps.

    every: number of steps from one estimate to the next, at most (`due`); blocks: names of the
    blocks with an estimate; notes: blocks without one, with the reason.
    """

    @property
    def every(self) -> int: ...
    @property
    def blocks(self) -> tuple[str, ...]: ...
    @property
    def notes(self) -> tuple[Note, ...]: ...
    def due(self, step: int) -> bool:
        """True if there is an estimate after a step of this number, counted from the start of the
        run: at least after each `every`-th."""
        return step % self.every == 0

    def start(self, full: State, reduced: State) -> dict[str, FloatArray]:
        """Memory of the estimate at the start of a run, from its initial state in the unknowns of
        the full model and in those of the reduced one."""
        ...

    def corrected(self, full: State, memory: Mapping[str, FloatArray]) -> State:
        """A state of the full model plus the estimated errors and their rates."""
        ...

    def present(self, memory: Mapping[str, FloatArray]) -> dict[str, float]:
        """Norm of each block's estimated error at the last state that `memory` knows."""
        ...

    def advance(
        self, paths: Sequence[Sequence[State]], memory: dict[str, FloatArray]
    ) -> Mapping[str, FloatArray]:
        """Block -> norms (j,) of its estimated error at the ends of j successive paths, the states
        of the reduced run, step by step, to a step with an estimate (`due`); the first begins after
        the state of `memory`, which is brought to the last. After a restart the first path may be
        shorter."""
        ...

    def carry(self, count: int, memory: dict[str, FloatArray]) -> Mapping[str, FloatArray]:
        """The same for `count` estimates along full-order steps, to which no error is added."""
        ...


@dataclass(frozen=True, slots=True)
class BlockBudget:
    """Limits of sampled rows and active atoms (trial vectors) for one block; None: decided by the
    reducer.

    rows: number of sampled rows in addition to those of joints and localized loads; atoms: largest
    number of active atoms.
    """

    rows: int | None = None
    atoms: int | None = None


class BlockBases(NamedTuple):
    """Trial bases of the blocks of unknowns: `shared`, and others by block-name pattern."""

    shared: Basis
    others: Mapping[str, Basis]


class Reducer(Plugin):
    """Model reduction method: `prepare` makes a solver for the time steps of the reduced model."""

    shared_options: ClassVar[tuple[str, ...]] = ()
    """Names of options that have the same meaning in other reducers; a change of the reducer's name
    keeps their values."""

    @abstractmethod
    def prepare(self, problem: ReducedProblem) -> StepSolver:
        """Step solver of the reduced model. Raises InputError for an unsuitable model, SolveFailed
        for singular matrices."""

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Errors that follow from numbers of rows and unknowns, before any training run; keys are
        relative to the reducer (`budgets.*.elastic.rows`)."""
        return ()

    def trial_bases(self) -> BlockBases | None:
        """Trial bases; None for a reducer that keeps all unknowns. A training run is made if any of
        them needs snapshots."""
        return None

    def force_bases_used(self) -> Sequence[Basis]:
        """Bases of forces, interpolated as in DEIM, in addition to the trial bases."""
        return ()

    @property
    def full_order(self) -> bool:
        """True if the number of unknowns is not reduced."""
        return self.trial_bases() is None

    @property
    def snapshot_copies(self) -> int | None:
        """Number of arrays of the size of a block's snapshots in memory at once, during
        preparation; None: as many as bases need."""
        return None

    @property
    def keeps_joint_rows(self) -> bool:
        """True if full-order rows on which joints act are among its equations: they determine joint
        forces even where atoms keep the constraints by themselves."""
        return False

    def restart_refusal(self) -> str:
        """Reason why step solvers cannot begin a step at a state that they did not compute, as
        adaptive time stepping requires; "" if they can, and their memory has `restarts`."""
        return (f"adaptive steps begin at states that the reducer did not compute, which "
                f"{type(self).__module__}.{type(self).__qualname__} cannot: it has no "
                "`restart_refusal`")

    @property
    def error_limit(self) -> ErrorLimit:
        """Largest permitted estimate of the error of a run."""
        return ErrorLimit()

    def error_estimator(self, problem: ReducedProblem, solver: StepSolver) -> ErrorEstimator | None:
        """Estimator for runs of `solver`, which this reducer prepared for `problem`; None where
        none is requested."""
        return None

    def field_budget(self, field: str) -> BlockBudget | None:
        """Limits of sampled rows and active atoms (trial vectors) for a field, which parameter
        studies vary; None if nothing is limited."""
        return None

    def with_rows(self, rows: Mapping[str, int]) -> Self | None:
        """Copy of the reducer with new numbers of sampled rows, by field; None without budgets."""
        return None

    def with_atoms(self, atoms: Mapping[str, int]) -> Self | None:
        """Copy of the reducer with new numbers of active atoms, by field; a basis with an option
        for its number of atoms gets the same number, so that all its atoms are active. None without
        budgets."""
        return None

    @property
    def chooses(self) -> bool:
        """True for a reducer that is replaced by another one before a run."""
        return False

    def left_out(self, problem: ReducedProblem) -> tuple[str, ...]:
        """Names of the blocks that the scene does not need: fields that are constant in the
        training run, of which the problem has the model and the snapshots."""
        return ()

    def choose(
        self, problem: ReducedProblem,
        unstable: Callable[[Mapping[str, object], StepSolver, Sequence[State]], str],
    ) -> Choice:
        """Reducer that replaces this one, for a training run as in `left_out`.

        unstable: options of a reducer, its step solver, and states of a run of it that are close to
        the training run, none if there was no such run -> reason why it must not be chosen, "" for
        a stable one. Raises InputError where none can be chosen.
        """
        raise NotImplementedError
