"""Checks of the trial space of a reduced run: projection error of expected states before the run,
and stored states outside the range of the training after it.

Errors are those of `sparsemor compare`: |x - P x|(t) / max over t of |x - x(0)|, with P the
orthogonal projection on the atoms (basis vectors). No reduced run on these atoms can have a smaller
one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from sparsemor.core import (
    AssembledModel,
    BoolArray,
    Check,
    Dictionary,
    Fault,
    Findings,
    FloatArray,
    InputError,
    Note,
    OfflineProducts,
    PreparedRun,
    RunResult,
    SolveFailed,
    StepFactors,
    information,
)
from sparsemor.core.linalg.dense import orthonormal
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.model.expected_states import expected_states
from sparsemor.core.results.relative_error_estimates import CONSTANT_CHANGE, estimated_errors
from sparsemor.plugins.checks import place

TRIAL_SPACE, BEYOND = "trial_space", "beyond_training"
"""Identifiers of the two kinds of warnings."""
LIMIT = 0.01
"""Largest projection error without a warning."""
BEYOND_LIMIT = 0.05
"""Largest distance of a stored state from the range of training, relative to the field's largest
change in training, without a warning."""
NOTHING: Mapping[str, Mapping[str, object]] = {}
COVERED = 1e-3
"""Projection error of the states that the loads of the run make expect, or estimated error of the
run, up to which a state outside the range of training is no reason for a warning."""
FIRST = 3
"""Number of steps at full order whose states are projected: what a load that jumps at the start
excites, which estimates by static displacements do not contain."""
MARGIN = 0.02
"""Share of the field's largest change in training by which the range of each coordinate is
enlarged."""
_DEPENDENT = 1e-12
"""Relative size of a column's part orthogonal to earlier columns, up to which it is round-off."""
_TURNED = 600
"""Largest number of atoms for which coordinates are rotated to the principal axes of the
training."""
_PIECE = 2**22
"""Number of coefficients of stored states that are read at once."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialSpace:
    """Projection error of one block, and the range of its coordinates in training.

    error: largest projection error of the training snapshots, relative to `change`, their largest
    change (2-norm over the unknowns; 0 for a constant field); both 0 without training. run_error:
    the same of the states that the loads of the run itself make expect (`expected_states`),
    relative to the larger change of both; run_tested: False where no such states were projected.
    response: the static or impulse response to a load with
    the largest projection error, "" for none or with training, and response_error, that error
    (`ExpectedStates.responses`). trained: True if there was a training run.
    axes (r, k): orthonormal coordinates y = axes c, along the principal axes of the training, of
    coefficients c (k,) of the atoms; (0, k) where y = c; low, high (r,): range of y, both empty
    without training. superposed: True where every state under the loads of the scene, as any
    functions of time, is a superposition of states that training had.
    """

    name: str
    atoms: int
    error: float
    change: float
    run_error: float
    run_tested: bool
    response: str
    response_error: float
    trained: bool
    axes: FloatArray
    low: FloatArray
    high: FloatArray
    superposed: bool = False

    def note(self) -> Note | None:
        """Warning about the projection error of the atoms, None if it is below the limit: that of
        the training snapshots (`error`), of states that the loads of the run make expect
        (`run_error`), or of the response to one load (`response_error`)."""
        who = f"the {self.atoms} atoms of {self.name}"
        if self.error > LIMIT:
            what = f"{who} cannot represent the training run: projection error " \
                f"{self.error:.2g} of its largest change"
        elif self.run_error > LIMIT:
            what = f"{who} cannot represent what the loads of this run do (static displacements, " \
                f"heat in coarse time steps): projection error {self.run_error:.2g} of the " \
                "largest change"
            if self.trained:
                return Note(f"{what} (limit {LIMIT:g}), because the training run did not contain "
                            "it: train on loads that cover the run (training.overrides), or take "
                            "another basis (reducer.basis, reducer.bases)", TRIAL_SPACE)
        elif self.response_error > LIMIT:
            return Note(f"{who} cannot represent {self.response}: projection error "
                        f"{self.response_error:.2g} of the norm of the static response (limit "
                        f"{LIMIT:g}); if the run has such forces, it is no better: then take more "
                        "atoms or another basis (reducer.basis, reducer.bases)", TRIAL_SPACE)
        else:
            return None
        return Note(f"{what} (limit {LIMIT:g}), and the reduced run is no better: take more atoms "
                    "or another basis (reducer.basis, reducer.bases)", TRIAL_SPACE)

    def excess(self, c: FloatArray) -> FloatArray:
        """Distances (j,) of coefficients c (j, k) from the range of training, relative to the
        largest change in training."""
        y = c if not len(self.axes) else c @ self.axes.T
        spare = MARGIN * self.change
        out = np.maximum(self.low - spare - y, 0.0) + np.maximum(y - self.high - spare, 0.0)
        return np.asarray(np.linalg.norm(out, axis=1) / self.change)


class TrialSpaces(Check):
    """Projection error of expected states before a run, and states outside the range of training
    after it."""

    order = place("trial_space")
    stored_classes: ClassVar = (TrialSpace,)

    def before_steps(self, run: PreparedRun, again: PreparedRun | None) -> Findings:
        """Trial spaces of all reduced blocks, and warnings about projection errors above the limit;
        nothing where the scene skips the check. again: a run of the same training with other values
        of parameters, whose findings hold for equal atoms; superposed: states under any functions
        of time are sums of trained ones. Raises InputError (key `check_trial_space`), with all such
        errors, if the scene's option is `refuse`."""
        scene, bases = run.scene, run.solver.dictionaries
        if again is not None and _equal(again.header.dictionaries, bases):
            return Findings([n for n in again.notes if n.kind == TRIAL_SPACE],
                            kept={TRIAL_SPACE: again.kept.get(TRIAL_SPACE, ())},
                            changes=again.changes)
        if scene.check_trial_space == "off" or run.model is None or run.offline is None:
            return Findings()
        new = run.offline.trained and not run.in_training  # the run is not that of training
        spaces = trial_spaces(
            run.model, run.offline, bases, scene.time.step, scene.time.end, run.physics,
            partial(run.first_states, FIRST) if new else None, run.constant_change)
        if scene.training.loads == "varying" and not scene.unvaried_loads:
            spaces = tuple(replace(s, superposed=_constant(run.model, s.name)) for s in spaces)
        notes = [note for space in spaces if (note := space.note()) is not None]
        if notes and scene.check_trial_space == "refuse":
            raise InputError([Fault("check_trial_space", note.text) for note in notes])
        return Findings(notes, kept={TRIAL_SPACE: spaces},
                        changes={s.name: s.change for s in spaces})

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(general=beyond_training(
            run.kept.get(TRIAL_SPACE, ()), result, run.trained_to or 0.0, run.solver.facts,
            run.own_loads))


