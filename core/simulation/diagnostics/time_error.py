"""Estimate of the error of a run's time step, by a few windows of steps that are taken again with
half the step (Richardson; Hairer, Norsett, Wanner 1993, doi 10.1007/978-3-540-78862-1, II.4)."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols import ReducedProblem, State, StepSolver
from sparsemor.core.protocols.integrator import settled
from sparsemor.core.protocols.step_solver import Restarts
from sparsemor.core.results.error_norms import CONSTANT_CHANGE
from sparsemor.core.scene.options import Control
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.prepare import PreparedRun
from sparsemor.core.simulation.step_control import Judged, judged
from sparsemor.core.simulation.time_stepping import FixedStep, iterate
from sparsemor.core.status import SolveFailed

TIME_ERROR = "time_error"
"""Kind of the note."""
NOTED, WARNED = 0.01, 0.05
"""Error, relative to the largest change of a field, above which a note, or a warning, says so."""
WINDOWS, LENGTH = 3, 10
"""Number of windows, and the most steps of one."""
FEWEST = 20
"""Number of steps of a run below which there is no estimate."""
LARGEST = 20_000
"""Number of unknowns of a step above which there is no estimate: another factorization would take
as much time and memory as a large part of the run."""
SMALLEST = 1e-5
"""Smallest change of a field, relative to its reference size in `time.control`, of which an error
is a share."""
CHANGES = 1000
"""Most states whose change since the start is looked at."""


@dataclass(slots=True, eq=False)
class _Window:
    """Steps that are taken again: states before and at the start, unknowns in the middle and at the
    end."""

    before: State | None
    start: State
    middle: FloatArray | None = None
    end: FloatArray | None = None


def _same_unknowns(one: StepSolver, other: StepSolver) -> bool:
    """True if both solve for the same unknowns: bases can depend on the step (`impulse`)."""
    mine, theirs = one.dictionaries, other.dictionaries
    return one.layout.size == other.layout.size and mine.keys() == theirs.keys() and all(
        np.array_equal(d.atoms, theirs[n].atoms) for n, d in mine.items())



class TimeError:
    """Windows of a run's steps with a fixed size, and the estimate of its time error from them.

    After W steps from the same state, solutions with h and h/2 differ by e(W) (1 - 2^-p), with e
    the error that these steps make and p the order. The windows show how it grows, e ~ W^g with
    g = log2(e(W) / e(W/2)) between 0 (errors die out, as in a damped vibration) and 1 (they add
    up, as in a free motion): that of N steps is about e(W) (N/W)^g. e is the root mean square over
    the windows, relative to the largest change of the field.
    """

    def __init__(self, run: PreparedRun, origin: FloatArray) -> None:
        self.run, self.origin, self.steps = run, origin, step_count(run.scene)
        self.length = min(LENGTH, max(2, self.steps // 10))
        self.half = (self.length + 1) // 2
        free = self.steps - self.length
        self.starts = {int(free * (i + 0.5) / WINDOWS) for i in range(WINDOWS)}
        sizes = Control(tolerance=0.5)
        self.blocks: tuple[Judged, ...] = tuple(
            judged(b, run.solver, sizes) for b in run.solver.layout.differential)
        self.windows: dict[int, _Window] = {}
        self.changes = dict.fromkeys((b.name for b in self.blocks), 0.0)
        self.every = max(1, self.steps // CHANGES)

    @classmethod
    def of(cls, run: PreparedRun, start: FloatArray | None) -> "TimeError | None":
        """The estimate of a run from its first unknowns, None where there is none: for steps of
        controlled error, runs without their model or resumed (`start` None), and where it would
        cost too much."""
        if (start is None or run.model is None or run.offline is None or not run.own_loads
                or run.scene.time.control is not None
                or len(start) > LARGEST or step_count(run.scene) < FEWEST):
            return None
        return cls(run, start)

    def take(self, done: int, before: State, state: State) -> None:
        """Looks at the step that ended at `state` after `done` steps, from the state `before`."""
        if done in self.starts:
            self.windows[done] = _Window(before, state)
        elif done == 1 and 0 in self.starts:
            self.windows[0] = _Window(None, before)
        if (w := self.windows.get(done - self.half)) is not None and done - self.half in (
                self.starts):
            w.middle = state.x
        if (w := self.windows.get(done - self.length)) is not None:
            w.end = state.x
        if done % self.every == 0 or done == self.steps:
            for b in self.blocks:
                self.changes[b.name] = max(
                    self.changes[b.name], b.norm(state.x - self.origin))

    def estimated(self) -> Mapping[str, float]:
        """Block -> error of its field at the end of the run, relative to the largest change; empty
        if half the step cannot be taken."""
        run, scene = self.run, self.run.scene
        whole = [w for w in self.windows.values() if w.middle is not None and w.end is not None]
        if not whole or run.model is None or run.offline is None:
            return {}
        try:
            with np.errstate(all="ignore"):
                solver: StepSolver = scene.reducer.prepare(ReducedProblem(
                    run.model, scene.integrator, 0.5 * scene.time.step, run.offline,
                    np.random.default_rng(scene.seed)))
                if not _same_unknowns(solver, run.solver):
                    return {}
                pairs = [pair for w in whole if (pair := self._again(w, solver)) is not None]
        except (SolveFailed, InputError):
            return {}
        richardson, found = 1.0 - 0.5**scene.integrator.order, {}
        for b in self.blocks:
            change = max(self.changes[b.name], SMALLEST * b.size)
            if not pairs or self.changes[b.name] <= CONSTANT_CHANGE * b.norm(self.origin):
                continue
            middle, end = (sqrt(sum(b.norm(p[i]) ** 2 for p in pairs) / len(pairs))
                           for i in (0, 1))
            if not np.isfinite(middle + end) or end == 0.0:
                continue
            grows = 1.0 if middle == 0.0 else float(
                np.clip(np.log(end / middle) / np.log(self.length / self.half), 0.0, 1.0))
            found[b.name] = (
                end / (richardson * change) * (self.steps / self.length) ** grows)
        return found

    def _again(self, w: _Window, solver: StepSolver) -> tuple[FloatArray, FloatArray] | None:
        """Differences (n,) of the unknowns in the middle and at the end of a window that is taken
        again with half the step; None where that fails."""
        scene, layout = self.run.scene, solver.layout
        h, slope, x = 0.5 * scene.time.step, np.zeros(layout.size), []
        if w.before is not None:
            second, first = layout.second, layout.first
            slope[second] = (w.start.a - w.before.a)[second] / (2.0 * h)
            slope[first] = (w.start.v - w.before.v)[first] / (2.0 * h)
        _, memory = solver.start(self.run.start)
        if not isinstance(memory, Restarts):
            return None
        memory.moved(w.start.x)
        state = settled(scene.integrator, layout, w.start, slope, h)
        for taken in iterate(
                FixedStep.of(scene.integrator, solver, h), state, memory, 2 * self.length):
            if not taken.outcome.status.ok:
                return None
            x.append(taken.state.x)
        assert w.middle is not None and w.end is not None
        return x[2 * self.half - 1] - w.middle, x[-1] - w.end


def time_error_notes(found: Mapping[str, float], h: float, order: int) -> tuple[Note, ...]:
    """Note on the fields with a large time error. found: of `TimeError.estimated`; h: time step,
    s; order: of the integrator."""
    large = {n: e for n, e in found.items() if e > NOTED}
    if not large:
        return ()
    shown = ", ".join(
        f"{n} {'more than 100' if e > 1.0 else format(100.0 * e, '.2g')} %"
        for n, e in sorted(large.items(), key=lambda item: -item[1]))
    other = ", an integrator of order 2" if order == 1 else ""
    text = (f"the step of {h:g} s is long for this run: the time error, estimated by half the "
            f"step, is about {shown} of the largest change (noted above {100.0 * NOTED:g} %): take "
            f"a smaller time.step{other} or time.control")
    return (Note(text, TIME_ERROR) if max(large.values()) > WARNED
            else information(text, TIME_ERROR),)
