"""Steps that converged and still are not to be trusted, because a term says so."""

from collections.abc import Iterable
from dataclasses import replace

from sparsemor.core import ChecksStep, IntArray, Layout, Status, StepFormula, StepOutcome
from sparsemor.core.model.equations import rate_factors


def rejected_step(
    outcome: StepOutcome, terms: Iterable[tuple[object, IntArray]], step: StepFormula,
    layout: Layout
) -> StepOutcome:
    """The outcome, or not converged where a term objects to it.

    terms: each with its columns. Those that check steps (`ChecksStep`) report, for example, a
    surface that passed through another one, where no force acts.
    """
    if not outcome.status.ok:
        return outcome
    v = None
    for term, columns in terms:
        if not isinstance(term, ChecksStep):
            continue
        if v is None:
            c1, _ = rate_factors(layout, step.c1, step.c2, step.c1_first)
            v = c1 * outcome.x + step.r1
        why = term.check_step(outcome.x[columns], v[columns], step.t, 1.0 / step.c1)
        if why:
            return replace(outcome, status=Status.NOT_CONVERGED, detail=why)
    return outcome
