"""Recorder of a run: admission to its output directory, buffers of stored steps, probes, written
results, summary."""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.linalg.threads import elsewhere
from sparsemor.core.notes import Level, Note, information, kinds, sentences
from sparsemor.core.protocols.body import BodyShape
from sparsemor.core.protocols.integrator import State, StepOutcome
from sparsemor.core.protocols.step_solver import StepMemory, StepSolver, resultants
from sparsemor.core.protocols.time_function import HeldValues, held_values, holding
from sparsemor.core.results.arrays_in_memory import MemoryWriter
from sparsemor.core.results.checkpoint import Checkpoint, SavedError, checkpoint_file
from sparsemor.core.results.files.replaceable_files import STORE
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.json_data import finite
from sparsemor.core.results.linear_solver_cost import solvers_summary
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.output_lock import check_owned
from sparsemor.core.results.probes import ForceReader, ProbeReader, rate_columns
from sparsemor.core.results.relative_error_estimates import estimated_errors
from sparsemor.core.results.result_writer import ChunkOfSteps, ResultWriter, resumable
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stored_arrays import read_header
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.error_record import ErrorMark, ErrorRecord
from sparsemor.core.simulation.memory.limits import MemoryUse
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.status import Status


@dataclass
class StepStatistics:
    """Statistics of a run, stored in its checkpoints; their size does not grow with the number of
    steps.

    offline, online: wall time, s; done: number of steps; last_seconds, last_iterations,
    last_remaining (`StepOutcome.remaining`): those of the last step; seconds_near: k -> number of
    steps whose solution took exp(k / 100) s, within 0.5 %; active: block -> number of active atoms,
    summed over the steps; full_steps, full_seconds: number of steps of a reduced run that were
    solved at full order, and wall time for these and their preparation, s; controllers: what they
    remember.
    """

    offline: float = 0.0
    online: float = 0.0
    done: int = 0
    iterations: int = 0
    last_seconds: float = 0.0
    last_iterations: int = 0
    last_remaining: float = 0.0
    seconds_near: dict[int, int] = field(default_factory=dict)
    active: dict[str, int] = field(default_factory=dict)
    full_steps: int = 0
    full_seconds: float = 0.0
    controllers: dict[str, tuple[float, ...]] = field(default_factory=dict)

    def add(self, seconds: float, outcome: StepOutcome) -> None:
        """Counts a solved step, whose solution took so many seconds."""
        self.done += 1
        self.iterations += outcome.iterations
        self.last_seconds, self.last_iterations = seconds, outcome.iterations
        self.last_remaining = outcome.remaining
        k = round(100.0 * math.log(max(seconds, 1e-9)))
        self.seconds_near[k] = self.seconds_near.get(k, 0) + 1

    @property
    def ms_per_step(self) -> float:
        """Mean wall time per step, storage of results included, ms."""
        return 1e3 * self.online / self.done if self.done else 0.0

    @property
    def ms_per_step_solver(self) -> float:
        """Median wall time of the step solver's call alone, ms, within 0.5 %."""
        counted = 0
        for k in sorted(self.seconds_near):
            counted += self.seconds_near[k]
            if 2 * counted >= self.done:
                return 1e3 * math.exp(k / 100.0)
        return 0.0

    def count_atoms(self, supports: Mapping[str, BoolArray]) -> None:
        for name, support in supports.items():
            self.active[name] = self.active.get(name, 0) + int(np.count_nonzero(support))


CHUNK, SECONDS = 1024, 2.0
"""Number of buffered steps, and seconds since the last commit, after which results are written to
disk."""
BUFFER = 2**26
"""Bytes of buffered states after which results are written to disk."""


def admit(scene: Scene, out: Path, resume: bool) -> None:
    """Checks, before anything is computed, that a run may write to `out`, or with `resume` continue
    the result in it. Raises InputError."""
    directory = OutputDirectory(out)
    if resume:
        resumable(directory.store.absolute(), scene)
    else:
        directory.require_writable()


