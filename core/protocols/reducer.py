"""Reducers, and the assembled models and offline products that they are prepared from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self, runtime_checkable

import numpy as np

from sparsemor.core.arrays import Arrays, Csr, FloatArray, IntArray
from sparsemor.core.errors import Fault
from sparsemor.core.protocols.basis import Basis
from sparsemor.core.protocols.block_data import BlockData, Dictionary
from sparsemor.core.protocols.integrator import Integrator, State
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.linear_solver import DofLocations, Factorized, LinearSolver
from sparsemor.core.protocols.part import Part
from sparsemor.core.protocols.sampler import Sampler
from sparsemor.core.protocols.separable import Separated
from sparsemor.core.protocols.step_solver import StepSolver
from sparsemor.core.protocols.term import Term


class StepFactors(NamedTuple):
    """Step size h, s, and c1, c2 of a step formula; c1_first: c1 of first-order unknowns."""

    h: float
    c1: float
    c2: float
    c1_first: float


@dataclass(frozen=True, slots=True)
class Recording:
    """Provenance of training snapshots: `every` that many steps of `step` s, by `integrator`.

    end: of the training run, s. Where the integrator's order is above 1, the last snapshot is
    x + h^2 a of the start.
    """

    integrator: Integrator
    step: float
    every: int
    end: float = 0.0


class BlockLinearSolvers(Protocol):
    """The scene's choice of linear solvers: a default, and others by block pattern."""

    @property
    def default(self) -> LinearSolver: ...
    @property
    def others(self) -> Mapping[str, LinearSolver]: ...
    def of(self, block: str) -> LinearSolver:
        """The linear solver of a block."""
        ...


class AssembledModel(Protocol):
    """An assembled scene.

    layout: all unknowns; terms: the equations, which `separated` holds in blocks for fast steps;
    x0, v0 (n,): the start. required: local rows of each reducible block that joints and localized
    loads act on; loaded: the same for each of them by name.
    """

    @property
    def layout(self) -> Layout: ...
    @property
    def parts(self) -> Mapping[str, Part]: ...
    @property
    def terms(self) -> tuple[Term, ...]: ...
    @property
    def separated(self) -> Separated: ...
    @property
    def x0(self) -> FloatArray: ...
    @property
    def v0(self) -> FloatArray: ...
    @property
    def required(self) -> Mapping[str, IntArray]: ...
    @property
    def loaded(self) -> Mapping[str, Mapping[str, IntArray]]: ...
    @property
    def solvers(self) -> BlockLinearSolvers: ...
    @property
    def starts(self) -> list[State]:
        """The consistent start, once it was computed."""
        ...

    def reducible(self) -> tuple[str, ...]:
        """Names of the elastic and thermal blocks."""
        ...

    def places(self, name: str) -> DofLocations:
        """Node coordinates and components of the unknowns of a reducible block."""
        ...

    def factorize(
        self, name: str, A: Csr, purpose: str = "steps", places: DofLocations | None = None
    ) -> Factorized:
        """A matrix (n, n) of a reducible block, factorized by the scene's linear solver; places: of
        its unknowns, where they are not those of one block."""
        ...

    def block_data(
        self, name: str, snapshots: FloatArray | None = None, step: StepFactors | None = None
    ) -> BlockData:
        """Data of a reducible block; snapshots (n, M); step: the steps that it is reduced for."""
        ...

    def ring(self, name: str) -> IntArray:
        """Local rows of the elements along the path of moving loads on a block, sorted."""
        ...

    def with_separated(self, separated: Separated) -> Self:
        """The same model with other operators in its blocks."""
        ...


