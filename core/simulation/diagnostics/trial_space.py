"""Checks of the trial space of a reduced run: projection error of expected states before the run,
and stored states outside the range of the training after it.

Errors are those of `sparsemor compare`: |x - P x|(t) / max over t of |x - x(0)|, with P the
orthogonal projection on the atoms (basis vectors). No reduced run on these atoms can have a smaller
one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import qr

from sparsemor.core.arrays import Arrays, FloatArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.linalg.least_squares import orthonormal
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import Dictionary, StepFactors
from sparsemor.core.results.error_norms import CONSTANT_CHANGE
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.diagnostics.expected_states import expected_states
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.status import SolveFailed

TRIAL_SPACE, BEYOND = "trial_space", "beyond_training"
"""Identifiers of the two kinds of warnings."""
LIMIT = 0.01
"""Largest projection error without a warning."""
BEYOND_LIMIT = 0.05
"""Largest distance of a stored state from the range of training, relative to the field's largest
change in training, without a warning."""
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

    error: largest projection error of the expected states, relative to `change`, their largest
    change (2-norm over the unknowns; 0 for a constant field); response: the static or impulse
    response to a load with the largest projection error, "" for none, and response_error, that
    error (`ExpectedStates.responses`). trained: True if the expected states are training snapshots.
    axes (r, k): orthonormal coordinates y = axes c, along the principal axes of the training, of
    coefficients c (k,) of the atoms; (0, k) where y = c; low, high (r,): range of y, both empty
    without training.
    """

    name: str
    atoms: int
    error: float
    change: float
    response: str
    response_error: float
    trained: bool
    axes: FloatArray
    low: FloatArray
    high: FloatArray

    def note(self) -> Note | None:
        """Warning about the projection error of the atoms, None if it is below the limit."""
        who = f"the {self.atoms} atoms of {self.name}"
        if self.error > LIMIT:
            of = "the training run" if self.trained else "an estimate of the run (static " \
                "displacements, heat in coarse time steps)"
            what = f"{who} cannot represent {of}: projection error {self.error:.2g} of its " \
                "largest change"
        elif self.response_error > LIMIT:
            what = f"{who} cannot represent {self.response}: projection error " \
                f"{self.response_error:.2g} of the norm of the static response"
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


def trial_spaces(
    model: Model, offline: Offline, dictionaries: Mapping[str, Dictionary], h: float, end: float
) -> tuple[TrialSpace, ...]:
    """Trial spaces of all reduced blocks of a run with steps of h up to `end`, s.

    The expected states are the training snapshots if a basis of the run needs training, else
    estimates by static and coarse transient solves. Results are cached.
    """
    found = []
    for name, d in dictionaries.items():
        if not d.atoms.shape[1]:
            continue
        depends: tuple[object, ...] = ("responses", name, d.atoms, d.offset, offline.trained)
        if not offline.trained:
            depends = (*depends, h, end)
        arrays = offline.remember(
            "trial_space", depends, partial(_tested, model, offline, name, d, h, end))
        found.append(TrialSpace(
            name, d.atoms.shape[1], float(arrays["error"]), float(arrays["change"]),
            str(arrays["response"]), float(arrays["response_error"]), offline.trained,
            np.asarray(arrays["axes"]), np.asarray(arrays["low"]), np.asarray(arrays["high"])))
    return tuple(found)


def _tested(
    model: Model, offline: Offline, name: str, d: Dictionary, h: float, end: float
) -> Arrays:
    Q, R = _orthogonal(d.atoms)
    none = np.zeros(0)
    response, response_error = "", 0.0
    if offline.trained:
        states = offline.snapshots(name)
    else:
        try:
            expected = expected_states(model, name, StepFactors(h, 0.0, 0.0, 0.0), end)
        except SolveFailed:  # the run itself will say so
            return {"error": np.array(0.0), "change": np.array(0.0), "response": np.array(""),
                    "response_error": np.array(0.0), "axes": np.zeros((0, 0)), "low": none,
                    "high": none}
        states = expected.states
        response, response_error = _worst(Q, expected.responses, expected.names)
    error, change, gram = _projected(Q, d.offset, states)
    found = {"error": np.array(error), "change": np.array(change), "response": np.array(response),
             "response_error": np.array(response_error), "axes": np.zeros((0, R.shape[1])),
             "low": none, "high": none}
    if not offline.trained or change == 0.0:
        return found
    turn = np.eye(0)
    if len(gram):
        turn = np.linalg.eigh(gram)[1].T
        found["axes"] = turn @ R
    low, high = np.full(Q.shape[1], np.inf), np.full(Q.shape[1], -np.inf)
    for _, part in column_chunks(states):
        y = Q.T @ (part - d.offset[:, None])
        y = turn @ y if len(turn) else y
        low, high = np.minimum(low, y.min(axis=1)), np.maximum(high, y.max(axis=1))
    return found | {"low": low, "high": high}


