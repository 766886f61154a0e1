"""Compressive sampling matching pursuit."""

import numpy as np
from pydantic import Field

from sparsemor.core import BoolArray, FloatArray, Status
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import Penalised
from sparsemor.plugins.sparse_solvers.supports import pruned


class Cosamp(LinearRecovery):
    """CoSaMP: joins the active columns with twice the budget of new ones, then keeps the largest.

    The budget is the largest number of active columns of a group. Sweeps end when the residual no
    longer falls; the best sweep is the result. If there are fewer rows than three times the
    budgets, fewer new columns join. Needell and Tropp 2009, Algorithm 1, doi
    10.1016/j.acha.2008.07.002.
    """

    sweeps: int = Field(default=50, ge=1)
    """Largest number of exchanges of columns in one linearisation; then the solve ends as not
    converged."""

    @property
    def keeps_largest(self) -> bool:
        return True

    def recover(self, problem: Penalised) -> Recovered:
        """Coefficients x (k,) of A x = b with at most `budget` nonzeros per group: those of the
        sweep with the smallest residual norm."""
        A, b, groups = problem.A, problem.b, problem.groups
        best, r = np.zeros(A.shape[1]), b
        least, enough = float(np.linalg.norm(b)), 1e-12 * float(np.linalg.norm(b))
        for _ in range(self.sweeps):
            merged = self._merged(problem, best != 0.0, np.abs(r @ A))
            wide = problem.least_squares(merged)
            # least squares again: the pruned x of Algorithm 1 leaves a residual that pruned
            # columns nearly parallel to kept ones make useless as a proxy
            x = problem.least_squares(pruned(wide, wide != 0.0, groups))
            r = b - A @ x
            norm = float(np.linalg.norm(r))
            if not norm < least:
                return Recovered(best)
            best, least = x, norm
            if norm <= enough:
                return Recovered(best)
        return Recovered(best, Status.NOT_CONVERGED)

    def _merged(self, problem: Penalised, active: BoolArray, proxy: FloatArray) -> BoolArray:
        """Mask of the active columns and those of largest correlation `proxy` (k,) with the
        residual, at most as many as there are rows."""
        merged = active.copy()
        # `size`: number of rows; share: part of twice the budget that the rows leave room for
        wanted = 2 * sum(g.budget or 0 for g in problem.groups)
        room = problem.size - int(np.count_nonzero(active))
        share = min(1.0, room / max(wanted, 1))
        for g in problem.groups:
            part = proxy[g.start : g.stop]
            new = np.argsort(-part, kind="stable")[: int(share * 2 * (g.budget or 0))]
            merged[g.start + new[part[new] > 0.0]] = True
        return merged