class OfflineProducts(Protocol):
    """Snapshots of the training run and products made from them, kept in a cache.

    trained: whether some basis needs snapshots; recording: how they were taken, None where they
    were given.
    """

    @property
    def trained(self) -> bool: ...
    @property
    def recording(self) -> Recording | None: ...

    def snapshots(self, name: str) -> FloatArray:
        """(n, M) unknowns of a block over the training run, which is made when first needed."""
        ...

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        """Dictionary of a block and the largest coefficient that its snapshots have (0: none)."""
        ...

    def remember(
        self, kind: str, depends: Sequence[object], make: Callable[[], Arrays]
    ) -> Arrays:
        """Arrays of one product, from the cache or made; depends: all that they depend on except
        the training run."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ReducedProblem:
    """A model to be reduced, and all that a reducer may use for it.

    step: time step h, s. offline: products of the training run. rng: the only source of
    randomness.
    """

    model: AssembledModel
    integrator: Integrator
    step: float
    offline: OfflineProducts
    rng: np.random.Generator


class Reducer(Protocol):
    """Preparation of a step solver. InputError where the problem does not suit, SolveFailed where
    its matrices are singular."""

    def prepare(self, problem: ReducedProblem) -> StepSolver: ...


@runtime_checkable
class ChecksModel(Protocol):
    """A reducer that refuses unsuitable models before any training run."""

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults that counting shows, keys relative to the reducer (`budgets.*.elastic.rows`)."""
        ...


@runtime_checkable
class UsesBases(Protocol):
    """A reducer with a trial basis for each block. bases: block pattern -> basis; `basis` serves
    all other blocks. A training run is made where one of them needs snapshots."""

    @property
    def basis(self) -> Basis: ...
    @property
    def bases(self) -> Mapping[str, Basis]: ...


@runtime_checkable
class UsesForceBasis(Protocol):
    """A reducer with a basis of forces next to that of the unknowns."""

    @property
    def force_basis(self) -> Basis: ...


@runtime_checkable
class HoldsSnapshots(Protocol):
    """A reducer that holds snapshots of a block as a whole while it prepares."""

    @property
    def snapshot_copies(self) -> int:
        """Arrays as large as a block's snapshots that are held at once."""
        ...


@runtime_checkable
class RestartsSteps(Protocol):
    """A reducer whose step solvers can begin a step at a state that they did not compute, as
    error-controlled steps need; the memory of such a solver satisfies `Restarts`."""

    def restart_refusal(self) -> str:
        """Why they cannot with the options of this reducer, "" where they can."""
        ...


@dataclass(frozen=True, slots=True)
class BlockBudget:
    """Share of one block that a step may use; None: as the reducer decides.

    rows: sampled ones except the prescribed; atoms: most that are active at once.
    """

    rows: int | None = None
    atoms: int | None = None


@runtime_checkable
class SharesOptions(Protocol):
    """A class of reducers with options that mean the same in every reducer that has them."""

    @property
    def shared_options(self) -> tuple[str, ...]:
        """Their names, a class attribute: a comparison of reducers passes them on."""
        ...


@runtime_checkable
class SamplesRows(Protocol):
    """A reducer whose rows are chosen by a sampler, its option `sampler`."""

    @property
    def sampler(self) -> Sampler: ...


@runtime_checkable
class BudgetsFields(Protocol):
    """A reducer with limits of rows and atoms by field, which surveys vary."""

    def field_budget(self, field: str) -> BlockBudget | None:
        """The budget of the blocks of a field; None where nothing is limited at all."""
        ...

    def with_rows(self, rows: Mapping[str, int]) -> Self:
        """The same reducer with other numbers of rows in the blocks of these fields."""
        ...

    def with_atoms(self, atoms: Mapping[str, int]) -> Self:
        """The same reducer with other numbers of active atoms; bases that count their atoms have as
        many, so that nothing is left to select."""
        ...


def shared_options(reducer: type) -> tuple[str, ...]:
    """Names of the options that a class of reducers shares with others."""
    return reducer.shared_options if isinstance(reducer, SharesOptions) else ()


def is_full_order(reducer: object) -> bool:
    """True if a reducer solves for all unknowns."""
    return not isinstance(reducer, UsesBases)