def _orthogonal(atoms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis Q (n, r) of the span of the atoms (n, k), and Q^T atoms (r, k)."""
    if orthonormal(atoms):
        return atoms, np.eye(atoms.shape[1])
    Q, R, _ = qr(atoms, mode="economic", pivoting=True)
    size = np.abs(np.diag(R))
    Q = np.ascontiguousarray(Q[:, :int(np.count_nonzero(size > _DEPENDENT * size[0]))])
    return Q, np.asarray(Q.T @ atoms)


def _projected(
    Q: FloatArray, offset: FloatArray, states: FloatArray
) -> tuple[float, float, FloatArray]:
    """Largest projection error of states (n, M), the first of which is the initial state, relative
    to their largest change; that change, 0 for a constant field; and the sum of y y^T over the
    coordinates y = Q^T (x - offset), (0, 0) for more than `_TURNED` atoms."""
    n, r = Q.shape
    gram = np.zeros((r, r)) if r <= _TURNED else np.zeros((0, 0))
    error = change = size = 0.0
    start = states[:, :1]
    for _, part in column_chunks(states):
        x = part - offset[:, None]
        y = Q.T @ x
        if r < n:
            error = max(error, float(np.linalg.norm(x - Q @ y, axis=0).max()))
        change = max(change, float(np.linalg.norm(part - start, axis=0).max()))
        size = max(size, float(np.linalg.norm(part, axis=0).max()))
        if len(gram):
            gram += y @ y.T
    if change <= CONSTANT_CHANGE * size:
        return (error / size if size else 0.0), 0.0, gram
    return error / change, change, gram


def _worst(Q: FloatArray, responses: FloatArray, names: Sequence[str]) -> tuple[str, float]:
    """Name of the response, of responses (n, j), with the largest projection error, and that
    error."""
    left = np.linalg.norm(responses - Q @ (Q.T @ responses), axis=0)
    if not len(left):  # temperatures, or nothing moves
        return "", 0.0
    worst = int(left.argmax())
    return names[worst], float(left[worst])


def check_trial_spaces(
    scene: Scene, model: Model, offline: Offline, dictionaries: Mapping[str, Dictionary]
) -> tuple[tuple[TrialSpace, ...], tuple[Note, ...]]:
    """Trial spaces of all reduced blocks of a run, and warnings about projection errors above the
    limit; nothing where the scene skips the check.

    Raises InputError (key `check_trial_space`), with all such errors, if the scene's option is
    `refuse`.
    """
    if scene.check_trial_space == "off":
        return (), ()
    spaces = trial_spaces(model, offline, dictionaries, scene.time.step, scene.time.end)
    notes = tuple(note for space in spaces if (note := space.note()) is not None)
    if notes and scene.check_trial_space == "refuse":
        raise InputError([Fault("check_trial_space", note.text) for note in notes])
    return spaces, notes


def beyond_training(
    spaces: Iterable[TrialSpace], result: RunResult, trained_to: float
) -> tuple[Note, ...]:
    """Warnings about reduced blocks whose stored states left the range that they had in training;
    trained_to: end time of the training run, s. Coefficients are read in portions."""
    notes, times = [], result.times
    end = float(times[-1]) if len(times) else 0.0
    advice = (f"training ended at {trained_to:.4g} s, the run at {end:.4g} s: train longer "
              "(training.end)" if end > trained_to * (1.0 + 1e-9) else
              "its error is probably as large: train on a run that covers this one "
              "(training.overrides), or take more atoms, more rows or another basis")
    for space in spaces:
        if not len(space.low) or space.change == 0.0:
            continue
        piece = max(1, _PIECE // space.atoms)
        excess = np.concatenate([np.zeros(0)] + [
            space.excess(result.coefficients(space.name, slice(first, first + piece)))
            for first in range(0, len(times), piece)])
        left = np.flatnonzero(excess > BEYOND_LIMIT)
        if len(left):
            notes.append(Note(
                f"{space.name} left the range of its training in {len(left) / len(times):.0%} of "
                f"the stored steps, first at {times[left[0]]:.4g} s, by up to "
                f"{excess.max():.2g} of its largest change in training (limit "
                f"{BEYOND_LIMIT:g}); {advice}", BEYOND))
    return tuple(notes)