def _constant(model: AssembledModel, name: str) -> bool:
    """True if the equations of a block have constant operators, under loads that are functions of
    time."""
    separated = model.separated
    heat = {b.thermal: not b.local and not b.tables for b in separated.heat}
    moved = {m.elastic: m.operators is not None and not (
        m.operators.local or m.operators.generators or m.operators.tables) and heat.get(
            m.thermal, True) and not separated.border_size for m in separated.moving}
    return not separated.between and {**heat, **moved}.get(name, False)


def _equal(one: Mapping[str, Dictionary], other: Mapping[str, Dictionary]) -> bool:
    """True if the blocks of `one` have the same atoms in `other`."""
    return all(np.array_equal(d.atoms, other[n].atoms) for n, d in one.items())


def trial_spaces(
    model: AssembledModel, offline: OfflineProducts, dictionaries: Mapping[str, Dictionary],
    h: float, end: float, physics: str = "",
    first_steps: Callable[[], FloatArray] | None = None, least: float = CONSTANT_CHANGE,
) -> tuple[TrialSpace, ...]:
    """Trial spaces of all reduced blocks of a run with steps of h up to `end`, s.

    Projected are the training snapshots, if a basis of the run needs training, and, if the training
    was another run or none, estimates of the run by static and coarse transient solves, with
    `first_steps`, its first states (M, n) at full order (None where the training run contains the
    run). Results are cached; physics: digest of the scene that is run; least: relative change up to
    which a field counts as constant.
    """
    found = []
    steps = None if first_steps is None else cache(first_steps)
    for name, d in dictionaries.items():
        arrays = offline.remember(
            "trial_space", ("run", name, d.atoms, d.offset, offline.trained, physics),
            partial(_tested, model, offline, name, d, h, end, steps, least))
        found.append(TrialSpace(
            name, atoms=d.atoms.shape[1], error=float(arrays["error"]),
            change=float(arrays["change"]), run_error=float(arrays["run_error"]),
            run_tested=bool(arrays["run_tested"]), response=str(arrays["response"]),
            response_error=float(arrays["response_error"]), trained=offline.trained,
            axes=np.asarray(arrays["axes"]), low=np.asarray(arrays["low"]),
            high=np.asarray(arrays["high"])))
    return tuple(found)


