"""Basis pursuit by convex optimisation."""

import warnings
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from sparsemor.core import PROBLEM_FEATURES, InputError, Status, require
from sparsemor.plugins.sparse_solvers.basis_pursuit_lp import without_small
from sparsemor.plugins.sparse_solvers.newton import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import Penalised, weights

CONIC = "CLARABEL"


class BasisPursuit(LinearRecovery):
    """Basis pursuit denoising: least weighted l1 norm with bounded residual, solved by cvxpy.

    min sum_j |x_j| / budget_j  subject to  norm(A x - b) <= tolerance norm(b). Where there are
    unpenalised columns, rows are those that are left when these are rotated out. Needs the extra
    `cvx`. Chen, Donoho and Saunders 2001, doi 10.1137/S003614450037906X; with a tolerance
    Candes, Romberg and Tao 2006, doi 10.1002/cpa.20124; weights as in Eq. 25.
    """

    tolerance: float = Field(default=1e-8, ge=0.0, lt=1.0)
    """Violation of the rows, relative to the right-hand side, in `norm`. 0: the rows hold as
    equations, and problems with more rows than columns are refused."""
    norm: Literal["two", "largest"] = "two"
    """Of the violation: Euclidean (a cone program), or the largest row (a linear program)."""
    solver: str = CONIC
    """A solver of cvxpy, such as CLARABEL, SCS, OSQP, HIGHS. The last two take no cone: with them
    choose `norm: largest`, or `tolerance: 0`."""
    cut: float = Field(default=1e-9, ge=0.0, lt=1.0)
    """Share of the largest coefficient (column-scaled) at or below which one counts as zero:
    interior points end near zero, not at it. What passes is harmless: it is fitted again."""

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
        """More rows than columns need a tolerance."""
        exact = {"overdetermined"} if self.tolerance == 0.0 else set()
        return frozenset(PROBLEM_FEATURES) - exact

    def recover(self, problem: Penalised) -> Recovered:
        """x (k,), with zeros where the solver's answer is below `cut`."""
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
"""Of cvxpy's words. `optimal_inaccurate` is what some solvers always reach, and others where
columns are nearly parallel; it serves, because only the support is taken from it. Limits are no
convergence."""


def _cvxpy() -> Any:
    """Imported here: it takes a second."""
    import cvxpy

    return cvxpy