@contextmanager
def kept(writer: ResultWriter | MemoryWriter, new: bool) -> Iterator[None]:
    """Context that deletes a new result if its run is refused by an input error, or fails before
    its first checkpoint."""
    try:
        yield
    except (InputError, OSError) as error:
        if new and isinstance(writer, ResultWriter):
            first = not checkpoint_file(writer.path).exists()
            if first or isinstance(error, InputError) and not isinstance(error, Damaged):
                writer.discard()
        raise


@dataclass(frozen=True, slots=True, eq=False)
class RecordMark:
    """A moment of a recorder: number of buffered steps, and the moment of the error estimates."""

    rows: int
    errors: ErrorMark | None


class Recorder:
    """Recorder of one run's results: states, probes, contact forces, checkpoints and summary."""

    def __init__(
        self, run: PreparedRun, writer: ResultWriter | MemoryWriter,
        checkpoint: Checkpoint | None, products: Products | None = None,
    ) -> None:
        """checkpoint: of the result that is resumed, None for a new one; products: what was
        computed before the steps, for the summary. _rows: buffered steps as (time, s, unknowns,
        iterations, remaining error, seconds, rates of the columns `_rates`); _contacts, _held,
        _supports: contact resultants, values of functions of time and active atoms at each."""
        self.scene = run.scene
        self.writer, self.checkpoint, self.steps = writer, checkpoint, run.steps
        self.reducer = run.header.reducer
        self.products = Products(None) if products is None else products
        self.notes: tuple[Note, ...] = ()  # of a result that is resumed
        self.memory: MemoryUse | None = None
        self.folder: TemporaryFolder | None = None  # which is removed with the result
        self.errors: ErrorRecord | None = None  # set by a run that estimates its error
        self._every, self._saved = run.scene.output.every, time.perf_counter()
        self._on_disk = isinstance(writer, ResultWriter)
        self.set_run(run)
        self._rows: list[tuple[float, FloatArray, int, float, float, list[FloatArray]]] = []
        self._contacts: list[Mapping[str, float]] = []
        self._held: list[HeldValues] = []
        self._supports: list[Mapping[str, BoolArray]] = []

    def set_run(self, run: PreparedRun) -> None:
        """Records the steps of this run from now on: its step solver, forces and contacts."""
        self.run, self.solver = run, run.solver
        self._rates = rate_columns(run.forces)
        self._contact_names = frozenset(
            f"{name}.{what}" for name, kept in run.header.contacts.items() for what in kept)
        # along a rigid stage histories are kept already; only conduction acts in addition
        self._reports = run.solver if self._contact_names and run.header.stage is None else None

    def switch_run(self, run: PreparedRun, maps: Mapping[str, FloatArray]) -> None:
        """Records the rest of a run in the unknowns of another step solver; the stored steps are
        converted (`ResultWriter.continued`)."""
        self.flush()
        self.writer = self.writer.continued(run.header, maps)
        self.set_run(run)

    @property
    def fall_back(self) -> Mapping[str, Any]:
        """Time, block and reason where the run left its reduced model, {} if it did not."""
        return dict(self.writer.attributes.get("fall_back", {}))

    def mark(self) -> "RecordMark":
        """The present moment, to come back to."""
        return RecordMark(len(self._rows), None if self.errors is None else self.errors.mark())

    def roll_back(self, mark: "RecordMark") -> None:
        """Drops what came after a moment, since which nothing was written."""
        for kept in (self._rows, self._contacts, self._supports, self._held):
            del kept[mark.rows:]
        if self.errors is not None and mark.errors is not None:
            self.errors.roll_back(mark.errors)

    @classmethod
    def open(
        cls, run: PreparedRun, out: Path, resume: bool, products: Products | None,
    ) -> "Recorder":
        """Recorder of a new result in `out`, or of a stored one to be resumed. Raises InputError
        if `out` contains a result already, or with `resume` one that cannot be resumed."""
        store, scene = out / STORE, run.scene
        if resume:
            writer, checkpoint = ResultWriter.resume(store, scene, run.header)
            recorder = cls(run, writer, checkpoint, products)
            # a note where the run goes on with another processor, system or BLAS
            recorder.notes = elsewhere(read_header(store)["attributes"].get("platform", {}))
            return recorder
        admit(scene, out, resume)
        check_owned(out)
        return cls(run, ResultWriter.create(store, run.header), None, products)

    def restored(
        self, state: State, memory: StepMemory, stats: StepStatistics
    ) -> tuple[State, StepMemory, StepStatistics]:
        """State, step memory (solver data carried from step to step) and statistics at the last
        checkpoint.

        Arguments: the same at the start of the run, which have the same structure. Raises
        InputError if the checkpoint has another structure.
        """
        assert self.checkpoint is not None
        offline, arrays = stats.offline, self.checkpoint.arrays
        own = {"x": state.x, "v": state.v, "a": state.a, "memory": state.memory}
        try:
            for name, array in own.items():
                if arrays[name].shape != array.shape or arrays[name].dtype != array.dtype:
                    raise SavedError(f"{name} has shape {arrays[name].shape}, and {array.shape} "
                                     "in this program")
            # what is stored, filled into the given objects
            found = self.checkpoint.memory.into(self._carried(memory, stats), "state")
            t, memory, stats = float(arrays["t"]), found["memory"], found["stats"]
            if self.errors is not None:
                self.errors.resume(found["errors"], len(state.x))
        except (KeyError, ValueError) as error:  # SavedError, too
            raise InputError(
                f"{self._out} cannot be resumed: its checkpoint does not fit ({error}); start "
                "again, with --force or into another directory", "resume") from None
        stats.offline += offline  # preparation of both processes
        return State(t, *(arrays[name] for name in own)), memory, stats

    def _carried(self, memory: StepMemory, stats: StepStatistics) -> dict[str, object]:
        """Data in addition to the state from which a stopped run continues."""
        estimated = {} if self.errors is None else {"errors": self.errors.carried()}
        return {"memory": memory, "stats": stats, **estimated}

    def start(self, state: State, supports: Mapping[str, BoolArray], memory: StepMemory) -> None:
        """Buffers the initial state."""
        self._keep(state, StepStatistics(), supports, memory)

    def take(
        self, state: State, stats: StepStatistics, supports: Mapping[str, BoolArray],
        memory: StepMemory,
    ) -> bool:
        """Buffers an accepted step if it is to be stored, each `_every`-th and the last; True if it
        is time to commit and save a checkpoint: for BUFFER bytes, and on disk also for CHUNK steps,
        or SECONDS after the last one. errors: record of estimated errors, if the run has some."""
        if self.errors is not None:
            self.errors.take(state, stats.done)
        if stats.done % self._every and stats.done != self.steps:
            return False
        self._keep(state, stats, supports, memory)
        if len(self._rows) * state.x.nbytes >= BUFFER:
            return True
        return self._on_disk and (
            len(self._rows) >= CHUNK or time.perf_counter() - self._saved > SECONDS)

    def keep_last(
        self, state: State, stats: StepStatistics, supports: Mapping[str, BoolArray],
        memory: StepMemory,
    ) -> None:
        """Commits everything up to the last accepted step, which is stored even between two output
        steps."""
        if stats.done % self._every:
            self._keep(state, stats, supports, memory)
        self.flush()

    def _keep(
        self, state: State, stats: StepStatistics, supports: Mapping[str, BoolArray],
        memory: StepMemory,
    ) -> None:
        """Adds a state with its counts, supports and resultants to the buffers of the next chunk.
        _rates: first column -> columns of rigid coordinates whose rates force elements need;
        _reports: step solver whose contact resultants are recorded, or None."""
        self._rows.append((
            state.t, state.x, stats.last_iterations, stats.last_remaining, stats.last_seconds,
            [state.v[at].copy() for at in self._rates.values()]))
        self._held.append(held_values())
        self._supports.append(dict(supports))
        if self.errors is not None:
            self.errors.store()
        if self._reports is not None:
            found = resultants(self._reports.resultant_sources(memory), state)
            self._contacts.append({n: v for n, v in found.items() if n in self._contact_names})

    def save(self, state: State, memory: StepMemory, stats: StepStatistics) -> None:
        """Commit the buffered steps and a checkpoint. A last step between two output steps is not
        stored by a run that continues this one."""
        self.flush()
        arrays = {"t": np.array(state.t), "x": state.x, "v": state.v, "a": state.a,
                  "memory": state.memory}
        last = stats.done == self.steps and stats.done % self._every != 0
        self.writer.checkpoint(arrays, self._carried(memory, stats), int(last))
        self._saved = time.perf_counter()

    def flush(self) -> None:
        """Writes the buffered steps as one chunk, with the probes and forces at them. `_each`
        evaluates functions of a range of steps i at all of them."""
        estimates = {} if self.errors is None else self.errors.stored()
        if not self._rows:
            return
        # columns of the rows (`__init__`)
        t, x, iterations, remaining, seconds, rates = (
            list(c) for c in zip(*self._rows, strict=True))
        X, times = np.array(x), np.array(t)
        rate = dict(zip(self._rates, map(np.array, zip(*rates, strict=True)), strict=True))

        def probed(p: ProbeReader, i: slice) -> FloatArray:
            return p(times[i], X[i])

        def force(f: ForceReader, i: slice) -> FloatArray:
            return f(times[i], X[i], {column: v[i] for column, v in rate.items()})

        def given(shape: BodyShape, i: slice) -> FloatArray:
            return shape.given_at(times[i])

        supports = {name: np.array([s[name] for s in self._supports])
                    for name in self._supports[0]}
        contacts = {name: np.array([c[name] for c in self._contacts])
                    for name in (self._contacts or [{}])[0]}
        self.writer.append(ChunkOfSteps(
            times, X, np.array(iterations), np.array(remaining), np.array(seconds), supports,
            self._each({p.name: partial(probed, p) for p in self.run.probes}), contacts,
            self._each({f.name: partial(force, f) for f in self.run.forces}),
            self._each({b: partial(given, shape) for b, shape in self.run.given.items()}),
            estimates))
        self._rows, self._supports, self._contacts, self._held = [], [], [], []

    def _each(self, of: Mapping[str, Callable[[slice], FloatArray]]) -> dict[str, FloatArray]:
        """Values of functions of a range of the buffered steps, at all of them: one by one where
        functions of time have values of each step."""
        if not any(h.values for h in self._held):
            return {name: f(slice(None)) for name, f in of.items()}
        found: dict[str, list[FloatArray]] = {name: [] for name in of}
        for i, held in enumerate(self._held):
            with holding(held):
                for name, f in of.items():
                    found[name].append(f(slice(i, i + 1)))
        return {name: np.concatenate(values) for name, values in found.items()}

    def _estimated(self) -> dict[str, float]:
        """Block -> largest estimated error at the stored steps, relative to its largest change."""
        return {} if self.errors is None else {
            name: float(e.max(initial=0.0))
            for name, e in estimated_errors(self.writer.result()).items()}

    @property
    def _out(self) -> str:
        """Directory of the result, "" in memory."""
        return str(self.writer.path.parent) if isinstance(self.writer, ResultWriter) else ""

    def finish(self, status: Status, summary: Mapping[str, Any]) -> RunResult:
        """The result with its summary."""
        self.writer.finish(status, summary)
        result = self.writer.result()
        return result if self.folder is None else result.held_in(self.folder)

    def summary(
        self, status: Status, stats: StepStatistics, state: State, memory: StepMemory
    ) -> dict[str, Any]:
        """Summary of a run that ended at `state`: the JSON object that `sparsemor run --json`
        prints."""
        end, x = np.array([state.t]), state.x[None]
        solver, counters = self.solver, self.solver.counters(memory)
        atoms = {n: int(d.atoms.shape[1]) for n, d in solver.dictionaries.items()}
        done = max(stats.done, 1)
        return {
            "status": status.value,
            "scene": self.scene.name,
            "reducer": self.reducer,
            "steps": stats.done,
            "t_end": stats.done * self.scene.time.step,  # state.t is a long sum
            "wall_s": {"offline": stats.offline, "online": stats.online},
            "ms_per_step": stats.ms_per_step,
            "ms_per_step_solver": stats.ms_per_step_solver,
            "newton_iterations": stats.iterations / done,
            "factorizations": counters.get("factorizations", 0),
            "support_changes": counters.get("support_changes", 0),
            "resamplings": counters.get("resamplings", 0),
            "rows": {n: len(r) for n, r in solver.rows.items()},
            "atoms": atoms,
            "atoms_active": {n: stats.active[n] / done if n in stats.active else float(k)
                             for n, k in atoms.items()},
            "elements_touched": dict(solver.elements_touched),
            "probes": {p.name: p.described(p(end, x)[0]) for p in self.run.probes},
            "cache": dict(self.products.used),
            "offline_s": dict(self.products.seconds),
            "offline_whole_s": self.products.spent.whole(stats.offline),
            **in_summary((*self.run.notes, *self.notes, *_full_newton(counters, done),
                          *_unused(stats, atoms),
                          *_enriched(self.run.header.enriched, stats.full_steps))),
            "error_estimate": self._estimated(),
            "error_tolerance": self.scene.reducer.error_limit.tolerance,
            "fall_back": {**self.fall_back, "steps": stats.full_steps,
                          "seconds": stats.full_seconds} if self.fall_back else {},
            "enriched": {"times": times, "steps": stats.full_steps, "seconds": stats.full_seconds}
            if (times := list(self.run.header.enriched)) else {},
            **self.run.summary,
            "trained_to": self.run.trained_to,
            "linear_solvers": solvers_summary(
                [*self.run.factored(), *self.products.factorizations],
                _iterations(solver, memory), done),
            "memory": {} if self.memory is None else self.memory.summary(),
            "facts": finite(dict(solver.facts)),  # dependent columns: no finite condition
            "platform": dict(self.run.header.platform),
            "out": self._out,
        }


