"""Rejection of converged steps by terms that detect an invalid state, e.g. interpenetrated
surfaces."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from sparsemor.core import IntArray, ReducedTerm, Status, StepFormula, StepOutcome, Term

Checked = tuple[Term | ReducedTerm, IntArray]
"""A term that checks steps, with its columns."""


def checked(terms: Iterable[tuple[Term | ReducedTerm, IntArray]]) -> tuple[Checked, ...]:
    """The terms that can reject steps, each with the numbers of its unknowns."""
    return tuple((t, columns) for t, columns in terms if t.rejects)


def rejected_step(
    outcome: StepOutcome, terms: Sequence[Checked], step: StepFormula
) -> StepOutcome:
    """The outcome, or status "not converged" where a term rejects it: for example a surface has
    passed through another one, where no contact force acts."""
    if not (outcome.status.ok and terms):
        return outcome
    rates = outcome.rates or step.at(outcome.x - step.free)[1:]
    v = rates[0]
    for term, columns in terms:
        why = term.check_step(outcome.x[columns], v[columns], step.t, 1.0 / step.c1)
        if why:
            return replace(outcome, status=Status.NOT_CONVERGED, detail=why)
    return outcome
