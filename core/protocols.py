"""The contracts between parts. All arrays are float64 unless said otherwise; units are SI.

A plugin author reads this file. Configuration is a frozen `Plugin`; numbers live in what its
methods return. Nothing keeps state between calls: memory is passed in and handed back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.mesh import Mesh
from sparsemor.core.status import Status
from sparsemor.core.tables import LoadTable

# --------------------------------------------------------------------------- equations


@runtime_checkable
class Term(Protocol):
    """A sum of equations' parts: rows it adds to, columns (stencil) it reads.

    `rows` (m,) and `columns` (n,) are positions in the layout's flat vector. `x, v, a` are the
    unknowns and their rates *at `columns`*, shape (n,); `t` in s. Laws, tested on every term:

    * `restrict(keep).residual(...) == residual(...)[keep]`, likewise the Jacobian, where the
      restricted term may have a smaller stencil;
    * `compress(trial, left).residual(xi, ...) == left @ residual(offset + atoms xi, ...)`.

    Optional: `linear = True` where the residual is K x + C v + M a - f(t) with constant matrices:
    they are then assembled once; `doubt(x, v, t, h)`, which says why the end of a step of about h
    (s) is not to be trusted although it converged, "" if it is.
    """

    @property
    def rows(self) -> IntArray: ...
    @property
    def columns(self) -> IntArray: ...
    @property
    def elements(self) -> int:
        """Number of mesh elements that one evaluation visits (0 for constant matrices)."""
        ...

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        """d residual / dx where dv = c1 dx, da = c2 dx (c1, c2 of shape (n,)); (m, n)."""
        ...

    def restrict(self, keep: IntArray) -> "Term":
        """The rows number `keep` (positions in `rows`) of this term."""
        ...

    def compress(self, trial: "Trial", left: FloatArray) -> "ReducedTerm":
        """left (l, m): what `left @ residual` is as a function of reduced unknowns."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The affine map from reduced unknowns to a term's columns: x = offset + atoms @ xi.

    atoms (n, k), offset (n,) at the term's own columns; v = atoms @ xi', a = atoms @ xi''.
    """

    atoms: FloatArray
    offset: FloatArray


class ReducedTerm(Protocol):
    """A compressed term: (k,) reduced unknowns and rates -> (l,) rows, (l, k) Jacobian.

    c1, c2 (k,). `elements`: number of mesh elements that one evaluation visits.
    """

    @property
    def elements(self) -> int: ...
    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray: ...


class Part(Protocol):
    """A built body, joint or load: the numbers behind one entry of the scene."""

    @property
    def name(self) -> str: ...
    def blocks(self) -> Sequence[Block]: ...
    def terms(self, layout: Layout, parts: Mapping[str, "Part"]) -> Sequence[Term]: ...


class BodyPlugin(Protocol):
    """A body of the scene. base: folder of the scene file, for relative paths.

    Optional: `expected()` -> a `core.mesh.BodySize`, or None where it cannot be known; a run that
    would not fit in memory is then refused before anything is meshed.
    """

    def build(self, name: str, base: Path) -> Part: ...


class MeshPlugin(Protocol):
    """A mesh of a body. Optional: `expected()` -> a `core.mesh.MeshSize`, before it is built."""

    def build(self, base: Path) -> Mesh: ...


class ConnectorPlugin(Protocol):
    """A joint, contact or load of the scene, built once the bodies stand.

    InputError keys are relative to its own entry in the scene (`between`, `on`). A class attribute
    `acts_on = "thermal"` says that the motion does not depend on it: a rigid stage leaves it out.
    """

    def build(self, name: str, parts: Mapping[str, Part]) -> Part: ...


# --------------------------------------------------------------------------- contact


class NormalLaw(Protocol):
    """Pressure (Pa) between two surfaces: force per area, whatever the size of a facet.

    breaks: penetrations above 0 (m, increasing) where a derivative jumps; quadrature splits there.
    """

    @property
    def breaks(self) -> tuple[float, ...]: ...
    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pressure and its derivatives by penetration depth > 0 (m) and its rate (m/s), all of one
        shape. Surfaces do not pull: a negative pressure is taken for none."""
        ...


class FrictionLaw(Protocol):
    """Friction traction over pressure. breaks: slip speeds (m/s) where a derivative jumps."""

    @property
    def breaks(self) -> tuple[float, ...]: ...
    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of the sign of the slip velocity (m/s), which it opposes; and its derivative, s/m. In
        space it is asked with the slip's speed, at least 0, and acts along the slip."""
        ...


# --------------------------------------------------------------------------- time


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


class TimeFunction(Protocol):
    """A scalar function of time, for loads and prescribed motion."""

    def value(self, t: float) -> float: ...
    def rate(self, t: float) -> float: ...


# --------------------------------------------------------------------------- representation


