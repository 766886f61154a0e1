"""Error of recovering known states from sampled rows: the oblique projection of the sparse method,
whose amplification determines the error of a sampled model with accurate atoms."""

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Csr,
    FloatArray,
    IntArray,
    Note,
    OfflineProducts,
    SolveFailed,
    StepFactors,
)
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.reducers.errors_at_states import (
    LIMIT,
    STATES,
    StateError,
    error_at_states,
    largest_change,
)
from sparsemor.reducers.sparse.sampled_block import Sampled

SAMPLED_ROWS = "sampled_rows"
"""Kind of the note on inaccurate sampled rows."""
_SELECTED = 8
"""Largest number of recovered states with an individual support for each."""


def row_note(error: StateError, block: Sampled) -> Note | None:
    """Note on an inaccurate recovery of a block."""
    if not error.inaccurate:
        return None
    used = f"{block.budget} of {block.atoms}" if block.selects else f"{block.atoms}"
    return Note(
        f"the {len(block.B)} sampled rows of {block.name} do not determine its {used} "
        f"atoms well enough: test states are recovered with an error of {error.solved:.2g} of "
        f"their largest change (limit {LIMIT:g}; projected on all atoms {error.best:.2g}): take "
        "more rows, another basis or sampler, or residual: preconditioned", SAMPLED_ROWS)


def row_error(block: Sampled, states: FloatArray, D: Csr, slow: Csr) -> StateError | None:
    """Error of coefficients recovered from sampled rows of D x = f and of S x = f,

        c = (L P W S A)^-1 L P W S x        with L P W D A = 1 and L = left inverse of the rows,

    with atoms A, sampled rows W and preconditioner P, at states x (n, M), less the offset of the
    dictionary, whose forces f are exact. For S = D it is c = L P W D x.
    S = D gives the error of one step, S = `slow` that of the state to which many steps converge.
    None for constant states, or rows that do not determine the coefficients.
    """
    A, o = block.dictionary.atoms, block.dictionary.offset
    if not (change := largest_change(states)):
        return None
    x = states - o[:, None]
    c = least_squares_coefficients(A, x)
    best = float(np.linalg.norm(x - A @ c, axis=0).max())
    worst = 0.0
    # support (None: all atoms), states and their coefficients; of a selection each state alone
    cases: list[tuple[IntArray | None, FloatArray, FloatArray]] = [(None, x, c)]
    if block.selects:
        order = np.argsort(-np.abs(c), axis=0)[: block.budget]
        cases = [(np.sort(order[:, i]), x[:, [i]], c[:, [i]]) for i in range(x.shape[1])]
    for support, part, own in cases:
        try:
            inverse = block.left_inverse(support)
        except SolveFailed:
            return None
        atoms = A if support is None else A[:, support]
        # states less their projection: what the atoms represent is recovered exactly
        rest = part - atoms @ (own if support is None else own[support])
        for S in (D, slow):
            recovered = inverse @ _rows(block, S @ rest)
            if S is slow:  # for S = D this matrix is 1
                of_atoms = inverse @ _rows(block, S @ atoms)
                recovered = np.asarray(
                    np.linalg.lstsq(of_atoms, recovered, rcond=None)[0], dtype=np.float64)
            worst = max(worst, float(np.linalg.norm(rest - atoms @ recovered, axis=0).max()))
    return StateError(worst / change, best / change)


def checked_rows(
    model: AssembledModel, offline: OfflineProducts, block: Sampled, step: StepFactors
) -> StateError | None:
    """Recovery error of a block's sampled rows at the training snapshots, or at estimated states
    where there was no training run; cached. None where there are no states."""
    if offline.recording is None:
        return None
    data = model.block_data(block.name, step=step)
    span = max(offline.recording.end, step.h)  # duration, s
    # operator of slow changes: K, of heat K + C / span with the capacity C = `mass`
    slow = data.stiffness + data.mass / span if data.order == 1 else data.stiffness
    weight = np.zeros(0) if block.weight is None else block.weight
    return error_at_states(
        model, offline, data, step, kind="row_error", depends=(
            block.name, block.dictionary.atoms, block.dictionary.offset, block.B, weight,
            block.test.rows, block.test.left, block.budget, data.operator, slow),
        error=lambda states: row_error(block, states, data.operator, slow),
        # number of states: with a selection each has a support, and a left inverse, of its own
        most=_SELECTED if block.selects else STATES)


def _rows(block: Sampled, values: FloatArray) -> FloatArray:
    """Preconditioned sampled rows (m, j) of columns (n, j) of the block: P W times these."""
    seen = np.asarray(block.test(values))
    return seen if block.weight is None else np.asarray(block.weight @ seen)
