"""Basis pursuit: by convex optimisation, and as a linear program."""

import warnings
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator
from scipy.optimize import linprog

from sparsemor.core import PROBLEM_FEATURES, FloatArray, InputError, Status, require
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import Penalised, weights

CONIC = "CLARABEL"


class BasisPursuit(LinearRecovery):
    """Basis pursuit denoising: least weighted l1 norm with bounded residual, solved by cvxpy.

    min sum_j |x_j| / budget_j subject to norm(A x - b) <= tolerance norm(b), with budget_j the
    largest number of active columns in the group of column j. Columns without a penalty are first
    eliminated from the rows by an orthogonal transformation. Needs the extra `cvx`. Chen, Donoho
    and Saunders 2001, doi 10.1137/S003614450037906X; with a tolerance Candes, Romberg and Tao 2006,
    doi 10.1002/cpa.20124; weights as in Liang et al. 2026, Eq. 25.
    """

    tolerance: float = Field(default=1e-8, ge=0.0, lt=1.0)
    """Largest residual in `norm`, relative to the right-hand side. 0: the rows are equality
    constraints, and problems with more rows than columns are refused."""
    norm: Literal["two", "largest"] = "two"
    """Norm of the residual: Euclidean (a cone program), or the largest row (a linear program)."""
    solver: str = CONIC
    """Solver of cvxpy, such as CLARABEL, SCS, OSQP, HIGHS. OSQP and HIGHS take no cone constraints:
    with them choose `norm: largest`, or `tolerance: 0`."""
    cut: float = Field(default=1e-9, ge=0.0, lt=1.0)
    """Share of the largest coefficient (scaled by column norms) at or below which a coefficient
    counts as zero: interior-point solutions are near zero, not at it. Coefficients above it are
    fitted again by least squares."""

    @field_validator("solver")
    @classmethod
    def _installed(cls, solver: str) -> str:
        require("cvxpy", "cvx", "basis_pursuit")
        known = _cvxpy().installed_solvers()
        if solver not in known:
            raise InputError(f"cvxpy has no solver {solver} here; it has {', '.join(known)}")
        return solver

    @model_validator(mode="after")
    def _possible(self) -> "BasisPursuit":
        require("cvxpy", "cvx", "basis_pursuit")
        if self.solver in {"HIGHS", "OSQP", "SCIPY", "GLPK"} and self.tolerance > 0.0 and (
                self.norm == "two"):
            raise InputError(
                f"{self.solver} takes no cone: choose norm: largest, or tolerance: 0", "norm")
        return self

    @property
    def capabilities(self) -> frozenset[str]:
        """Supported features of problems; more rows than columns need a tolerance above 0."""
        exact = {"overdetermined"} if self.tolerance == 0.0 else set()
        return frozenset(PROBLEM_FEATURES) - exact

    def recover(self, problem: Penalised) -> Recovered:
        """Coefficients x (k,), zero where the solution is at or below `cut` times its largest one.

        Solved for a right-hand side b of unit norm; x is scaled back. weights (k,): 1 / budget of
        each column's group.
        """
        cp = _cvxpy()
        order = 2 if self.norm == "two" else np.inf
        size = float(np.linalg.norm(problem.b, order))
        x = cp.Variable(problem.A.shape[1])
        misfit = problem.A @ x - problem.b / size
        rule = misfit == 0 if self.tolerance == 0.0 else cp.norm(misfit, order) <= self.tolerance
        program = cp.Problem(cp.Minimize(cp.norm1(cp.multiply(weights(problem), x))), [rule])
        try:
            with warnings.catch_warnings():  # of an inexact end: see _STATUS
                warnings.simplefilter("ignore")
                program.solve(solver=self.solver)
        except cp.error.SolverError:
            return Recovered(np.zeros(x.size), Status.NOT_CONVERGED)
        status = _STATUS.get(program.status, Status.NOT_CONVERGED)
        if not status.ok:
            return Recovered(np.zeros(x.size), status)
        return Recovered(without_small(size * np.asarray(x.value), self.cut))


_STATUS = {"optimal": Status.DONE, "optimal_inaccurate": Status.DONE,
           "infeasible": Status.INFEASIBLE, "infeasible_inaccurate": Status.INFEASIBLE,
           "infeasible_or_unbounded": Status.INFEASIBLE}
"""Statuses of cvxpy. `optimal_inaccurate`, which some solvers always return and others where
columns are nearly parallel, is accepted, because only the support is used. Iteration limits count
as not converged."""


def _cvxpy() -> Any:
    """Module cvxpy, imported on first use because its import takes a second."""
    import cvxpy

    return cvxpy


_LINPROG = {0: Status.DONE, 2: Status.INFEASIBLE}
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
        # variables: p (k), n (k), slack (m)
        cost = np.concatenate((np.tile(weights(problem), 2), np.zeros(m)))
        # one bounded slack a row: half the rows of two inequalities, and up to twice as fast
        bounds = np.vstack((np.tile([0.0, np.inf], (2 * k, 1)),
                            np.tile([-self.tolerance, self.tolerance], (m, 1))))
        # 1e-10 is the least that HiGHS takes
        found = linprog(
            cost, A_eq=np.hstack((A, -A, np.eye(m))), b_eq=b, bounds=bounds, method=self.method,
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10})
        status = _LINPROG.get(found.status, Status.NOT_CONVERGED)
        if not status.ok:
            return Recovered(np.zeros(k), status)
        p, n = np.split(np.asarray(found.x)[: 2 * k], 2)
        return Recovered(without_small(size * (p - n), self.cut))


def without_small(x: FloatArray, cut: float) -> FloatArray:
    """Coefficients x with zeros where they are at most `cut` times the largest one in magnitude."""
    return np.where(np.abs(x) > cut * np.abs(x).max(initial=0.0), x, 0.0)
