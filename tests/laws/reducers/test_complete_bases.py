"""Selection from many more atoms than rows: exchanges by normal equations are those by QR, products
with few nonzero coefficients are those with all, and a settled support is kept."""

import numpy as np
import pytest

from sparsemor.core import Status
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.plugins.sparse_solvers.gram_exchange import GramExchange
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton, GreedyRecovery
from sparsemor.reducers.linalg.active_columns import ActiveColumns


def problem(seed: int, m: int = 40, k: int = 160, s: int = 6) -> tuple[FloatArray, BoolArray]:
    """Sampled rows of an orthogonal matrix with columns of unit length, and a support."""
    rng = np.random.default_rng(seed)
    J = np.linalg.qr(rng.standard_normal((k, k)))[0][:m]
    support = np.zeros(k, dtype=np.bool_)
    support[rng.choice(k, s, replace=False)] = True
    return J / np.linalg.norm(J, axis=0), support


def prepared(J: FloatArray, budget: int) -> GreedyRecovery:
    made = GreedyGaussNewton(candidates="correlated").prepare(ColumnSubsets(J, 1e-12), budget)
    assert isinstance(made, GreedyRecovery)
    return made


@pytest.mark.parametrize("seed", range(3))
def test_exchanges_by_normal_equations_are_thoseby_qr(seed: int) -> None:
    J, old = problem(seed)
    rng = np.random.default_rng(seed + 100)
    recovery = prepared(J, int(old.sum()))
    b = J[:, problem(seed + 50)[1]].sum(axis=1) + 1e-6 * rng.standard_normal(len(J))
    z = ColumnSubsets(J, 1e-12).least_norm_solution(old, b)
    r = J @ z - b
    found, by_qr = recovery.by_gram(r, z, old), recovery.by_qr(r, z, old, old)
    assert found is not None and found.status is Status.DONE
    assert (found.support == by_qr.support).all()
    assert (recovery.select(r, z, old).support == found.support).all()


def test_columns_that_are_too_alike_are_left_to_qr() -> None:
    J, old = problem(4)
    J = J.copy()
    twin, kept = np.flatnonzero(~old)[0], np.flatnonzero(old)[0]
    J[:, twin] = J[:, kept] + 1e-7 * J[:, twin]
    J[:, twin] /= np.linalg.norm(J[:, twin])
    union = old.copy()
    union[twin] = True
    gram, r = GramExchange.from_matrix(J), np.ones(len(J))
    z = np.zeros(J.shape[1])
    assert gram.exchanged(r, z, gram.correlations(r), old, union, 6) is None


def test_only_columns_of_nonzero_entries_are_read() -> None:
    rng = np.random.default_rng(1)
    A, U = rng.standard_normal((5, 30)), np.zeros((3, 30))
    U[:, [2, 7, 11]] = rng.standard_normal((3, 3))
    U[1, 20] = 1e-300  # left of an atom that is not active any more
    few = ActiveColumns(A)
    few.transposed[12:] = np.nan
    np.testing.assert_allclose(few.times(U[1]), A @ np.where(U[1] > 1e-200, U[1], 0.0) + A[
        :, U[1] < 0] @ U[1, U[1] < 0], rtol=1e-13)
    np.testing.assert_allclose(few.times(U), U[:, :12] @ A[:, :12].T, rtol=1e-13)
