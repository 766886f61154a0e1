"""Check of a run that selected atoms or sampled rows: residual of its states over all rows of the
full-order equations, against the smallest one with all atoms of the dictionary."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from pydantic import PrivateAttr
from scipy.sparse import coo_array

from sparsemor.core import (
    BoolArray,
    Check,
    Dictionary,
    Findings,
    FloatArray,
    Model,
    Note,
    OnStep,
    PreparedRun,
    RunResult,
    SolveFailed,
    State,
    StepFactors,
    information,
)
from sparsemor.core.model.equations import system_residual
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.core.results.relative_error_estimates import CONSTANT_CHANGE
from sparsemor.plugins.checks import place

SELECTED, SAMPLED_ROWS = "selected_atoms", "sampled_rows"
"""Kinds of the notes."""
STATES = 10
"""Number of states of the run that are checked."""
RATIO = 10.0
"""Ratio of the residual of the selected atoms to that of all atoms, above which a note says so."""
LIMIT = 1e-3
"""Displacement or temperature that this residual causes when it persists, relative to the largest
change of the field, above which the note is a warning."""
ROWS_LIMIT, ROWS_RATIO = 0.01, 3.0
"""The same error above which sampled rows have a warning where all atoms are used, and the ratio
above which they are the cause. Below it all rows would leave about as much: so are the atoms."""
ROUND_OFF = 1e-9
"""The same below which the residual is round-off."""
PURPOSE = "check of selected atoms"
"""That of its factorizations, in the summary."""
NO_ROWS: Mapping[str, int] = {}
MANY = 1000
"""Number of atoms above which a dictionary counts as complete: all its atoms leave no residual."""


class SelectedAtoms(Check):
    """Residual that selected atoms and sampled rows leave over all rows."""

    order = place("selected_atoms")
    _states: list[tuple[State, Mapping[str, BoolArray]]] = PrivateAttr(default_factory=list)

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        """Function that keeps the states to be checked, without those after `state` of a run that
        went back; None where nothing is checked, as in runs with other loads than the model's or
        controllers (not own_loads). active: masks of the selected atoms of each block."""
        times, sampled = times_of_check(run.steps), bool(run.solver.rows)
        self._states = states = [(s, of) for s, of in self._states if s.t <= state.t]

        def look(
            done: int, before: State, now: State, active: Mapping[str, BoolArray]
        ) -> None:
            if done in times and (active or sampled):
                states.append((run.full_order(now), dict(active)))

        return look if run.own_loads and run.model is not None else None

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        """Notes on the kept states; blocks whose sampled rows are the cause explain other notes."""
        if run.model is None or not run.own_loads or not self._states:
            return Findings()
        h, solver = run.scene.time.step, run.solver
        found = check_selection(
            run.model, solver.dictionaries, StepFactors(
                h, *run.scene.integrator.rules(h).factors),
            self._states, {n: len(rows) for n, rows in solver.rows.items()})
        return Findings([note for s in found if (note := s.note()) is not None],
                        explained=frozenset(s.block for s in found if s.by_rows))


def times_of_check(steps: int) -> frozenset[int]:
    """Numbers of the steps whose states are checked, spread over a run of `steps` steps."""
    return frozenset(round(steps * (i + 1) / STATES) for i in range(STATES)) - {0}


@dataclass(frozen=True, slots=True)
class Selected:
    """Residual of selected atoms, or of sampled rows, in one block, at the state where it causes
    the largest error. t: time, s; active, atoms, rows: number of active atoms, of all, and of
    sampled rows; ratio: of the two
    residuals, in the energy norm (r^T D^-1 r)^(1/2) with the operator D of a step, infinite for a
    complete dictionary; error: part of the field that the residual in excess causes if it persists,
    relative to the largest change."""

    block: str
    t: float
    active: int
    atoms: int
    rows: int
    ratio: float
    error: float

    def note(self) -> Note | None:
        """A warning where the residual causes an error above the limit, otherwise information;
        None where all atoms would leave about as much. All atoms of a complete dictionary leave
        nothing, so that its ratio, infinite, says nothing. ratio: of the residual to that of all
        atoms; error: caused by it, relative to the largest change of the field."""
        if self.active == self.atoms:
            return self._of_rows()
        wrong, complete = self.error > LIMIT, not self.ratio < np.inf
        if not (wrong if complete else self.ratio > RATIO and self.error > ROUND_OFF):
            return None
        against = "" if complete else (
            f" {self.ratio:.2g} times that of all atoms (limit {RATIO:g})")
        text = (f"the {self.active} of {self.atoms} atoms selected in {self.block} leave a "
                f"residual over all rows{against} at {self.t:.4g} s, which causes an error of "
                f"{self.error:.2g} of the largest change where it persists: ")
        if wrong:
            return Note(text + "take more atoms (reducer.budgets), reducer.residual: "
                        "preconditioned, or another reducer.solver", SELECTED)
        return information(text + "all atoms are more accurate, and may be faster", SELECTED)

    @property
    def by_rows(self) -> bool:
        """True where sampled rows are the cause of an error above the limit, with all atoms."""
        return (self.active == self.atoms and self.error > ROWS_LIMIT
                and self.ratio > ROWS_RATIO)

    def _of_rows(self) -> Note | None:
        """Warning where the sampled rows leave a larger error than all rows would."""
        if not self.error > ROWS_LIMIT:
            return None
        cause = "the rows are the cause, not the training; take" if self.by_rows else (
            "the atoms leave as much, so that all rows help in part: train on loads that cover the "
            "run (training.overrides) or take another basis, and")
        return Note(
            f"the {self.rows} sampled rows of {self.block} leave a residual over all rows "
            f"{self.ratio:.2g} times that of its {self.atoms} atoms at {self.t:.4g} s, which "
            f"causes an error of {self.error:.2g} of the largest change where it persists (limit "
            f"{ROWS_LIMIT:g}): {cause} a reducer that tests all rows, such as galerkin",
            SAMPLED_ROWS)


def check_selection(
    model: Model, dictionaries: Mapping[str, Dictionary], step: StepFactors,
    states: Sequence[tuple[State, Mapping[str, BoolArray]]], rows: Mapping[str, int] = NO_ROWS,
) -> tuple[Selected, ...]:
    """Residuals of blocks whose selected atoms or sampled rows leave more than all atoms and rows
    would. states: full-order states of the run with the supports of their blocks; rows: number of
    sampled rows by block.

    With the operator D of a step and atoms X, all atoms and rows would leave the least residual
    r - D X (X^T D X)^-1 X^T r of a residual r. Compared are the energy norms sqrt(r^T D^-1 r) of
    both. The error is |S^-1 (r - least)|, S: stiffness; of temperatures conductivity, with the
    capacity over the time of the run. Left out are blocks whose operators cannot be factorized, and
    temperatures with c(T), whose residual is a difference of heat content over the step."""
    found: dict[str, Selected] = {}
    start, residuals = model.x0, dict[float, FloatArray]()
    change = {n: max((_norm(s.x[model.layout[n]] - start[model.layout[n]]) for s, _ in states),
                     default=0.0) for n in dictionaries}
    for name, d in dictionaries.items():
        k, at = d.atoms.shape[1], model.layout[name]
        tested = [(s, int(np.count_nonzero(on))) for s, of in states
                if not (on := _support(of, name, k)).all() or name in rows]
        if not tested or change[name] <= CONSTANT_CHANGE * _norm(tested[-1][0].x[at]) or (
                _stores_by_temperature(model, name, [s for s, _ in tested])):
            continue
        for s, _ in tested:
            if s.t not in residuals:  # all blocks have the same states
                residuals[s.t] = system_residual(model.layout, model.terms, s.x, s.v, s.a, s.t)
        data = model.block_data(name, step=step)
        span = max(states[-1][0].t, step.h)
        try:
            D = model.once((SELECTED, name, step), partial(
                model.factorize, name, data.operator, PURPOSE))
            S = model.factorize(name, data.stiffness + data.mass / span, PURPOSE) if (
                data.order == 1) else model.once((SELECTED, name), partial(
                    model.factorize, name, data.stiffness, PURPOSE))
            image = data.operator @ d.atoms if k < min(data.size, MANY) else None
            left = np.stack([residuals[s.t][at] for s, _ in tested], axis=1)  # (n, states)
            least = np.zeros(left.shape) if image is None else left - image @ np.linalg.lstsq(
                d.atoms.T @ image, d.atoms.T @ left, rcond=None)[0]
            of_left, of_least = (np.maximum((r * solve_or_fail(D, r, name)).sum(axis=0), 0.0)
                                 for r in (left, least))  # squares of the energy norms
            errors = np.linalg.norm(solve_or_fail(S, left - least, name), axis=0) / change[name]
        except SolveFailed:
            continue
        i = int(np.argmax(errors))
        ratio = float(np.sqrt(of_left[i] / of_least[i])) if of_least[i] > 0.0 else np.inf
        found[name] = Selected(name, t=tested[i][0].t, active=tested[i][1], atoms=k,
                               rows=rows.get(name, 0), ratio=ratio, error=float(errors[i]))
    return tuple(found.values())


def _support(supports: Mapping[str, BoolArray], name: str, atoms: int) -> BoolArray:
    """Active atoms (k,) of a block; all where none are selected."""
    found = supports.get(name)
    return found if found is not None and len(found) == atoms else np.ones(atoms, dtype=np.bool_)


def _stores_by_temperature(model: Model, name: str, states: Sequence[State]) -> bool:
    """True for a temperature block whose heat capacity at these states is not the constant one."""
    for term in (t for heat in model.separated.heat if heat.thermal == name for t in heat.local):
        none = np.zeros(len(term.columns))
        for x in (s.x[term.columns] for s in states):
            still, moving = (coo_array(term.jacobian(x, none, none, 0.0, none + c, none))
                             for c in (0.0, 1.0))
            if (still.tocsr() != moving.tocsr()).nnz:
                return True
    return False


def _norm(x: FloatArray) -> float:
    return float(np.linalg.norm(x))
