"""Residual whose rows are sampled in each block: r, or D^-1 r with the operator D of a step."""

from sparsemor.core import AssembledModel, Note, information
from sparsemor.reducers.checks import local_blocks
from sparsemor.reducers.sparse.options import SparseOptions

PLAIN_ROWS = "plain_rows"
"""Kind of the note on blocks whose rows are those of r, although no option asks for them."""


def inverted_blocks(model: AssembledModel, options: SparseOptions) -> frozenset[str]:
    """Blocks whose sampled rows are those of D^-1 r: those for which the option `residual` asks for
    them, and by default those whose operators are constant in the run."""
    plain = set(model.reducible()) if _anew(options) else set(local_blocks(model))
    return frozenset(
        name for name in model.reducible() if options.residual_of(name) == "preconditioned"
        or options.residual_of(name) == "auto" and name not in plain)


def plain_rows(model: AssembledModel, options: SparseOptions) -> tuple[Note, ...]:
    """Note on blocks with plain rows that the default chose, and why."""
    names = [n for n in model.reducible() if options.residual_of(n) == "auto"]
    if _anew(options):
        blocks = {n: "rows are drawn anew during the run (reducer.resample), and each row of D^-1 "
                  "takes a solve with the whole operator: give reducer.row_sets" for n in names}
    else:
        local = local_blocks(model)
        blocks = {n: f"terms of {local[n]} are evaluated element by element, and a row of D^-1 r "
                  "would read every element in each step" for n in names if n in local}
    reasons: dict[str, list[str]] = {}
    for name, why in blocks.items():
        reasons.setdefault(why, []).append(name)
    return tuple(information(
        f"rows of the residual r are sampled in {', '.join(of)}, not of D^-1 r, which come nearer "
        f"to galerkin: {why}", PLAIN_ROWS) for why, of in reasons.items())


def _anew(options: SparseOptions) -> bool:
    """True if rows are drawn during the run, after the offline phase."""
    return options.resample is not None and options.row_sets is None
