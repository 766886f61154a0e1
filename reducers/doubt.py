"""Steps that converged and still are not to be trusted, because a term says so."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from sparsemor.core.arrays import IntArray
from sparsemor.core.equations import rate_factors
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import StepFormula, StepOutcome
from sparsemor.core.status import Status


def doubted(
    outcome: StepOutcome, terms: Iterable[tuple[Any, IntArray]], step: StepFormula, layout: Layout
) -> StepOutcome:
    """The outcome, or not converged where a term objects to it.

    terms: each with its columns; one may have a method `doubt(x, v, t, h)`, which says why the end
    of a step of about h (s) is not to be trusted, "" if it is: a surface that went through another
    one feels no force there.
    """
    if not outcome.status.ok:
        return outcome
    v = None
    for term, columns in terms:
        if not hasattr(term, "doubt"):
            continue
        if v is None:
            c1, _ = rate_factors(layout, step.c1, step.c2, step.c1_first)
            v = c1 * outcome.x + step.r1
        why = term.doubt(outcome.x[columns], v[columns], step.t, 1.0 / step.c1)
        if why:
            return replace(outcome, status=Status.NOT_CONVERGED, detail=why)
    return outcome