@dataclass(frozen=True, slots=True, eq=False)
class BlockData:
    """What is known of one reducible block (one field of one body) before it is reduced.

    snapshots (n, M) unknowns in columns (empty (n, 0) when the reducer needs none);
    mass, stiffness: (n, n) csr of the constant operators (capacity, conductivity for heat);
    coordinates (n, d): reference position of each unknown's node, m; component (n,): 0..d-1 for
    displacements, 0 for temperature; loads (n, j): constant load vectors, unit amplitude: given
    forces or heat, inertia, weight, joint forces, and the constant part; load_names (j,): what
    each is ("gravity y", "joint B x"), all different.
    joints: numbers of the columns of `loads` that are joint forces: P with s = P^T u the
    displacements that the joints see; interface: rows that they act on. start (n,): unknowns at
    the start. Thermoelastic bodies: coupling (n, nT), loads = coupling @ temperatures, and
    `heat`, the data of the thermal block (without snapshots); None elsewhere.
    moving: loads whose place on the body changes; ring: rows of all elements that touch their
    path, sorted. step: size h of the steps it is reduced for, s, and factors: what such a step
    multiplies `damping` (None: zero) and `mass` by, c1 and c2 of its formula, or 0 and the c1 of
    first-order unknowns for heat, whose mass is its capacity. All 0 where no step is known.
    solver: who solves with these matrices; None leaves it to the basis.
    """

    name: str
    snapshots: FloatArray
    mass: Csr
    stiffness: Csr
    coordinates: FloatArray
    component: IntArray
    loads: FloatArray
    load_names: tuple[str, ...] = ()
    joints: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    interface: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    start: FloatArray = field(default_factory=lambda: np.zeros(0))
    coupling: Csr | None = None
    heat: "BlockData | None" = None
    moving: tuple[LoadTable, ...] = ()
    ring: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    damping: Csr | None = None
    factors: tuple[float, float] = (0.0, 0.0)
    step: float = 0.0
    solver: "LinearSolver | None" = None

    @property
    def size(self) -> int:
        return int(self.coordinates.shape[0])

    @property
    def places(self) -> "Places":
        return Places(self.coordinates, self.component)

    @property
    def operator(self) -> Csr:
        """D = K + c1 D_m + c2 M, or B = K_T + c1 C: what a step solves with, (n, n)."""
        c1, c2 = self.factors
        D = self.stiffness + c2 * self.mass
        return D if self.damping is None else D + c1 * self.damping


@dataclass(frozen=True, slots=True, eq=False)
class Dictionary:
    """x = offset + atoms @ c. atoms (n, k) have unit columns; provenance names each of them.

    `info` holds what the basis wants reported (numbers and strings only).
    """

    atoms: FloatArray
    offset: FloatArray
    provenance: tuple[str, ...]
    info: Mapping[str, float | int | str] = field(default_factory=dict)


class Basis(Protocol):
    """Builds the dictionary of one block."""

    @property
    def needs_snapshots(self) -> bool: ...
    def build(self, data: BlockData) -> Dictionary: ...


class Sampler(Protocol):
    """Chooses rows of one block: all of `required` and `m` more, sorted, distinct."""

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray: ...


class Preconditioner(Protocol):
    """P (m, m), nonsingular, for sampled rows A (m, k) applied to the atoms."""

    def check(self, rows: int, atoms: int) -> str:
        """"" when it is defined for this shape, else the reason in words."""
        ...

    def build(self, A: FloatArray) -> FloatArray: ...


# --------------------------------------------------------------------------- sparse recovery


@dataclass(frozen=True, slots=True)
class Group:
    """Columns `start:stop` of a sparse problem. budget None: always active, not penalised."""

    name: str
    start: int
    stop: int
    budget: int | None


