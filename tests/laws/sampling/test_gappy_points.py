"""GappyPOD+E with many columns: updates in place of an SVD a row change no choice."""

from collections.abc import Callable

import numpy as np
import pytest

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.plugins.samplers import smallest_singular_pair as smallest
from sparsemor.plugins.samplers.candidate_rows import GreedyRows
from sparsemor.plugins.samplers.deim import pivots, raise_smallest
from sparsemor.plugins.samplers.smallest_singular_pair import SMALL, Smallest
from tiers import full

Columns = Callable[[int, int, int], FloatArray]


def random(n: int, k: int, seed: int) -> FloatArray:
    return np.asarray(np.linalg.qr(np.random.default_rng(seed).standard_normal((n, k)))[0])


def moving(n: int, k: int, seed: int) -> FloatArray:
    """Shapes that are all zero but near one place each, beside one that is everywhere: at their
    points many singular values are nearly alike, as those of force modes of a moving load are."""
    x, rng = np.linspace(0.0, 1.0, n), np.random.default_rng(seed)
    near = np.exp(-((x[:, None] - np.linspace(0.0, 0.7, k - 1)) * k) ** 2)
    noise = 1e-3 * rng.standard_normal((n, k))
    return np.asarray(np.linalg.qr(np.column_stack([near, np.ones(n)]) + noise)[0])


def rows_beside(U: FloatArray, taken: IntArray, m: int) -> GreedyRows:
    free = ~np.isin(np.arange(len(U)), taken)
    return GreedyRows.from_coordinates(np.arange(float(len(U)))[:, None], free, m, "dof")


def best_by_definition(U: FloatArray, taken: list[int]) -> FloatArray:
    """(n,) the bound of Ipsen and Nadler for each row, from an SVD of the rows taken."""
    _, s, Vt = np.linalg.svd(U[taken], full_matrices=False)
    g, length = s[-2] ** 2 - s[-1] ** 2, (U**2).sum(axis=1)
    a = g + length
    found = a - np.sqrt(a * a - 4.0 * g * (U @ Vt[-1]) ** 2)
    found[taken] = -np.inf
    return np.asarray(found)


class Checked(GreedyRows):
    """Asserts that each row taken is the best by the definition."""

    U: FloatArray

    def take(self, score: FloatArray) -> IntArray:
        true = best_by_definition(self.U, self.numbers().tolist())
        new = super().take(score)
        assert true[new[0]] == pytest.approx(true.max(), rel=1e-7)
        return new


@pytest.mark.parametrize(("make", "k"), [
    (random, 10), (moving, 10), full(random, SMALL + 1), full(moving, 80)])
def test_each_row_is_the_best_by_definition(make: Columns, k: int) -> None:
    U = make(4 * k, k, k)
    pivoted = rows_beside(U, np.zeros(0, np.int64), k)
    pivots(U, pivoted)
    rows = Checked(pivoted.taken, pivoted.node, min(2 * k, 40))
    rows.U = U
    raise_smallest(U, rows)
    assert rows.left == 0


def test_where_iterations_do_not_converge_the_svd_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    U = moving(320, 80, 3)
    rows, again = (rows_beside(U, np.arange(0, 320, 3), 20) for _ in range(2))
    raise_smallest(U, rows)
    monkeypatch.setattr(smallest, "CYCLES", 0)
    raise_smallest(U, again)
    assert np.array_equal(rows.numbers(), again.numbers())


@pytest.mark.full
def test_rows_that_hardly_see_the_columns_are_met_by_svds() -> None:
    U = random(400, 70, 0)
    U[:200, :5] *= 1e-9
    U = np.linalg.qr(U)[0]
    found = Smallest(U[:200])
    assert found.M is None
    for i in range(200, 300):
        found.add(U[i : i + 1])
    s = np.linalg.svd(U[:300], compute_uv=False)
    assert found.M is not None
    np.testing.assert_allclose(found.s, s[-2:], rtol=1e-8)


def test_a_row_of_a_node_that_says_nothing_new_takes_no_direction() -> None:
    """Both rows of each node are alike: of six nodes, six directions are spanned, not three."""
    U = np.linalg.qr(np.repeat(np.random.default_rng(0).standard_normal((30, 6)), 2, axis=0))[0]
    rows = GreedyRows.from_coordinates(
        np.repeat(np.arange(30.0), 2)[:, None], np.ones(60, np.bool_), 12, "node")
    pivots(U, rows)
    assert rows.left == 0 and np.linalg.matrix_rank(U[rows.numbers()]) == 6
