"""Error of Galerkin solutions for known states: projection on the atoms in the inner product of the
step matrix.

The forces D x of a state x have the Galerkin solution A (A^T D A)^-1 A^T D x, with atoms A and the
matrix D of a time step. Its error is the least one in the norm of D, in which stiff deformations
count more than in the measure of errors: few atoms can represent the states and yet not be their
solution.
"""

from typing import NamedTuple

import numpy as np

from sparsemor.core import (
    CONSTANT_CHANGE,
    AssembledModel,
    BlockData,
    Csr,
    Dictionary,
    FloatArray,
    Note,
    OfflineProducts,
    StepFactors,
    least_squares_coefficients,
)
from sparsemor.reducers.projection.base import Projection
from sparsemor.reducers.states_to_test import states_to_test
from sparsemor.reducers.step.prepare import constants

GALERKIN_ERROR = "galerkin_error"
"""Kind of the note."""
LIMIT = 0.01
"""Largest relative error of the Galerkin solutions without a note."""
STATES, ENTRIES = 400, 2**22
"""Largest number of states, and of their entries in memory unless there are few states."""
FEWEST = 8
"""Smallest number of states to which they are limited."""


class GalerkinError(NamedTuple):
    """Largest errors at states of a block relative to their largest change. galerkin: of the
    Galerkin solutions for their forces; best: of their orthogonal projection on the atoms."""

    galerkin: float
    best: float

    def note(self, name: str, atoms: int) -> Note | None:
        """Note on an error above the limit that is more than twice the projection error."""
        if not self.galerkin > max(LIMIT, 2.0 * self.best):
            return None
        return Note(
            f"Galerkin projection on the {atoms} atoms of {name} has an error of "
            f"{self.galerkin:.2g} of its largest change at test states (limit {LIMIT:g}; projected "
            f"orthogonally {self.best:.2g}): take more atoms or another basis (reducer.basis, "
            "reducer.bases)", GALERKIN_ERROR)


def galerkin_error(
    dictionary: Dictionary, D: Csr, states: FloatArray
) -> GalerkinError | None:
    """Errors of the Galerkin solutions for states (n, M) with the step matrix D (n, n), symmetric
    positive definite; None for constant states."""
    A, x = dictionary.atoms, states - dictionary.offset[:, None]
    change = float(np.linalg.norm(states - states[:, :1], axis=0).max())
    if change <= CONSTANT_CHANGE * float(np.linalg.norm(states, axis=0).max()):
        return None
    W = D @ A
    rest = x - A @ least_squares_coefficients(A, x)
    best = float(np.linalg.norm(rest, axis=0).max())
    rest -= A @ np.linalg.lstsq(A.T @ W, W.T @ rest, rcond=None)[0]
    return GalerkinError(float(np.linalg.norm(rest, axis=0).max()) / change, best / change)


def galerkin_notes(made: Projection) -> tuple[Note, ...]:
    """Notes on the blocks of a projected model whose Galerkin solutions are inaccurate; the errors
    are cached."""
    problem, found = made.problem, []
    step = StepFactors(problem.step, *constants(problem.integrator, problem.step))
    for name, dictionary in made.dictionaries.items():
        if problem.offline.recording is None or not dictionary.atoms.shape[1]:
            continue
        data = problem.model.block_data(name, step=step)
        error = _remembered(problem.model, problem.offline, dictionary, data, step)
        note = None if error is None else error.note(name, dictionary.atoms.shape[1])
        found += [] if note is None else [note]
    return tuple(found)


def _remembered(
    model: AssembledModel, offline: OfflineProducts, dictionary: Dictionary, data: BlockData,
    step: StepFactors
) -> GalerkinError | None:
    assert offline.recording is not None
    end = max(offline.recording.end, step.h)

    def make() -> dict[str, FloatArray]:
        states = states_to_test(model, offline, data, step, end)
        if states is None:
            return {"error": np.zeros(0)}
        most = min(STATES, max(FEWEST, ENTRIES // data.size))
        at = np.unique(np.linspace(0, states.shape[1] - 1, most).astype(np.int64))
        error = galerkin_error(dictionary, data.operator, np.asarray(states[:, at]))
        return {"error": np.zeros(0) if error is None else np.array(error)}

    found = offline.remember("galerkin_error", (
        data.name, dictionary.atoms, dictionary.offset, data.operator, offline.trained, end),
        make)["error"]
    return GalerkinError(*found.tolist()) if len(found) else None