def _tested(
    model: AssembledModel, offline: OfflineProducts, name: str, d: Dictionary, h: float, end: float,
    first_steps: Callable[[], FloatArray] | None, least: float,
) -> dict[str, NDArray[Any]]:
    """Projection errors of a block's atoms, and the range of its coordinates in training: the
    fields of `TrialSpace` by name, as they are cached. h, end: step and end of the run, s;
    first_steps: its first states at full order, None where they are not projected; least: relative
    change up to which a field counts as constant."""
    Q, R = _orthogonal(d.atoms)
    no_range, response, response_error = np.zeros(0), "", 0.0
    error = change = 0.0
    coordinates: FloatArray | None = None
    if offline.trained:
        states = offline.snapshots(name)
        counted = _of_the_run(offline, states.shape[1])
        error, change, coordinates = _projected(Q, d.offset, states, least, counted)
    expected_of_run = []
    try:
        if not offline.trained or first_steps is not None:
            expected = expected_states(model, name, StepFactors(h, 0.0, 0.0, 0.0), end)
            expected_of_run.append(expected.states)
            if not offline.trained:
                response, response_error = _worst(Q, expected.responses, expected.names)
        if first_steps is not None:
            expected_of_run.append(first_steps()[:, model.layout[name]].T)
    except SolveFailed:  # the run itself will say so
        pass
    run_error = 0.0
    for states in expected_of_run:
        its_error, its_change, _ = _projected(Q, d.offset, states, least)
        # relative to the larger change of these states and of the training
        scale = its_change / max(its_change, change) if its_change else 1.0
        run_error = max(run_error, scale * its_error)
    found = {"error": np.array(error), "change": np.array(change),
             "run_error": np.array(run_error), "run_tested": np.array(bool(expected_of_run)),
             "response": np.array(response),
             "response_error": np.array(response_error), "axes": np.zeros((0, R.shape[1])),
             "low": no_range, "high": no_range}
    if change == 0.0 or coordinates is None or not d.atoms.shape[1]:
        return found
    if len(coordinates) <= _TURNED:
        principal_axes = np.linalg.eigh(coordinates @ coordinates.T)[1].T
        found["axes"], coordinates = principal_axes @ R, principal_axes @ coordinates
    return found | {"low": coordinates.min(axis=1), "high": coordinates.max(axis=1)}


