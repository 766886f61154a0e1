"""Residual whose rows are sampled in each block: r, or D^-1 r with the operator D of a step."""

from typing import Any

from sparsemor.core import AssembledModel, Note, Registry, Sampler, information
from sparsemor.reducers.checks import local_blocks
from sparsemor.reducers.notes import is_default
from sparsemor.reducers.sparse.options import SparseOptions

POINTS = "deim"
"""Sampler of blocks in which the default keeps plain rows. Of forces that the training run did not
contain, rows drawn by `lhs` made coefficients grow in every sixth random scene; these did not."""
PLAIN_ROWS = "plain_rows"
"""Kind of the note on blocks whose rows are those of r, although no option asks for them."""


def inverted_blocks(model: AssembledModel, options: SparseOptions) -> frozenset[str]:
    """Blocks whose sampled rows are those of D^-1 r: those for which the option `residual` asks for
    them, and by default those whose operators are constant in the run."""
    plain = set(model.reducible()) if _anew(options) else set(local_blocks(model))
    return frozenset(
        name for name in model.reducible() if options.residual_of(name) == "preconditioned"
        or options.residual_of(name) == "auto" and name not in plain)


def samplers(model: AssembledModel, options: SparseOptions) -> dict[str, Sampler]:
    """Sampler of each block: the option `sampler`, or Q-DEIM where that has its default value and
    the option `residual` keeps plain rows by default."""
    found = dict.fromkeys(model.reducible(), options.sampler)
    if options.resample is None and is_default(options, "sampler"):
        plain = [n for n in local_blocks(model) if options.residual_of(n) == "auto"]
        points: Any = Registry().get("sampler", POINTS)()
        found |= dict.fromkeys(plain, points)
    return found


def plain_rows(model: AssembledModel, options: SparseOptions) -> tuple[Note, ...]:
    """Notes on blocks with plain rows that the default chose, and why."""
    auto = [n for n in model.reducible() if options.residual_of(n) == "auto"]
    local, drawn, anew = local_blocks(model), samplers(model, options), _anew(options)
    reasons: dict[str, list[str]] = {}
    for name in auto:
        if name not in local and not anew:
            continue
        by = "" if drawn[name] == options.sampler else (
            ", chosen by deim (with residual: plain by the option sampler)")
        why = (f"terms of {local[name]} are evaluated element by element, and a row of D^-1 r "
               f"would read every element in each step{by}") if name in local else (
            "rows are drawn anew during the run (reducer.resample), and each row of D^-1 takes a "
            "solve with the whole operator: give reducer.row_sets")
        reasons.setdefault(why, []).append(name)
    return tuple(information(
        f"rows of the residual r are sampled in {', '.join(of)}, not of D^-1 r, which come nearer "
        f"to galerkin: {why}", PLAIN_ROWS) for why, of in reasons.items())


def _anew(options: SparseOptions) -> bool:
    """True if rows are drawn during the run, after the offline phase."""
    return options.resample is not None and options.row_sets is None
