"""The faster recoveries of first-party solvers select what their nonlinear solve selects."""

import numpy as np
import pytest

from sparsemor.core import SparseSolver
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.testing import installed
from tiers import full

ACTIVE = 5


@pytest.mark.parametrize("name", ["cosamp", "greedy_gauss_newton", full("lasso_lars"), "omp"])
@pytest.mark.parametrize(("shape", "orthonormal"), [((60, 70), False), ((32, 32), True)])
def test_prepare_selects_what_solve_selects(
    name: str, shape: tuple[int, int], orthonormal: bool
) -> None:
    """Of orthonormal columns, as of all rows of D^-1 r, the largest coefficients."""
    rng, solver = np.random.default_rng(5), installed("sparse_solver")[name]()
    A = rng.standard_normal(shape)
    A = np.linalg.qr(A)[0] if orthonormal else A
    columns = ColumnSubsets(A / np.linalg.norm(A, axis=0), 1e-12)
    own, default = solver.prepare(columns, ACTIVE), SparseSolver.prepare(solver, columns, ACTIVE)
    assert type(own) is not type(default)
    for _ in range(2):
        x, wrong = np.zeros(shape[1]), np.zeros(shape[1], dtype=np.bool_)
        x[rng.choice(shape[1], ACTIVE, replace=False)] = rng.standard_normal(ACTIVE)
        wrong[rng.choice(shape[1], ACTIVE, replace=False)] = True
        b = columns.A @ x + 1e-3 * rng.standard_normal(shape[0])
        c = columns.solution(wrong, b)
        assert c is not None
        found = [r.select(columns.A @ c - b, c, wrong) for r in (own, default)]
        assert found[0].status.ok and found[1].status.ok
        assert np.array_equal(found[0].support, found[1].support)
        if orthonormal:
            largest = np.argsort(-np.abs(b @ columns.A))[:ACTIVE]
            assert set(largest) == set(np.flatnonzero(found[0].support))
