"""Linear response of a solved step to its history terms, by the exact Jacobian.

With v = c1 x + r1 and a = c2 x + r2 a step solves R(x, v, a, t) = 0, so that
dx = -J^-1 (C dr1 + M dr2), with C = dR/dv, M = dR/da and J = dR/dx + c1 C + c2 M.
"""

import numpy as np

from sparsemor.core import FloatArray, StepFormula, rate_factors
from sparsemor.reducers.step.newton.equations import Equations
from sparsemor.reducers.step.newton.memory import NewtonMemory
from sparsemor.reducers.step.predictor import block_starts


def linear_response(equations: Equations, step: StepFormula, x: FloatArray) -> FloatArray:
    """Derivative (n, 2 n) of the solution x of a step by [r1; r2]; dense. Raises RuntimeError where
    the Jacobian is singular."""
    layout, t = equations.layout, step.t
    here = equations.of_run(NewtonMemory.of(x, 1, block_starts(layout), equations.buffers))
    c1, c2 = rate_factors(layout, step.c1, step.c2, step.c1_first)
    at = x, c1 * x + step.r1, c2 * x + step.r2, t
    zero, one = np.zeros(layout.size), np.ones(layout.size)
    K = here.jacobian(*at, zero, zero)
    C, M = here.jacobian(*at, one, zero) - K, here.jacobian(*at, zero, one) - K
    factor = here.factorize(here.jacobian(*at, c1, c2))
    return np.asarray(-factor.solve(np.hstack([C, M])))
