"""Estimate of the error of a run's time step, by a few windows of steps that are taken again with
twice the step (Richardson; Hairer, Norsett, Wanner 1993, doi 10.1007/978-3-540-78862-1, II.4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from sparsemor.core import (
    BoolArray,
    Check,
    Findings,
    FloatArray,
    InputError,
    Note,
    OnStep,
    PreparedRun,
    Quantity,
    RunResult,
    SolveFailed,
    State,
    StepSolver,
    information,
)
from sparsemor.core.protocols.integrator import with_history
from sparsemor.core.results.relative_error_estimates import CONSTANT_CHANGE
from sparsemor.plugins.checks import place

TIME_ERROR = "time_error"
"""Kind of the note."""
NOTED, WARNED = 0.01, 0.05
"""Error, relative to the largest change of a field, above which a note, or a warning, says so."""
WINDOWS, DOUBLED, SHARE = 3, 5, 20
"""Number of windows, most doubled steps of one, and steps of a run for one doubled step of each."""
FASTEST = 1.25
"""Largest exponent of the growth of an error: between 1 (a steady drift) and 2 (a drift of the
speed), as measured for pendulums and four-bars."""
STEADY = 0.75
"""Exponent of the growth of an error of temperatures below which it spreads as fast as it grows, as
under a source that moves."""
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
TOGETHER = 64
"""Number of states that are looked at together."""


class TimeError(Check):
    """Error of the time step, estimated by a few windows of doubled steps."""

    order = place("time_error")
    _windows: "Windows | None" = None

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        self._windows = Windows.from_run(run, state.x if whole else None)
        return None if self._windows is None else self._windows.take

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        """Notes on large time errors, and all errors by block for the summary."""
        errors, first = ({}, {}) if self._windows is None else self._windows.estimated()
        scene = run.scene
        notes = time_error_notes(errors, first, scene.time.step, scene.integrator.order)
        if self._windows is not None and self._windows.refused:
            notes = (information(
                "the time error is not estimated: the equations of this reduced model hold for its "
                f"step of {scene.time.step:g} s alone; compare with a run of half the step",
                TIME_ERROR),)
        return Findings(notes, {"time_error": dict(errors)})


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """Steps that are taken again: states before and at the start, and the unknowns after each two
    steps."""

    before: State | None
    start: State
    taken: list[FloatArray] = field(default_factory=list)


def _rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return sqrt(sum(v * v for v in values) / len(values))


def _same_unknowns(one: StepSolver, other: StepSolver) -> bool:
    """True if both solve for the same unknowns: bases can depend on the step."""
    mine, theirs = one.dictionaries, other.dictionaries
    return one.layout.size == other.layout.size and mine.keys() == theirs.keys() and all(
        np.array_equal(d.atoms, theirs[n].atoms) for n, d in mine.items())


class Windows:
    """Windows of a run's steps with a fixed size, and the estimate of its time error from them.

    After W steps from the same state, solutions with 2h and h differ by e(W) (2^p - 1), with e the
    error that the W steps of h make and p the order. Each part of the run after the start has a
    window where the accelerations of its frames change most. It shows how e grows, e ~ W^g with
    g = log2(e(W) / e(W/2)) between 0 (errors die out, as in a damped vibration) and `FASTEST` (they
    add up, as in a free motion): that of the run is about e(W) r^g, with r the changes of the
    accelerations in the run over those in the window, at most its number of steps over W. Their
    root mean square over the windows is taken, relative to the largest change of the field.

    Displacements and temperatures grow as they do in the window of the smallest g, at most 1, as
    most of their errors fade; temperatures from `STEADY` on, and at most to the share of the
    changes in a window. Errors of a motion are mostly a delay, which joints and loads share: all
    frames and displacements have at least that of the largest delay. The window at the start shows
    what unresolved transients miss. refused: True if twice the step cannot be taken.
    """

    refused = False

    def __init__(self, run: PreparedRun, origin: FloatArray) -> None:
        """origin (n,): first unknowns of the run.

        length: W, steps of a window; free: last step at which one can begin; part: steps of each
        part of the run after the start; jerks, largest: change of the frames' accelerations in each
        step, and the largest in each part so far; found: window of each part and the number of
        steps before it, the first at the start of the run; frames, fading: blocks of poses and of
        temperatures; changes, rates: largest change and rate of each block in the run, from every
        `every`-th state, which wait in `next_states`; moving: rigid coordinates.
        """
        self.run, self.origin, self.steps = run, origin, run.steps
        windows = WINDOWS - (self.steps < 2 * FEWEST)  # a short run has room for one less
        self.length = 2 * min(DOUBLED, max(2, self.steps // SHARE))
        self.free = self.steps - self.length
        self.part = self.free / (windows - 1)
        self.jerks = [0.0]
        self.older: FloatArray | float = 0.0
        self.largest = [-1.0] * windows
        self.blocks = run.measured_blocks()
        known = run.solver.layout.differential
        self.frames = {b.name for b in known if b.kind.quantity is Quantity.POSE}
        self.fading = {b.name for b in known if b.kind.order == 1}
        self.found: list[tuple[int, _Window] | None] = [None] * windows
        self.changes = dict.fromkeys((b.name for b in self.blocks), 0.0)
        self.rates = dict(self.changes)
        self.every = max(1, self.steps // CHANGES)
        self.moving = run.solver.layout.frames
        self.next_states: list[State] = []

    @classmethod
    def from_run(cls, run: PreparedRun, start: FloatArray | None) -> "Windows | None":
        """The estimate of a run from its first unknowns, None where there is none: for steps of
        controlled error, runs without their model or resumed (`start` None), and where it would
        cost too much."""
        if (start is None or run.model is None or run.offline is None or not run.own_loads
                or run.scene.time.control is not None
                or len(start) > LARGEST or run.steps < FEWEST):
            return None
        return cls(run, start)

    def take(
        self, done: int, before: State, state: State, active: Mapping[str, BoolArray]
    ) -> None:
        """Looks at the step that ended at `state` after `done` steps, from the state `before`.

        A window begins at the start of the run, and in each later part at the step in which the
        frames' accelerations (`moving`) change most; of its steps every second state is kept.
        older: accelerations two steps before; jerks, largest: their changes in each step, and the
        largest in each part; part: its number of steps; free: last step at which a window of
        `length` steps can begin; found: steps before each window, and the window.
        """
        d = state.a[self.moving] - self.older  # over two steps: what alternates is no course
        self.older = before.a[self.moving]
        self.jerks.append(sqrt(d.dot(d)))
        if done == 1:
            self.found[0] = 0, _Window(None, before)
        part = 1 + int((done - 1) / self.part)
        if self.length < done <= self.free and self.jerks[-1] > self.largest[part]:
            self.largest[part] = self.jerks[-1]
            self.found[part] = done, _Window(before, state)
        for n, w in filter(None, self.found):
            if done - n in range(2, self.length + 1, 2):
                w.taken.append(state.x)
        if done % self.every == 0 or done == self.steps:
            self.next_states.append(state)
            if len(self.next_states) == TOGETHER or done == self.steps:
                self._count()

    def _count(self) -> None:
        """Takes the states seen into the largest changes and rates."""
        changes = np.stack([s.x for s in self.next_states]) - self.origin
        rates = np.stack([s.v for s in self.next_states])
        for b in self.blocks:
            self.changes[b.name] = max(self.changes[b.name], float(b.norms(changes).max()))
            self.rates[b.name] = max(self.rates[b.name], float(b.norms(rates).max()))
        self.next_states = []

    def estimated(self) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Block -> error of its field at the end of the run, and that of a transient at the start,
        both relative to the largest change; empty if twice the step cannot be taken."""
        run, scene = self.run, self.run.scene
        whole = {n: w for n, w in filter(None, self.found)
                 if 2 * len(w.taken) == self.length}
        if not whole:
            return {}, {}
        try:
            with np.errstate(all="ignore"):
                solver = run.solver_of(2.0 * scene.time.step)
                self.refused = not _same_unknowns(solver, run.solver)
                if self.refused:
                    return {}, {}
                again = {n: self._again(w, solver) for n, w in whole.items()}
        except (SolveFailed, InputError, LookupError):
            self.refused = True
            return {}, {}
        known = {n: differences for n, differences in again.items() if differences}
        # windows by the number of steps before them, of which that at the start is apart
        later = [n for n in known if n > 0] or [*known]
        scale = 2.0**scene.integrator.order - 1.0
        beyond = {n: self._beyond(n) for n in known}
        found, start, delays = dict[str, float](), dict[str, float](), [0.0]
        for b in self.blocks:
            change = max(self.changes[b.name], SMALLEST * b.size)
            if not known or self.changes[b.name] <= CONSTANT_CHANGE * b.norm(self.origin):
                continue
            errors = {n: [b.norm(d) / scale for d in ds] for n, ds in known.items()}
            ends = {n: e[-1] for n, e in errors.items()}
            grows = {n: _growth(e) for n, e in errors.items()}
            if b.name in self.frames:
                error = _rms([ends[n] * beyond[n] ** grows[n] for n in later])
            else:  # only what grows in every window grows in the run
                g = min(1.0, *(grows[n] for n in later))
                g = 0.0 if b.name in self.fading and g < STEADY else g
                error = _rms([ends[n] * beyond[n] ** g for n in later])
            if b.name in self.fading:  # at most the share of the changes in a window
                moved = _rms([b.norm(whole[n].taken[-1] - whole[n].start.x) for n in later])
                share = _rms([ends[n] for n in later]) * change / max(moved, SMALLEST * b.size)
                error = min(error, share)
            error = max(error, *(ends[n] for n in later))
            if not np.isfinite(error) or error == 0.0:
                continue
            found[b.name] = error / change
            if 0 in known and 0 not in later:
                start[b.name] = max(errors[0]) / change
            if b.name in self.frames and self.rates[b.name] > 0.0 and (
                    self.changes[b.name] > SMALLEST * b.size):
                delays.append(error / self.rates[b.name])
        # a delay of the motion shows in all frames and displacements, as the delay times their rate
        for b in self.blocks:
            if b.name in found and b.name not in self.fading:
                rate = self.rates[b.name] if b.name in self.frames else _rms(
                    [b.norm(whole[n].start.v) for n in later])
                change = max(self.changes[b.name], SMALLEST * b.size)
                found[b.name] = max(found[b.name], max(delays) * rate / change)
        return found, start

    def _beyond(self, n: int) -> float:
        """Steps of the run for each of the window that starts after n steps, weighted by the
        changes of the frames' accelerations."""
        here = sum(self.jerks[n + 1 : n + 1 + self.length])
        most = self.steps / self.length
        return min(most, max(1.0, sum(self.jerks) / here)) if here > 0.0 else most

    def _again(self, w: _Window, solver: StepSolver) -> list[FloatArray]:
        """Differences (n,) of the unknowns after each step of a window that is taken again with
        twice the step; none where that fails. slope: second rates at its start, from which the
        integrator's history for steps of 2h is made; memory: of the step solver, which can begin at
        another state (moved) where it `restarts`; w.taken: states of the run after these steps."""
        scene, layout = self.run.scene, solver.layout
        h, slope = 2.0 * scene.time.step, np.zeros(layout.size)
        if w.before is not None:  # over one step of the run, 0.5 h
            second, first = layout.second, layout.first
            slope[second] = (w.start.a - w.before.a)[second] / (0.5 * h)
            slope[first] = (w.start.v - w.before.v)[first] / (0.5 * h)
        _, memory = solver.start(self.run.start)
        if not memory.restarts:
            return []
        memory.moved(w.start.x)
        state = with_history(scene.integrator, layout, w.start, slope, h)
        states = self.run.advanced(solver, h, state, memory, self.length // 2)
        return [s.x - x for s, x in zip(states, w.taken, strict=True)] if (
            len(states) == len(w.taken)) else []


def _growth(errors: Sequence[float]) -> float:
    """Exponent of the growth of an error, from its values in a window."""
    half = len(errors) // 2
    middle, end = errors[half - 1], errors[-1]
    return 1.0 if middle == 0.0 or end == 0.0 else float(
        np.clip(np.log(end / middle) / np.log(len(errors) / half), 0.0, FASTEST))


def time_error_notes(
    found: Mapping[str, float], start: Mapping[str, float], h: float, order: int
) -> tuple[Note, ...]:
    """Notes on the fields with a large time error, in the run and at its start. found, start: block
    -> error relative to its largest change (`Windows.estimated`); h: time step, s; order: of the
    integrator."""
    other = ", an integrator of order 2" if order == 1 else ""
    cure = f"take a smaller time.step{other} or time.control"
    notes = []
    if any(e > NOTED for e in found.values()):
        text = (f"the step of {h:g} s is long for this run: the time error, estimated by twice the "
                f"step, is about {_shown(found)} of the largest change (noted above "
                f"{100.0 * NOTED:g} %): {cure}")
        notes.append((Note if max(found.values()) > WARNED else information)(text, TIME_ERROR))
    early = {n: e for n, e in start.items() if e > max(WARNED, 2.0 * found.get(n, 0.0))}
    if early:
        notes.append(information(
            f"the step of {h:g} s does not resolve how motion and temperatures begin: the first "
            f"steps have a time error of about {_shown(early)} of the largest change (noted above "
            f"{100.0 * WARNED:g} %); where that matters, {cure}, or let loads begin slowly",
            TIME_ERROR))
    return tuple(notes)


def _shown(errors: Mapping[str, float]) -> str:
    """Blocks and their errors above `NOTED`, in %, the largest first."""
    return ", ".join(
        f"{n} {'more than 100' if e > 1.0 else format(100.0 * e, '.2g')} %"
        for n, e in sorted(errors.items(), key=lambda item: -item[1]) if e > NOTED)
