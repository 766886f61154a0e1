"""Error of projected solutions for known states: projection on the atoms in the inner product of
the step matrix D, or of its square.

The forces D x of a state x have the Galerkin solution A (A^T D A)^-1 A^T D x, with atoms A: the
least error in the norm of D. Their least-squares solution, of all rows of the residual, is
A (D A)^+ D x: the least error in the norm of D^2. In both, stiff deformations count more than in
the measure of errors, in the second much more: few atoms can represent the states and yet not be
their solution.
"""

from typing import NamedTuple

import numpy as np

from sparsemor.core import (
    AssembledModel,
    BlockData,
    Csr,
    Dictionary,
    FloatArray,
    Note,
    OfflineProducts,
    StepFactors,
)
from sparsemor.core.linalg.least_squares import least_squares_coefficients
from sparsemor.core.results.error_norms import CONSTANT_CHANGE
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


class ProjectedError(NamedTuple):
    """Largest errors at states of a block relative to their largest change. solved: of the
    projected solutions for their forces; best: of their orthogonal projection on the atoms."""

    solved: float
    best: float

    def note(self, name: str, atoms: int, least_squares: bool = False) -> Note | None:
        """Note on an error above the limit that is more than twice the projection error."""
        if not self.solved > max(LIMIT, 2.0 * self.best):
            return None
        method, advice = ("Least squares of the rows", "the norm of D^-1 (galerkin, or gnat with "
                          "norm: energy), ") if least_squares else ("Galerkin projection", "")
        return Note(
            f"{method} on the {atoms} atoms of {name} has an error of {self.solved:.2g} of its "
            f"largest change at test states (limit {LIMIT:g}; projected orthogonally "
            f"{self.best:.2g}): take {advice}more atoms or another basis (reducer.basis, "
            "reducer.bases)", GALERKIN_ERROR)


def projected_error(
    dictionary: Dictionary, D: Csr, states: FloatArray, least_squares: bool = False
) -> ProjectedError | None:
    """Errors of the projected solutions for states (n, M) with the step matrix D (n, n), symmetric
    positive definite; None for constant states."""
    A, x = dictionary.atoms, states - dictionary.offset[:, None]
    change = float(np.linalg.norm(states - states[:, :1], axis=0).max())
    if change <= CONSTANT_CHANGE * float(np.linalg.norm(states, axis=0).max()):
        return None
    W = D @ A
    rest = x - A @ least_squares_coefficients(A, x)
    best = float(np.linalg.norm(rest, axis=0).max())
    if least_squares:
        rest -= A @ least_squares_coefficients(W, D @ rest)
    else:
        rest -= A @ np.linalg.lstsq(A.T @ W, W.T @ rest, rcond=None)[0]
    return ProjectedError(float(np.linalg.norm(rest, axis=0).max()) / change, best / change)


def projection_notes(projection: Projection, least_squares: bool = False) -> tuple[Note, ...]:
    """Notes on the blocks of a projected model whose projected solutions are inaccurate; the errors
    are cached."""
    problem, found = projection.problem, []
    step = StepFactors(problem.step, *constants(problem.integrator, problem.step))
    for name, dictionary in projection.dictionaries.items():
        if problem.offline.recording is None or not dictionary.atoms.shape[1]:
            continue
        data = problem.model.block_data(name, step=step)
        error = _remembered(problem.model, problem.offline, dictionary, data, step, least_squares)
        note = None if error is None else error.note(name, dictionary.atoms.shape[1], least_squares)
        found += [] if note is None else [note]
    return tuple(found)


def _remembered(
    model: AssembledModel, offline: OfflineProducts, dictionary: Dictionary, data: BlockData,
    step: StepFactors, least_squares: bool
) -> ProjectedError | None:
    """The error at some of the states to test, cached."""
    assert offline.recording is not None
    end = max(offline.recording.end, step.h)

    def make() -> dict[str, FloatArray]:
        states = states_to_test(model, offline, data, step, end)
        if states is None:
            return {"error": np.zeros(0)}
        most = min(STATES, max(FEWEST, ENTRIES // data.size))
        at = np.unique(np.linspace(0, states.shape[1] - 1, most).astype(np.int64))
        error = projected_error(dictionary, data.operator, np.asarray(states[:, at]), least_squares)
        return {"error": np.zeros(0) if error is None else np.array(error)}

    found = offline.remember("galerkin_error", (
        data.name, dictionary.atoms, dictionary.offset, data.operator, offline.trained, end,
        least_squares),
        make)["error"]
    return ProjectedError(*found.tolist()) if len(found) else None
