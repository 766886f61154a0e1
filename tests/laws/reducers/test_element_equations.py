"""The equations of element weights are summed up a few elements at a time, and never held."""

from typing import Any

import numpy as np
import pytest

from sparsemor.reducers.projection.ecsw import training as element_weights
from sparsemor.reducers.projection.ecsw import training_matrix as element_equations
from sparsemor.reducers.projection.ecsw.training import train
from sparsemor.reducers.projection.ecsw.training_matrix import EquationRows, WeightEquations


def positive(seed: int, shape: tuple[int, int] = (12, 90)) -> np.ndarray[Any, Any]:
    return np.asarray(np.random.default_rng(seed).random(shape))


@pytest.mark.parametrize("seed", range(4))
def test_sums_over_blocks_are_those_of_the_whole(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    G = positive(seed)
    monkeypatch.setattr(element_equations, "BLOCK", 12 * 7)
    e = WeightEquations.from_matrix(G)
    w = np.where(np.arange(90) % 3 == 0, 2.0, 0.0)
    np.testing.assert_allclose(e.total(), G.sum(axis=1), rtol=1e-13)
    np.testing.assert_allclose(e.applied(w), G @ w, rtol=1e-13)
    some = np.array([3, 17, 50, 51, 52, 53, 54, 55, 56, 89])
    found = e.combined(some, 100)
    assert found.exact
    np.testing.assert_allclose(found.A, G[:, some], rtol=1e-13)
    np.testing.assert_allclose(found.b, G.sum(axis=1), rtol=1e-13)


def test_rows_are_shares_of_their_sums_and_round_off_is_left_out() -> None:
    G, zero = positive(2), 1e-14 * positive(3)
    e = WeightEquations(90, (
        EquationRows(12, lambda p: G[:, p], 1.0), EquationRows(12, lambda p: zero[:, p], 1.0),
        EquationRows(12, lambda p: G[:, p])), ()).scaled()
    assert [p.count for p in e.parts] == [12, 12]
    assert np.linalg.norm(e.total()[:12]) == pytest.approx(1.0)
    np.testing.assert_allclose(e.total()[12:], G.sum(axis=1))
    assert not WeightEquations.from_matrix(zero, 1.0).scaled().parts


def test_many_rows_are_replaced_by_as_few_as_do() -> None:
    G = np.random.default_rng(5).standard_normal((400, 20))
    few = WeightEquations.from_matrix(G).combined(np.arange(20), 30)
    assert few.exact and len(few.A) == 21
    w = np.random.default_rng(6).random(20)
    assert np.linalg.norm(few.A @ w - few.b) == pytest.approx(np.linalg.norm(G @ (w - 1.0)))


def test_elements_that_carry_the_forces_are_candidates() -> None:
    """100 of 10 000 elements, each with a force of its own, are all found among 300."""
    rng = np.random.default_rng(13)
    G, hot = 1e-9 * rng.random((100, 10_000)), rng.choice(10_000, 100, replace=False)
    G[np.arange(100), hot] += 1.0
    found = train(WeightEquations.from_matrix(G), 1e-6, 300)
    assert found.residual <= 1e-6 and found.values[hot].all()
    cold = train(WeightEquations.from_matrix(G[:, :5000] * (rng.random(5000) < 0.01)), 1e-6, 300)
    assert cold.residual <= 1e-6


def test_small_rows_that_large_weights_bring_out_count() -> None:
    """All elements together make 9e-3 tau in row 2; few of them would make hundreds of times
    that."""
    tau, E = 1e-2, 20_000
    rng = np.random.default_rng(1)
    small = rng.standard_normal(E)
    small *= 0.9e-2 * tau / np.linalg.norm(small)
    G = np.vstack([1.0 + 0.1 * rng.random(E), small])
    G[0] /= G[0].sum()
    found = train(WeightEquations.from_matrix(G), tau)
    assert found.residual <= 1.01 * tau
    # one element would do without it
    assert np.count_nonzero(found.values) == 2


@pytest.mark.parametrize("first", [120, 80])
@pytest.mark.parametrize("tau", [1e-2, 1e-3])
def test_weights_found_with_combinations_repeat_all_equations(
    monkeypatch: pytest.MonkeyPatch, tau: float, first: int
) -> None:
    """With 80 combinations at first some weights are too many for these, so that 160 follow."""
    rng = np.random.default_rng(1)
    G = rng.random((600, 40)) @ np.diag(0.7 ** np.arange(40)) @ rng.standard_normal((40, 900))
    G += 3.0 * rng.random((600, 1)) @ rng.random((1, 900))
    G /= np.linalg.norm(G.sum(axis=1))
    monkeypatch.setattr(element_equations, "BLOCK", 10_000)
    monkeypatch.setattr(element_weights, "COMBINATIONS", first)
    monkeypatch.setattr(element_weights, "MOST", 480)
    found = train(WeightEquations.from_matrix(G), tau)
    assert found.residual == pytest.approx(float(np.linalg.norm(G @ (found.values - 1.0))))
    assert found.residual <= 1.01 * tau
    assert 0 < np.count_nonzero(found.values) < 100 and (found.values >= 0.0).all()


def test_training_holds_neither_all_rows_nor_all_elements(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 3000 equations for 4000 elements, 120 combinations for 250 candidates are the largest
    array."""
    rng, sizes = np.random.default_rng(3), list[int]()
    left, right = rng.random((3000, 6)), rng.random((6, 4000)) / 4000

    def make(part: Any) -> Any:
        found = left @ right[:, part] / 3000
        sizes.append(found.size)
        return found

    combined = WeightEquations.combined

    def seen(self: WeightEquations, elements: Any, most: int) -> Any:
        found = combined(self, elements, most)
        sizes.append(found.A.size)
        return found

    monkeypatch.setattr(WeightEquations, "combined", seen)
    monkeypatch.setattr(element_equations, "BLOCK", 30_000)
    monkeypatch.setattr(element_weights, "COMBINATIONS", 120)
    found = train(WeightEquations(4000, (EquationRows(3000, make),), ()), 1e-6, 250)
    assert found.residual <= 1.01e-6 and np.count_nonzero(found.values) <= 6
    assert max(sizes) == 120 * 250
