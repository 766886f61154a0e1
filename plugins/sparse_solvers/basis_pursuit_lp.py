"""Basis pursuit as a linear program."""

from typing import Literal

import numpy as np
from pydantic import Field
from scipy.optimize import linprog

from sparsemor.core import PROBLEM_FEATURES, FloatArray, Status
from sparsemor.plugins.sparse_solvers.newton import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import Penalised, weights

_STATUS = {0: Status.DONE, 2: Status.INFEASIBLE}
"""Status codes of scipy.optimize.linprog; 1 (limit) and 4 (numerical trouble) count as not
converged, 3 (unbounded) cannot occur."""


class BasisPursuitLp(LinearRecovery):
    """Basis pursuit: least weighted l1 norm that satisfies every row, a linear program (HiGHS).

    min sum_j |x_j| / budget_j subject to |A x - b| <= tolerance max|b| in each row, with budget_j
    the largest number of active columns in the group of column j: a linear program in x = p - n
    with p, n >= 0 and a bounded slack in each row. Columns without a penalty are first eliminated
    from the rows by an orthogonal transformation. Chen, Donoho and Saunders 2001, doi
    10.1137/S003614450037906X; weights as in Liang et al. 2026, Eq. 25.
    """

    tolerance: float = Field(default=1e-9, ge=0.0, lt=1.0)
    """Largest residual of a row, relative to the largest right-hand side. 0: the rows are equality
    constraints, and problems with more rows than columns are refused."""
    cut: float = Field(default=1e-11, ge=0.0, lt=1.0)
    """Share of the largest coefficient (scaled by column norms) at or below which a coefficient
    counts as zero."""
    method: Literal["highs", "highs-ds", "highs-ipm"] = "highs"
    """Method of scipy.optimize.linprog: HiGHS's own choice, its dual simplex, or its interior point
    method."""

    @property
    def capabilities(self) -> frozenset[str]:
        """Supported features of problems; more rows than columns need a tolerance above 0."""
        exact = {"overdetermined"} if self.tolerance == 0.0 else set()
        return frozenset(PROBLEM_FEATURES) - exact

    def recover(self, problem: Penalised) -> Recovered:
        """Coefficients x (k,) at a vertex: at most as many nonzeros as rows, within the accuracy of
        HiGHS."""
        size = float(np.abs(problem.b).max())
        A, b = problem.A, problem.b / size
        m, k = A.shape
        cost = np.concatenate((np.tile(weights(problem), 2), np.zeros(m)))
        # one bounded slack a row: half the rows of two inequalities, and up to twice as fast
        bounds = np.vstack((np.tile([0.0, np.inf], (2 * k, 1)),
                            np.tile([-self.tolerance, self.tolerance], (m, 1))))
        # 1e-10 is the least that HiGHS takes
        found = linprog(
            cost, A_eq=np.hstack((A, -A, np.eye(m))), b_eq=b, bounds=bounds, method=self.method,
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10})
        status = _STATUS.get(found.status, Status.NOT_CONVERGED)
        if not status.ok:
            return Recovered(np.zeros(k), status)
        p, n = np.split(np.asarray(found.x)[: 2 * k], 2)
        return Recovered(without_small(size * (p - n), self.cut))


def without_small(x: FloatArray, cut: float) -> FloatArray:
    """Coefficients x with zeros where they are at most `cut` times the largest one in magnitude."""
    return np.where(np.abs(x) > cut * np.abs(x).max(initial=0.0), x, 0.0)
