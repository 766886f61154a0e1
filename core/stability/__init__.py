"""The coupled one-step map of a reduced model: will its run blow up?"""

from sparsemor.core.stability.check import (
    LIMIT,
    Judgement,
    Reference,
    check_run,
    judge,
    judge_along,
    judged,
)
from sparsemor.core.stability.differences import StepMap, step_map
from sparsemor.core.stability.spectrum import eigenvalues, excess, radius

__all__ = [
    "LIMIT", "Judgement", "Reference", "StepMap", "check_run", "eigenvalues", "excess", "judge",
    "judge_along", "judged", "radius", "step_map",
]
