"""The installed sparse solvers, and problems that several tests of them solve."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from sparsemor.core import Group, SparseOutcome, SparseSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing import installed
from sparsemor.core.testing.sparse_problems import Elsewhere, LeastSquares, empty_start
from sparsemor.plugins.sparse_solvers.basis_pursuit import BasisPursuit, BasisPursuitLp
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery

SOLVERS: dict[str, Any] = {name: plugin() for name, plugin in installed("sparse_solver").items()}
LINEAR = {name: s for name, s in SOLVERS.items() if isinstance(s, LinearRecovery)}
PURSUITS: dict[str, tuple[type[LinearRecovery], dict[str, Any]]] = {
    "linprog": (BasisPursuitLp, {"tolerance": 0.0}),
    "clarabel": (BasisPursuit, {"tolerance": 0.0}),
    "highs": (BasisPursuit, {"tolerance": 0.0, "solver": "SCIPY"})}
"""Basis pursuit with equality constraints: classes and options, because to name a solver of cvxpy
imports cvxpy, which takes a second."""
IMPORTS = ("basis_pursuit", "lasso_lars")
"""Solvers whose first use imports cvxpy or scikit-learn, which takes a second: full tier."""


def each_of(solvers: dict[str, Any]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("solver", [
        pytest.param(s, id=name, marks=[pytest.mark.full] * (name in IMPORTS))
        for name, s in solvers.items()])


each, each_linear = each_of(SOLVERS), each_of(LINEAR)


def empty(solver: SparseSolver, problem: "LeastSquares | Elsewhere | Tempting") -> SparseOutcome:
    """Solved from an empty support."""
    k = max(g.stop for g in problem.groups)
    return solver.solve(problem, empty_start(k))


@dataclass(frozen=True)
class Tempting:
    """residual = (1, 1.2, 1) - (c0, c1, 0), one atom allowed; its Jacobian always promises that
    the other atom would remove all that is left, so that the supports alternate for ever."""

    groups: tuple[Group, ...] = (Group("g", 0, 2, 1),)
    needs: frozenset[str] = frozenset()

    def residual(self, c: FloatArray) -> FloatArray:
        return np.array([1.0 - c[0], 1.2 - c[1], 1.0])

    def jacobian(self, c: FloatArray) -> FloatArray:
        J = -np.eye(3)[:, :2]
        if c.any():
            J[:, c == 0.0] = -self.residual(c)[:, None]
        return J
