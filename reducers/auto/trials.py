"""Trial runs of reduced models, compared with the snapshots of the training run, and projection
errors of these snapshots."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core import (
    Dictionary,
    FloatArray,
    NextStep,
    ReducedProblem,
    State,
    StepFormula,
    StepOutcome,
    StepSolver,
    next_time,
)
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols import TrialRun
from sparsemor.core.results.error_norms import CONSTANT_CHANGE

LINEARIZED = 5
"""Number of states of a trial run about which its model is linearised."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainingReference:
    """Snapshots of the training run by block, as states of equal distance in time.

    scales: block -> largest change, or the largest norm of a constant block, 1 if that is 0;
    constant: names of the constant blocks; count: number M of snapshots; every: number of steps
    from one to the next; first: number of the first one that the bases have not learned.
    """

    problem: ReducedProblem
    scales: Mapping[str, float]
    constant: frozenset[str]
    count: int
    every: int
    first: int

    @classmethod
    def of(cls, problem: ReducedProblem, learning: float) -> "TrainingReference":
        """Reference for bases that learn from the share `learning` of the snapshots."""
        model, taken = problem.model, problem.offline.recording
        count, scales, constant = 0, {}, set()
        for name in model.reducible():
            X = problem.offline.snapshots(name)
            count = X.shape[1] - int(taken is not None and taken.integrator.order > 1)
            change, size = largest_change(X)
            if change <= CONSTANT_CHANGE * size:
                constant.add(name)
                change = size
            scales[name] = change or 1.0
        every = 1 if taken is None else taken.every
        found = cls(problem, scales, frozenset(constant), count, every, 0)
        return found.after(learning)

    def after(self, learning: float) -> "TrainingReference":
        """The same for bases that learn from another share of the snapshots."""
        first = min(max(2, round(learning * self.count)), max(self.count - 1, 1))
        return replace(self, first=first)

    def projection(self, name: str, d: Dictionary) -> FloatArray:
        """Largest relative projection error (k + 1,) of the states of a block on the first 0 to k
        atoms."""
        Q = np.linalg.qr(d.atoms)[0]
        X = self.problem.offline.snapshots(name)[:, :self.count]
        worst = np.zeros(d.atoms.shape[1] + 1)
        for _, part in column_chunks(X):
            x = part - d.offset[:, None]
            left = np.sum(x * x, axis=0) - np.cumsum((Q.T @ x) ** 2, axis=0)
            worst[0] = max(worst[0], float(np.sum(x * x, axis=0).max()))
            np.maximum(worst[1:], left.max(axis=1), out=worst[1:])
        return np.sqrt(np.maximum(worst, 0.0)) / self.scales[name]

    def run(
        self, method: str, solver: StepSolver, holdout: bool
    ) -> tuple[TrialRun, Sequence[State]]:
        """Trial run of a step solver from the start to the end of the training run, and a few of
        its states; none if it fails. holdout: True if its bases have learned the first part
        alone."""
        problem, layout = self.problem, solver.layout
        h, rules = problem.step, problem.integrator.rules(problem.step)
        atoms = {n: d.atoms.shape[1] for n, d in solver.dictionaries.items()}
        kept = {n: np.zeros((k, self.count)) for n, k in atoms.items()}
        ok, steps = True, (self.count - 1) * self.every
        due = {round(i * steps / (LINEARIZED - 1)) for i in range(LINEARIZED)}
        states: list[State] = []
        with np.errstate(all="ignore"):  # overflow ends in a status
            state, memory = solver.start(consistent_state(problem.model))

            def solve(formula: StepFormula) -> StepOutcome:
                nonlocal memory
                outcome, memory = solver.solve(formula, memory)
                return outcome

            state = problem.integrator.start(layout, state)
            begun = time.process_time()
            for n in range(steps + 1):
                if n:
                    outcome, state = problem.integrator.advance(
                        solve, NextStep(rules, layout, state, h, next_time(state.t, h)))
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
        trial = TrialRun(
            method, atoms, {n: float(e.max()) for n, e in errors.items()},
            {n: float(e[self.first:].max()) for n, e in errors.items()} if holdout else {},
            ms, sum(solver.elements_touched.values()))
        return trial, states if ok else ()

    def _errors(self, name: str, d: Dictionary, c: FloatArray) -> FloatArray:
        """Relative errors (M,) of coefficients c (k, M) of a block."""
        X = self.problem.offline.snapshots(name)[:, :self.count]
        found = np.zeros(self.count)
        for at, part in column_chunks(X):
            x = part - d.offset[:, None] - d.atoms @ c[:, at]
            found[at] = np.linalg.norm(x, axis=0)
        found /= self.scales[name]
        return np.where(np.isfinite(found), found, np.inf)


def largest_change(X: FloatArray) -> tuple[float, float]:
    """Largest change of the columns of X (n, M) since the first one, and their largest norm."""
    change = size = 0.0
    start = X[:, :1]
    for _, part in column_chunks(X):
        change = max(change, float(np.linalg.norm(part - start, axis=0).max()))
        size = max(size, float(np.linalg.norm(part, axis=0).max()))
    return change, size
