"""LASSO path by least-angle regression, with debiasing."""

import warnings

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import FloatArray, require
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import Penalised, weights
from sparsemor.plugins.sparse_solvers.supports import pruned


class LassoLars(LinearRecovery):
    """LASSO by least-angle regression (LARS): the solution path over all l1 penalties.

    min 1/2 |A x - b|^2 + penalty sum_j |x_j| / budget_j, with budget_j the largest number of active
    columns in the group of column j. With `penalty`, the solution at that point of the path is
    used. Without, each knot of the path is pruned to the budgets and debiased by least squares, as
    is the least-squares solution on all columns of its end; the one of least residual is used.
    Needs the extra `lars` (scikit-learn). Efron et al. 2004, doi 10.1214/009053604000000067;
    weights as in Liang et al. 2026, Eq. 25.
    """

    penalty: float | None = Field(default=None, gt=0.0, lt=1.0)
    """Penalty, as a share of the least one at which no column is active; left out: the path is cut
    by the budgets."""
    knots: int = Field(default=500, ge=1)
    """Largest number of knots of the path, at which a column enters or leaves."""

    @model_validator(mode="after")
    def _possible(self) -> "LassoLars":
        require("sklearn", "lars", "lasso_lars")
        return self

    @property
    def keeps_largest(self) -> bool:
        return self.penalty is None

    def recover(self, problem: Penalised) -> Recovered:
        """Coefficients x (k,): of the path's end at `penalty`, or the best that keep the
        budgets."""
        path = self._path(problem)
        if self.penalty is not None:
            return Recovered(path[:, -1])
        return Recovered(min(_candidates(problem, path), key=problem.left))

    def _path(self, problem: Penalised) -> FloatArray:
        """Solutions x (k, knots) along the path, from no active column on.

        scikit-learn has one penalty for all coefficients and gets columns A / weight and b of unit
        norm; its solutions are scaled back.
        """
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.linear_model import lars_path

        scale, b = 1.0 / weights(problem), problem.b / np.linalg.norm(problem.b)
        X = problem.A * scale
        top = float(np.abs(b @ X).max()) / b.size  # scikit-learn divides by the number of rows
        with warnings.catch_warnings():  # columns it drops as degenerate stay inactive
            warnings.simplefilter("ignore", ConvergenceWarning)
            path = lars_path(X, b, method="lasso", alpha_min=(self.penalty or 0.0) * top,
                             max_iter=self.knots)[2]
        size = float(np.linalg.norm(problem.b))
        return np.asarray(path * scale[:, None] * size)


def _candidates(problem: Penalised, path: FloatArray) -> list[FloatArray]:
    """Debiased solutions x (k,) within the budgets, one for each support along the path (k, knots)
    that has as many active columns as the largest of them."""
    kept = {k.tobytes(): k for k in (pruned(x, x != 0.0, problem.groups) for x in path.T)}
    most = max(int(k.sum()) for k in kept.values())
    nonzero_columns = np.linalg.norm(problem.A, axis=0) > 0.0
    # with rows for all columns the path ends on all of them; the Gram matrix that scikit-learn
    # works on cannot follow it there where columns are nearly parallel
    last = nonzero_columns if np.count_nonzero(nonzero_columns) <= problem.size else (
        path[:, -1] != 0.0)
    if np.count_nonzero(last) <= problem.size:
        wide = problem.least_squares(last)
        end = pruned(wide, last, problem.groups)
        kept[end.tobytes()] = end
    return [problem.least_squares(k) for k in kept.values() if int(k.sum()) >= most]