class SparseProblem(Protocol):
    """Find c with few active entries per group so that residual(c) is least in the 2-norm.

    Rows come scaled: they may be compared and summed. `needs`: names of `core.capabilities`.
    """

    @property
    def needs(self) -> frozenset[str]: ...
    @property
    def groups(self) -> tuple[Group, ...]: ...
    def residual(self, c: FloatArray) -> FloatArray: ...
    def jacobian(self, c: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class SparseStart:
    """First guess c (k,) and the support (k,) bool that earlier steps left active."""

    c: FloatArray
    support: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class SparseOutcome:
    """c (k,) is zero outside `support` in every budgeted group."""

    c: FloatArray
    support: BoolArray
    status: Status
    iterations: int
    residual_norm: float


class SparseSolver(Protocol):
    """`capabilities` (optional): names of `core.capabilities` it has; left out, it has them all."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome: ...


# --------------------------------------------------------------------------- linear systems


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where unknowns belong: coordinates (n, d) of each one's node, m; component (n,) 0..d-1 for
    displacements, all 0 for temperatures (as in `BlockData`). Unknowns of a node are neighbours."""

    coordinates: FloatArray
    component: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class LinearOutcome:
    """x (n,) or (n, j), as b was. iterations: the most that a column took, 0 for a direct solver.
    residual: the largest norm(b - A x) / norm(b) of all columns, as computed from this x."""

    x: FloatArray
    status: Status
    iterations: int
    residual: float


class Factorized(Protocol):
    """A matrix made ready for many right-hand sides. Immutable: equal calls give equal results.

    solver: name of the plugin that did it (not "auto"); note: a sentence on why, or on what failed,
    "" when there is nothing to say. status: not ok when A is found singular, not positive definite
    or not finite; then every solution is nan. memory: bytes that it holds beside A. iterative:
    whether a start helps, and a solve may stop short.
    """

    @property
    def solver(self) -> str: ...
    @property
    def note(self) -> str: ...
    @property
    def status(self) -> Status: ...
    @property
    def memory(self) -> int: ...
    @property
    def iterative(self) -> bool: ...
    def solve(self, b: FloatArray, start: FloatArray | None = None) -> FloatArray:
        """x of b (n,) or (n, j). start: a guess of the same shape, which direct solvers ignore.
        Columns that an iteration did not solve to its tolerance are nan: no loop misses that."""
        ...

    def outcome(self, b: FloatArray, start: FloatArray | None = None) -> LinearOutcome:
        """The same with its status and true residual; x is the best that was found."""
        ...


class LinearSolver(Protocol):
    """A (n, n) csr, symmetric positive definite; places: what its unknowns are, where known.

    InputError when A is not square or not symmetric, or when it does not fit in memory.
    Optional: `expected(A, places)`, bytes that `factorize` holds at its largest, told beforehand;
    without it a run is not refused on its account. `direct = True`: its factors fill in, whatever
    memory there is.
    """

    def factorize(self, A: Csr, places: Places | None = None) -> Factorized: ...


# --------------------------------------------------------------------------- reducers


@dataclass(frozen=True, slots=True, eq=False)
class StepOutcome:
    """x (n,) in the step solver's own layout. block: where it failed, if it did."""

    x: FloatArray
    status: Status
    iterations: int
    block: str = ""
    detail: str = ""


class StepSolver(Protocol):
    """Solves one step of one (full or reduced) model. Immutable; memory goes in and out.

    `dictionaries` maps block names to the map back to full unknowns (absent: kept as they are);
    `rows`, `elements_touched`: per block; `supports(memory)`: active atoms per budgeted block;
    `notes`: what a user should know before trusting the run, in sentences; `facts`: block name ->
    numbers worth reporting (condition of its rows, interpolation points, elements kept).

    Optional, for the linearised one-step map (core/stability): `frozen(memory)` -> a step solver on
    the supports and rows that `memory` is at, and its memory; `alone()` -> elastic block ->
    (s, 2 s) how its active unknowns answer to their own r1 and r2, everything else held;
    `response(step, x)` -> (n, 2 n) how the solution x of a step answers to changes of [r1; r2],
    where the solver knows that better than differences tell. Optional, for error-controlled steps:
    `memory.moved(x)`, told that the next step starts at x. Optional, where blocks are solved by
    iteration: `linear_iterations(memory)` -> block -> iterations since `start`. Optional:
    `acting(memory)`, terms whose resultants are kept at the stored steps (core/acting.py).
    """

    @property
    def facts(self) -> Mapping[str, Mapping[str, float | int | str]]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...

    @property
    def layout(self) -> Layout: ...
    @property
    def dictionaries(self) -> Mapping[str, Dictionary]: ...
    @property
    def rows(self) -> Mapping[str, IntArray]: ...
    @property
    def elements_touched(self) -> Mapping[str, int]: ...
    def start(self, state: State) -> tuple[State, Any]:
        """From a full-order state to this solver's state (consistent rates) and memory."""
        ...

    def solve(self, step: StepFormula, memory: Any) -> tuple[StepOutcome, Any]: ...
    def supports(self, memory: Any) -> Mapping[str, BoolArray]: ...
    def counters(self, memory: Any) -> Mapping[str, int]:
        """"factorizations", "support_changes", ... counted since `start`."""
        ...


@runtime_checkable
class Resampling(Protocol):
    """What a step solver may have besides: rows that change during the run. `rows` are those of the
    start; `counters` then hold "resamplings"."""

    def rows_at(self, memory: Any) -> Mapping[str, IntArray]:
        """The rows in use, per block."""
        ...


class Reducer(Protocol):
    """How one step is solved. model: a `core.model.Model`; offline: a `core.offline.Offline`.

    Optional, for the estimate of memory: `basis`, `bases` (pattern -> basis) and `force_basis` say
    whether a training run is needed; `snapshot_copies`: how many arrays as large as a block's
    snapshots it holds at once, where it reads them as a whole.
    """

    def prepare(
        self, model: Any, integrator: Integrator, h: float, offline: Any, rng: np.random.Generator
    ) -> StepSolver: ...


__all__ = [
    "Basis", "Block", "BlockData", "Dictionary", "Factorized", "FrictionLaw", "Group", "Integrator",
    "Layout", "LinearOutcome", "LinearSolver", "Mesh", "NormalLaw", "Part", "Places",
    "Preconditioner", "ReducedTerm", "Reducer", "Resampling", "Sampler", "SparseOutcome",
    "SparseProblem", "SparseSolver", "SparseStart", "State", "StepFormula", "StepOutcome",
    "StepSolver", "Term", "TimeFunction", "Trial",
]
