"""Trial runs of reduced models, compared with the snapshots of the training run, and projection
errors of these snapshots."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core import (
    Dictionary,
    FloatArray,
    ReducedProblem,
    State,
    StepSolver,
)
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.reducer import TrialRun
from sparsemor.core.results.relative_error_estimates import CONSTANT_CHANGE
from sparsemor.core.simulation.time_stepping import FixedStep, started

LEAST = 1e-6
"""Largest change of a block in one of several training runs, relative to that in the others, up to
which the block counts as constant in it."""
LINEARIZED = 5
"""Number of states of a trial run about which its model is linearised."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainingReference:
    """Snapshots of the training runs by block, as states of equal distance in time. The last run
    is that of the trial runs.

    scales: block -> largest change in each run, or the largest norm of a block that is constant in
    all, 1 if that is 0; infinite in a run in which a block does not change that changes in others;
    constant: names of the constant blocks; count: number M of snapshots of a run; every: number of
    steps from one to the next; first: number of the first one of the last run that the bases have
    not learned.
    """

    problem: ReducedProblem
    scales: Mapping[str, FloatArray]
    constant: frozenset[str]
    count: int
    every: int
    first: int

    @classmethod
    def from_problem(cls, problem: ReducedProblem, learning: float) -> "TrainingReference":
        """Reference for bases that learn from the share `learning` of the snapshots."""
        model, taken = problem.model, problem.offline.recording
        count, scales, constant = 0, {}, set()
        for name in model.reducible():
            X = problem.offline.snapshots(name)
            runs = 1 if taken is None else taken.runs
            # with integrators of second order one snapshot is an additional one of the start
            count = X.shape[1] // runs - int(taken is not None and taken.integrator.order > 1)
            found = np.array([largest_change(x) for x in np.split(X, runs, axis=1)])
            changes, size = found[:, 0], found[:, 1].max()  # (runs,), and the largest norm
            if changes.max() <= CONSTANT_CHANGE * size:
                constant.add(name)
                changes = np.full(runs, size or 1.0)
            # infinite where one run changes nothing, so that no error of it counts
            scales[name] = np.where(changes > LEAST * changes.max(), changes, np.inf)
        every = 1 if taken is None else taken.every
        return cls(
            problem, scales, frozenset(constant), count, every, first=0).after(learning)

    @property
    def runs(self) -> int:
        """Number of training runs."""
        taken = self.problem.offline.recording
        return 1 if taken is None else taken.runs

    def after(self, learning: float) -> "TrainingReference":
        """The same for bases that learn from another share of the snapshots; of several runs, for
        bases that learn from all but the last."""
        first = min(max(2, round(learning * self.count)), max(self.count - 1, 1))
        return replace(self, first=first if self.runs == 1 else 0)

    @property
    def learned(self) -> float:
        """Share of the snapshots that the bases have learned."""
        return self.first / self.count if self.runs == 1 else 1.0 - 1.0 / self.runs

    def of_run(self, name: str, run: int) -> FloatArray:
        """Snapshots (n, M) of a block in one of the runs, -1 the last."""
        X = self.problem.offline.snapshots(name)
        start = run % self.runs * (X.shape[1] // self.runs)
        return X[:, start:start + self.count]

    def projection(self, name: str, d: Dictionary) -> FloatArray:
        """Largest projection error (k + 1,) of the states of a block on the first 0 to k atoms,
        relative to its largest change in the same run."""
        Q = np.linalg.qr(d.atoms)[0]
        worst = np.zeros(d.atoms.shape[1] + 1)
        for run, scale in enumerate(self.scales[name]):
            for _, part in column_chunks(self.of_run(name, run)):
                x = part - d.offset[:, None]
                size = np.sum(x * x, axis=0)
                # (k + 1, M): squared norms of what 0, 1, .. k orthonormal atoms leave
                left = np.vstack([size, size - np.cumsum((Q.T @ x) ** 2, axis=0)])
                np.maximum(worst, left.max(axis=1) / scale**2, out=worst)
        return np.sqrt(np.maximum(worst, 0.0))

    def run(
        self, method: str, solver: StepSolver, holdout: bool
    ) -> tuple[TrialRun, Sequence[State]]:
        """Trial run of a step solver from the start to the end of the training run, and a few of
        its states; none if it fails. holdout: True if its bases have learned the first part
        alone."""
        problem, layout = self.problem, solver.layout
        h, integrator = problem.step, problem.integrator
        assert isinstance(problem.model, Model)
        atoms = {n: d.atoms.shape[1] for n, d in solver.dictionaries.items()}
        # coefficients at the times of the snapshots, of which there is one each `every` steps, and
        # numbers of the states that are returned
        kept = {n: np.zeros((k, self.count)) for n, k in atoms.items()}
        ok, steps = True, (self.count - 1) * self.every
        due = {round(i * steps / (LINEARIZED - 1)) for i in range(LINEARIZED)}
        states: list[State] = []
        with np.errstate(all="ignore"):  # overflow ends in a status
            state, memory = started(
                solver, integrator, resolved_start(problem.model, integrator, h).state)
            step = FixedStep.of(integrator, solver, h)
            begun = time.process_time()
            for n in range(steps + 1):
                if n:
                    outcome, state, memory = step(state, memory)
                    ok = outcome.status.ok
                    if not ok:
                        break
                if n in due:
                    states.append(state)
                if n % self.every == 0:
                    for name, c in kept.items():
                        c[:, n // self.every] = state.x[layout[name]]
            ms = 1e3 * (time.process_time() - begun) / max(steps, 1)
        errors = {n: self._errors(n, d, kept[n]) if ok else np.full(self.count, np.inf)
                  for n, d in solver.dictionaries.items()}
        on_rest = {n: float(e[self.first:].max()) for n, e in errors.items()} if holdout else {}
        trial = TrialRun(
            method, atoms, {n: float(e.max()) for n, e in errors.items()}, on_rest, ms,
            sum(solver.elements_touched.values()))
        return trial, states if ok else ()

    def _errors(self, name: str, d: Dictionary, c: FloatArray) -> FloatArray:
        """Relative errors (M,) of coefficients c (k, M) of a block."""
        X = self.of_run(name, -1)
        found = np.zeros(self.count)
        for at, part in column_chunks(X):
            x = part - d.offset[:, None] - d.atoms @ c[:, at]
            found[at] = np.linalg.norm(x, axis=0)
        found /= self.scales[name][-1]
        return np.where(np.isfinite(found), found, np.inf)


def largest_change(X: FloatArray) -> tuple[float, float]:
    """Largest change of the columns of X (n, M) since the first one, and their largest norm."""
    change = size = 0.0
    start = X[:, :1]
    for _, part in column_chunks(X):
        change = max(change, float(np.linalg.norm(part - start, axis=0).max()))
        size = max(size, float(np.linalg.norm(part, axis=0).max()))
    return change, size
