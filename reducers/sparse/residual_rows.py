"""Residual whose rows are sampled in each block: r, or D^-1 r with the operator D of a step."""

from typing import Any, cast

from sparsemor.core import AssembledModel, Note, Reducer, Registry, Sampler, Term, information
from sparsemor.core.model.fitting_bases import fitted_bases
from sparsemor.reducers.block_counts import local_blocks
from sparsemor.reducers.reducer_notes import is_default
from sparsemor.reducers.sparse.sparse_options import SparseOptions

POINTS = "deim"
"""Sampler of blocks in which the default keeps plain rows. Of forces that the training run did not
contain, rows drawn by `lhs` made coefficients grow in every sixth random scene; these did not."""
PLAIN_ROWS = "plain_rows"
"""Kind of the note on blocks whose rows are those of r, although no option asks for them."""


def inverted_blocks(model: AssembledModel, options: SparseOptions) -> frozenset[str]:
    """Blocks whose sampled rows are those of D^-1 r: those for which the option `residual` asks for
    them, and by default those whose terms are constant or have element weights."""
    plain = set(model.reducible()) if _anew(options) else set(unweighed(model, options))
    return frozenset(
        name for name in model.reducible() if options.residual_of(name) == "preconditioned"
        or options.residual_of(name) == "auto" and name not in plain)


def unweighed(model: AssembledModel, options: SparseOptions) -> dict[str, str]:
    """Block -> reason why its local terms have no element weights, with {} for the names of these
    terms, for blocks with such terms. Terms between bodies need none: a contact visits the facets
    near it."""
    bases = fitted_bases(model, cast(Reducer, options)).bases.values()
    trained = any(basis.needs_snapshots for basis in bases)
    why = "" if trained else (
        "there is no training run from which element weights of {} could be learned")
    if options.resample is not None:
        why = "the element weights of {} are learned for one set of rows"
    return {name: why or "{} has no element weights" for name, terms in own_terms(model).items()
            if why or not all(term.weighs_elements for term in terms)}


def own_terms(model: AssembledModel) -> dict[str, tuple[Term, ...]]:
    """Block -> its terms that are evaluated element by element, without those between bodies."""
    heat = {b.thermal: tuple(b.local) for b in model.separated.heat}
    elastic = {m.elastic: tuple(o.term for o in m.operators.local)
               for m in model.separated.moving if m.operators is not None}
    return {name: terms for name, terms in (heat | elastic).items() if terms}


def samplers(model: AssembledModel, options: SparseOptions) -> dict[str, Sampler]:
    """Sampler of each block: the option `sampler`, or Q-DEIM where that has its default value and
    the option `residual` keeps plain rows by default."""
    found = dict.fromkeys(model.reducible(), options.sampler)
    if options.resample is None and is_default(options, "sampler"):
        plain = [n for n in unweighed(model, options) if options.residual_of(n) == "auto"]
        if plain:
            points: Any = Registry().get("sampler", POINTS)()
            found |= dict.fromkeys(plain, points)
    return found


def plain_rows(model: AssembledModel, options: SparseOptions) -> tuple[Note, ...]:
    """Notes on blocks with plain rows that the default chose, and why; one for each reason."""
    auto = [n for n in model.reducible() if options.residual_of(n) == "auto"]
    # whole: block -> why each row of D^-1 r would read all its elements
    local, drawn, anew = local_blocks(model), samplers(model, options), _anew(options)
    whole = unweighed(model, options)
    reasons: dict[str, list[str]] = {}
    for name in auto:
        if name not in whole and not anew:
            continue
        by = "" if drawn[name] == options.sampler else (
            ", chosen by deim (with residual: plain by the option sampler)")
        why = (f"a row of D^-1 r would read every element of {local[name]} in each step, because "
               f"{whole[name].format(local[name])}{by}") if name in whole else (
            "rows are drawn anew during the run (reducer.resample), and each row of D^-1 takes a "
            "solve with the whole operator: give reducer.row_sets")
        reasons.setdefault(why, []).append(name)
    return tuple(information(
        f"rows of the residual r are sampled in {', '.join(of)}, not of D^-1 r, which come nearer "
        f"to galerkin: {why}", PLAIN_ROWS) for why, of in reasons.items())


def _anew(options: SparseOptions) -> bool:
    """True if rows are drawn during the run, after the offline phase."""
    return options.resample is not None and options.row_sets is None
