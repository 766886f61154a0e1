"""Error of projected solutions for known states: projection on the atoms in the inner product of
the step matrix D, or of its square.

The forces D x of a state x have the Galerkin solution A (A^T D A)^-1 A^T D x, with atoms A: the
least error in the norm of D. Their least-squares solution, of all rows of the residual, is
A (D A)^+ D x: the least error in the norm of D^2. In both, stiff deformations count more than in
the measure of errors, in the second much more: few atoms can represent the states and yet not be
their solution.
"""

from functools import partial

import numpy as np

from sparsemor.core import Csr, Dictionary, FloatArray, Note, StepFactors
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.reducers.errors_at_states import LIMIT, StateError, error_at_states, largest_change
from sparsemor.reducers.projection.projection_reducer import Projection

GALERKIN_ERROR = "galerkin_error"
"""Kind of the note."""


def projection_note(
    error: StateError, name: str, atoms: int, least_squares: bool = False
) -> Note | None:
    """Note on an inaccurate projection of a block, None for an accurate one. error: largest errors
    at known states relative to their largest change, `solved` of the projected equations, `best` of
    the orthogonal projection on the atoms; least_squares: as in `projected_error`."""
    if not error.inaccurate:
        return None
    method, advice = ("Least squares of the rows", "the norm of D^-1 (galerkin, or gnat with "
                      "norm: energy), ") if least_squares else ("Galerkin projection", "")
    return Note(
        f"{method} on the {atoms} atoms of {name} has an error of {error.solved:.2g} of its "
        f"largest change at test states (limit {LIMIT:g}; projected orthogonally "
        f"{error.best:.2g}): take {advice}more atoms or another basis (reducer.basis, "
        "reducer.bases)", GALERKIN_ERROR)


def projected_error(
    dictionary: Dictionary, D: Csr, states: FloatArray, least_squares: bool = False
) -> StateError | None:
    """Errors of the projected solutions for states x (n, M), measured from the offset, with the
    step matrix D (n, n), symmetric positive definite; relative to the largest change. None for
    constant states. Atoms A (n, k):

        x - A (A^T D A)^-1 A^T D x    Galerkin,    x - A (D A)^+ D x    least_squares, of all rows.
    """
    A, x = dictionary.atoms, states - dictionary.offset[:, None]
    if not (change := largest_change(states)):
        return None
    W = D @ A
    # what the atoms represent is solved exactly, so that the rest alone is projected
    rest = x - A @ least_squares_coefficients(A, x)
    best = float(np.linalg.norm(rest, axis=0).max())
    if least_squares:
        rest -= A @ least_squares_coefficients(W, D @ rest)
    else:
        rest -= A @ np.linalg.lstsq(A.T @ W, W.T @ rest, rcond=None)[0]
    return StateError(float(np.linalg.norm(rest, axis=0).max()) / change, best / change)


def projection_notes(projection: Projection, least_squares: bool = False) -> tuple[Note, ...]:
    """Notes on the blocks of a projected model whose projected solutions are inaccurate; the errors
    are cached."""
    problem, found = projection.problem, []
    step = StepFactors(problem.step, *problem.integrator.rules(problem.step).factors)
    for name, dictionary in projection.dictionaries.items():
        if not (k := dictionary.atoms.shape[1]):
            continue
        data = problem.model.block_data(name, step=step)
        error = error_at_states(
            problem.model, problem.offline, data, step, kind="galerkin_error",
            depends=(name, dictionary.atoms, dictionary.offset, data.operator, least_squares),
            error=partial(projected_error, dictionary, data.operator, least_squares=least_squares))
        note = None if error is None else projection_note(error, name, k, least_squares)
        found += [] if note is None else [note]
    return tuple(found)