def in_summary(notes: Sequence[Note]) -> dict[str, list[str]]:
    """Summary entries of notes: sentences of warnings, their kinds, and sentences of
    information."""
    return {"notes": sentences(notes, Level.WARNING), "note_kinds": kinds(notes),
            "information": sentences(notes, Level.INFORMATION)}


def _full_newton(counters: Mapping[str, int], steps: int) -> tuple[Note, ...]:
    """Note on the number of steps in which the iteration with constant operators did not
    converge."""
    n = counters.get("full_newton_steps", 0)
    return () if not n else (information(
        f"{n} of {steps} steps were solved by Newton's method with the exact Jacobian, because the "
        "iteration with constant operators did not converge: large displacements of a soft body "
        "are the usual cause", "full_newton"),)


def _enriched(times: Sequence[float], steps: int) -> tuple[Note, ...]:
    """Note on atoms that were added at some times, s, from `steps` full-order steps."""
    return () if not times else (information(
        f"atoms were added {len(times)} times, first at {times[0]:.4g} s, because the estimated "
        f"error exceeded its tolerance; {steps} steps of the run were solved at full order",
        "enriched"),)


def _unused(stats: StepStatistics, atoms: Mapping[str, int]) -> tuple[Note, ...]:
    """Notes on blocks none of whose atoms was active in any step, so that they did not change."""
    return tuple(information(
        f"none of the {atoms[n]} atoms of {n} was active in any step: it kept its initial values",
        "unused_atoms") for n, active in stats.active.items() if atoms.get(n) and not active)


def _iterations(solver: StepSolver, memory: StepMemory) -> Mapping[str, int]:
    """Linear solver iterations during the run, by block; empty for a step solver that does not
    count them."""
    return solver.linear_iterations(memory)
