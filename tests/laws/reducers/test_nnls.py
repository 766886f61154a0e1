"""Non-negative least squares: the solver that weights of elements are found by."""

import numpy as np
import pytest
from scipy.optimize import nnls

from sparsemor.reducers.projection.ecsw.nnls import nonnegative
from sparsemor.reducers.projection.ecsw.training import train
from sparsemor.reducers.projection.ecsw.training_matrix import WeightEquations


@pytest.mark.parametrize("seed", range(2))
def test_nonnegative_least_squares_agrees_with_scipy_when_run_to_its_end(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b = rng.standard_normal((30, 20)), rng.standard_normal(30)
    found = nonnegative(A, b, 0.0)
    best, residual = nnls(A, b)
    assert found.residual == pytest.approx(residual, rel=1e-10)
    np.testing.assert_allclose(found.values, best, atol=1e-10)


@pytest.mark.parametrize("seed", range(2))
def test_it_stops_at_the_tolerance_with_few_nonzeros(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    A = rng.random((25, 200))
    b = A.sum(axis=1)
    counts = []
    for tolerance in (0.3, 1e-2, 1e-6):
        w, residual = nonnegative(A, b, tolerance * np.linalg.norm(b))
        assert (w >= 0.0).all()
        assert residual <= tolerance * np.linalg.norm(b)
        assert residual == pytest.approx(float(np.linalg.norm(A @ w - b)), abs=1e-9)
        counts.append(np.count_nonzero(w))
    assert counts[0] <= counts[1] <= counts[2] <= 25


@pytest.mark.parametrize("seed", range(2))
def test_it_goes_on_from_weights_found_before(seed: int) -> None:
    """And ends where it would have without a stop; `most` bounds the nonzeros."""
    rng = np.random.default_rng(200 + seed)
    A = rng.random((25, 200))
    b = A.sum(axis=1)
    few = nonnegative(A, b, 0.0, most=4)
    assert np.count_nonzero(few.values) == 4
    whole, continued = nonnegative(A, b, 1e-8), nonnegative(A, b, 1e-8, start=few.values)
    np.testing.assert_allclose(continued.values, whole.values, rtol=1e-6)
    assert nonnegative(A, b, 10 * few.residual, start=few.values).values.tolist() == pytest.approx(
        few.values.tolist())


def test_out_of_reach_is_told_by_the_residual() -> None:
    w, residual = nonnegative(np.eye(3), np.array([1.0, 2.0, -3.0]), 1e-6)
    np.testing.assert_allclose(w, [1.0, 2.0, 0.0])
    assert residual == pytest.approx(3.0)


def test_without_forces_every_element_counts_once() -> None:
    none = WeightEquations.from_matrix(np.zeros((0, 7)))
    np.testing.assert_array_equal(train(none, 1e-6).values, np.ones(7))