def _orthogonal(atoms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis Q (n, r) of the span of the atoms (n, k), and Q^T atoms (r, k)."""
    if orthonormal(atoms):
        return atoms, np.eye(atoms.shape[1])
    Q, R, _ = qr(atoms, mode="economic", pivoting=True)
    size = np.abs(np.diag(R))
    Q = np.ascontiguousarray(Q[:, :int(np.count_nonzero(size > _DEPENDENT * size[0]))])
    return Q, np.asarray(Q.T @ atoms)


def _of_the_run(offline: OfflineProducts, count: int) -> BoolArray:
    """Columns (count,) of the snapshots that are states of training runs: x + h^2 a of each start,
    the last one for integrators of an order above 1, can be metres away in a stiff body."""
    counted = np.ones(count, dtype=np.bool_)
    recording = offline.recording
    if recording is not None and recording.integrator.order > 1:
        each = count // recording.runs
        counted[each - 1::each] = False
    return counted


def _projected(
    Q: FloatArray, offset: FloatArray, states: FloatArray, least: float,
    counted: BoolArray | None = None,
) -> tuple[float, float, FloatArray]:
    """Largest projection error of states (n, M), the first of which is the initial state, relative
    to their largest change; that change, 0 for a constant field (a relative change of at most
    `least`); and the coordinates y = Q^T (x - offset), (r, M). counted (M,): True for columns that
    count, all by default."""
    n, r = Q.shape
    error = change = size = 0.0
    start, found = states[:, :1], [np.zeros((r, 0))]
    for columns, part in column_chunks(states):
        if counted is not None and not counted[columns].all():
            part = part[:, counted[columns]]
        if not part.size:
            continue
        x = part - offset[:, None]
        y = Q.T @ x
        found.append(y)
        if r < n:
            x -= Q @ y
            error = max(error, _longest(x))
        change, size = max(change, _longest(part - start)), max(size, _longest(part))
    coordinates = np.hstack(found)
    if change <= least * size:
        return (error / size if size else 0.0), 0.0, coordinates
    return error / change, change, coordinates


def _longest(columns: FloatArray) -> float:
    """Largest 2-norm of a column, without a copy of them."""
    return float(np.sqrt(np.einsum("ij,ij->j", columns, columns).max()))


def _worst(Q: FloatArray, responses: FloatArray, names: Sequence[str]) -> tuple[str, float]:
    """Name of the response, of responses (n, j), with the largest projection error, and that
    error."""
    left = np.linalg.norm(responses - Q @ (Q.T @ responses), axis=0)
    if not len(left):  # temperatures, or nothing moves
        return "", 0.0
    worst = int(left.argmax())
    return names[worst], float(left[worst])


def beyond_training(
    spaces: Sequence[TrialSpace], result: RunResult, trained_to: float,
    facts: Mapping[str, Mapping[str, object]] = NOTHING, own_loads: bool = True,
) -> dict[str, Note]:
    """Warnings about reduced blocks whose stored states left the range that they had in training,
    information where their estimated error is small.

    trained_to: end time of the training run, s; facts: of the step solver by block, whose `norm` of
    the residual says if solutions are as good as the atoms (`D^-1`); own_loads: False for loads
    other than those that the spaces were tested with. Coefficients are read in portions."""
    notes, times = dict[str, Note](), result.times
    end = float(times[-1]) if len(times) else 0.0
    estimates = estimated_errors(result)
    longer = end > trained_to * (1.0 + 1e-9)
    advice = (f"training ended at {trained_to:.4g} s, the run at {end:.4g} s: train longer "
              "(training.end)" if longer else
              "compare it with full order, or train on a run that covers this one "
              "(training.overrides)")
    for space in spaces:
        if not len(space.low) or space.change == 0.0 or not result.reduced(space.name):
            continue
        if space.superposed and not longer:
            continue
        near_best = facts.get(space.name, {}).get("norm") == "D^-1"
        if near_best and own_loads and space.run_tested and not longer and (
                space.run_error <= COVERED):
            continue
        piece = max(1, _PIECE // space.atoms)
        excess = np.concatenate([np.zeros(0)] + [
            space.excess(result.coefficients(space.name, slice(first, first + piece)))
            for first in range(0, len(times), piece)])
        left = np.flatnonzero(excess > BEYOND_LIMIT)
        if not len(left):
            continue
        text = (f"{space.name} left the range of its training in {len(left) / len(times):.0%} of "
                f"the stored steps, first at {times[left[0]]:.4g} s, by up to {excess.max():.2g} "
                f"of its largest change in training (limit {BEYOND_LIMIT:g})")
        estimate = estimates[space.name].max() if space.name in estimates else None
        if estimate is not None:
            text += f", with an estimated error of {estimate:.2g}"
        notes[space.name] = information(text, BEYOND) if (
            estimate is not None and estimate <= COVERED) else Note(f"{text}; {advice}", BEYOND)
    return notes
