"""Linearised time-step map of a coupled reduced model, which predicts instability."""

from sparsemor.core.simulation.linearization.check import (
    LIMIT,
    Judgement,
    Reference,
    check_run,
    judge,
    judge_along,
    judged,
)
from sparsemor.core.simulation.linearization.differences import StepMap, step_map
from sparsemor.core.simulation.linearization.spectrum import eigenvalues, excess, radius

__all__ = [
    "LIMIT", "Judgement", "Reference", "StepMap", "check_run", "eigenvalues", "excess", "judge",
    "judge_along", "judged", "radius", "step_map",
]
