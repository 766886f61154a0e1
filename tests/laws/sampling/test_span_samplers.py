"""Samplers that look at the atoms: deim, leverage, s_opt. Against definitions, bounds and pyMOR."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import linalg, sparse

from sparsemor.core import BlockData, Dictionary
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_sampler
from sparsemor.core.testing.random_inputs import random_block, random_dictionary
from sparsemor.plugins.samplers.candidate_rows import GreedyRows, SpanSampler, orthonormal
from sparsemor.plugins.samplers.deim import DeimPoints
from sparsemor.plugins.samplers.leverage import Leverage, leverage
from sparsemor.plugins.samplers.s_opt import SOpt

NONE = np.zeros(0, dtype=np.int64)
EVERY: list[tuple[type[SpanSampler], dict[str, Any]]] = [
    (DeimPoints, {"method": "qr"}), (DeimPoints, {"method": "greedy"}),
    (Leverage, {"method": "random"}), (Leverage, {"method": "top"}), (SOpt, {}),
]


def dictionary_of(atoms: FloatArray) -> Dictionary:
    return Dictionary(atoms, np.zeros(len(atoms)), ("",) * atoms.shape[1])


def block_of(n: int) -> BlockData:
    """Two displacements a node, identity operators."""
    eye = sparse.csr_array(sparse.eye_array(n))
    return BlockData("link.elastic", np.zeros((n, 0)), eye, eye,
                     np.repeat(np.arange(n / 2), 2)[:, None], np.arange(n) % 2, np.zeros((n, 0)))


def smooth(n: int, k: int, seed: int) -> FloatArray:
    """Orthonormal columns that oscillate faster and faster, with a little noise."""
    x = np.linspace(0.0, 1.0, n)
    noise = 0.01 * np.random.default_rng(seed).standard_normal((n, k))
    return np.linalg.qr(np.cos(np.pi * np.outer(x, np.arange(k))) + noise)[0]


def rows_of(
    sampler: SpanSampler, atoms: FloatArray, m: int, required: IntArray = NONE, seed: int = 0
) -> IntArray:
    return sampler.sample(block_of(len(atoms)), m, dictionary_of(atoms),
                          np.random.default_rng(seed), required)


def least(A: FloatArray) -> float:
    return float(np.linalg.svd(A, compute_uv=False)[-1])


def random_rows(n: int, m: int, seed: int, required: IntArray = NONE) -> IntArray:
    free = np.setdiff1d(np.arange(n), required)
    drawn = np.random.default_rng(seed).choice(free, m, replace=False)
    return np.union1d(required, drawn)


@pytest.mark.parametrize(("kind", "options"), EVERY)
@pytest.mark.parametrize(("unit", "of"), [("dof", "operator"), ("node", "atoms")])
def test_every_option_keeps_the_laws(
    kind: type[SpanSampler], options: dict[str, Any], unit: str, of: str
) -> None:
    check_sampler(kind(unit=unit, of=of, **options), seed=1, trials=3)
    check_sampler(kind(unit=unit, of=of, required=False, **options), seed=2, trials=3)


@pytest.mark.parametrize(("kind", "options"), EVERY)
def test_rows_of_a_complete_basis_are_those_of_its_leading_atoms(
    kind: type[SpanSampler], options: dict[str, Any]
) -> None:
    U = np.linalg.qr(np.hstack([smooth(40, 8, 1), np.random.default_rng(2).standard_normal(
        (40, 32))]))[0]
    leading = rows_of(kind(required=False, leading=8, **options), U, 12)
    assert list(leading) == list(rows_of(kind(required=False, **options), U[:, :8], 12))
    assert list(leading) != list(rows_of(kind(required=False, **options), U, 12))


@pytest.mark.parametrize(("kind", "options"), EVERY)
@pytest.mark.parametrize("k", [1, 90])
def test_any_number_of_atoms_dependent_ones_too(
    kind: type[SpanSampler], options: dict[str, Any], k: int
) -> None:
    for seed in range(3):
        rng = np.random.default_rng([seed, k])
        block = random_block(rng)
        T = random_dictionary(block.size, k, rng).atoms
        T = np.hstack([T, T[:, :1], 0.0 * T[:, :1]])  # one twice, and a column of zeros
        required = np.arange(0, block.size, 5)
        m = int(rng.integers(0, block.size - required.size + 1))
        rows = kind(**options).sample(block, m, dictionary_of(T), rng, required)
        assert rows.size == m + required.size and np.isin(required, rows).all()


@pytest.mark.parametrize("seed", range(2))
def test_q_deim_takes_the_pivots_of_lapack_and_keeps_its_bound(seed: int) -> None:
    n, k = 120, 12
    U = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, k)))[0]
    rows = rows_of(DeimPoints(of="atoms"), U, k)
    assert np.array_equal(rows, np.sort(linalg.qr(U.T, pivoting=True, mode="r")[1][:k]))
    # Drmac and Gugercin 2016, Theorem 2.1; what is found is far below it
    bound = np.sqrt(n - k + 1) * np.sqrt(4.0**k + 6 * k - 1) / 3
    assert 1 / least(U[rows]) <= bound
    assert 1 / least(U[rows]) <= np.sqrt(1 + k * (n - k))


def test_q_deim_sees_the_space_and_not_its_basis() -> None:
    rng = np.random.default_rng(0)
    U = np.linalg.qr(rng.standard_normal((80, 6)))[0]
    mixed = U @ rng.standard_normal((6, 6))
    assert np.array_equal(rows_of(DeimPoints(), U, 15), rows_of(DeimPoints(), mixed, 15))


@pytest.mark.full
@pytest.mark.parametrize("seed", range(2))
def test_greedy_deim_agrees_with_pymor(seed: int) -> None:
    from pymor.algorithms.ei import deim
    from pymor.vectorarrays.numpy import NumpyVectorSpace

    U = smooth(100, 10, seed) * 10.0 ** -np.arange(10)
    space = NumpyVectorSpace(100)
    in_rows = space.zeros(2).to_numpy().shape == (2, 100)  # before pyMOR 2025
    points, _, _ = deim(space.make_array(U.T if in_rows else U), pod=False)
    assert np.array_equal(rows_of(DeimPoints(of="atoms", method="greedy"), U, 10), np.sort(points))


@pytest.mark.parametrize("options", [{"method": "qr"}, {"method": "greedy"}])
def test_oversampling_raises_the_smallest_singular_value(options: dict[str, Any]) -> None:
    U = smooth(200, 8, 0)
    values = [least(U[rows_of(DeimPoints(of="atoms", **options), U, m)]) for m in (8, 12, 20, 40)]
    assert (np.diff(values) > 0).all()
    for m, value in zip((12, 20, 40), values[1:], strict=True):
        drawn = [least(U[random_rows(200, m, seed)]) for seed in range(50)]
        assert value > np.quantile(drawn, 0.9)


@pytest.mark.parametrize("kind", [DeimPoints, SOpt])
def test_rows_are_chosen_knowing_the_required_ones(kind: type[SpanSampler]) -> None:
    """Better, in the median, than the same number of rows chosen without looking at them."""
    gained = []
    for seed in range(7):
        U = smooth(120, 10, seed)
        required = np.arange(20) + int(np.random.default_rng(seed).integers(100))
        together = rows_of(kind(of="atoms"), U, 10, required)
        alone = rows_of(kind(of="atoms", required=False), U, 10)
        appended = np.union1d(required, alone)
        gained.append(least(U[together]) / least(U[appended]))
    assert np.median(gained) > 1.0


def test_no_pivot_repeats_a_required_row() -> None:
    """Rows come in equal pairs; with one of each pair required, the others say nothing new."""
    U = np.linalg.qr(np.repeat(np.random.default_rng(0).standard_normal((20, 8)), 2, axis=0))[0]
    required = np.array([0, 6, 12])
    for kind in (DeimPoints(of="atoms", method="qr"), DeimPoints(of="atoms", method="greedy")):
        rows = rows_of(kind, U, 5, required)
        assert np.unique(rows // 2).size == 8


def s_quantity(A: FloatArray) -> float:
    """Criterion S = (sqrt det A^T A / prod |a_j|)^(1/k) of A (m, k): 0 when m < k, when the columns
    depend on each other, or one is zero."""
    norms = np.linalg.norm(A, axis=0)
    if A.shape[0] < A.shape[1] or not norms.all():
        return 0.0
    s = np.linalg.svd(A / norms, compute_uv=False)
    return float(np.exp(np.log(np.maximum(s, 1e-300)).mean()))


@pytest.mark.parametrize("required", [NONE, np.array([3, 4, 5, 6]), np.arange(10, 22)])
def test_s_opt_is_the_greedy_maximum_of_s(required: IntArray) -> None:
    """Each row is the best of all by the definition: fast updates change no choice."""
    U = np.linalg.qr(np.random.default_rng(3).standard_normal((40, 6)))[0]
    taken = list(required)
    for m in range(1, 16):
        rows = rows_of(SOpt(of="atoms"), U, m, required)
        (new,) = np.setdiff1d(rows, taken)
        j = min(len(taken) + 1, 6)
        if len(taken) > 0:
            free = np.setdiff1d(np.arange(40), taken)
            values = [s_quantity(U[[*taken, i], :j]) for i in free]
            assert s_quantity(U[[*taken, new], :j]) == pytest.approx(max(values), rel=1e-9)
        else:
            assert new == np.abs(U[:, 0]).argmax()
        taken.append(int(new))


def test_s_opt_starts_well_from_required_rows_that_hardly_see_the_atoms() -> None:
    """Scores shrink by many orders there, where rank-one updates would lose their digits."""
    U = smooth(150, 8, 1)
    U[:30] *= 1e-7
    U = np.linalg.qr(U)[0]
    rows = rows_of(SOpt(of="atoms"), U, 16, np.arange(30))
    drawn = [s_quantity(U[random_rows(150, 16, s, np.arange(30))]) for s in range(31)]
    assert s_quantity(U[rows]) > max(drawn)


def test_leverage_scores() -> None:
    U = np.linalg.qr(np.random.default_rng(0).standard_normal((50, 5)))[0]
    plain = leverage(U, U[:0], 10)
    np.testing.assert_allclose(plain, 5.0 * (U**2).sum(axis=1), rtol=1e-12)  # n / m = 5
    kept = U[:20]
    given = leverage(U, kept, 10)
    M = np.linalg.inv(kept.T @ kept + 10 / 50 * np.eye(5))
    np.testing.assert_allclose(given, np.einsum("ij,jk,ik->i", U, M, U), rtol=1e-12)
    assert (given < plain).all()


def test_top_leverage_takes_the_largest_scores() -> None:
    U = np.linalg.qr(np.random.default_rng(1).standard_normal((60, 4)))[0]
    rows = rows_of(Leverage(of="atoms", method="top"), U, 7)
    assert np.array_equal(rows, np.sort(np.argsort(-(U**2).sum(axis=1))[:7]))


@pytest.mark.full
def test_random_leverage_draws_in_proportion_to_the_scores() -> None:
    U = np.linalg.qr(np.random.default_rng(2).standard_normal((12, 3)))[0]
    share, runs = (U**2).sum(axis=1) / 3, 4000
    hits, rng = np.zeros(12), np.random.default_rng(0)
    for _ in range(runs):
        rows = GreedyRows.from_coordinates(
            np.arange(12.0)[:, None], np.ones(12, dtype=np.bool_), 1, "dof")
        Leverage().choose(U, rows, rng)
        hits[rows.numbers()] += 1
    deviation = np.sqrt(runs * share * (1 - share))
    assert (np.abs(hits - runs * share) < 4.5 * deviation).all()


@pytest.mark.full
def test_whole_nodes_of_leverage_are_drawn_by_their_sum() -> None:
    U = np.zeros((8, 1))
    U[[2, 5], 0] = 0.6, 0.8
    counts, rng = np.zeros(4), np.random.default_rng(0)
    for _ in range(400):
        rows = GreedyRows.from_coordinates(
            np.repeat(np.arange(4.0), 2)[:, None], np.ones(8, dtype=np.bool_), 2, "node")
        Leverage().choose(U, rows, rng)
        first, second = rows.numbers()
        assert first % 2 == 0 and second == first + 1
        counts[first // 2] += 1
    assert counts[[0, 3]].sum() == 0 and abs(counts[2] - 256) < 50


@pytest.mark.parametrize(("kind", "options"), [e for e in EVERY if e[1] != {"method": "random"}])
def test_rules_without_chance_do_not_depend_on_the_seed(
    kind: type[SpanSampler], options: dict[str, Any]
) -> None:
    U = smooth(60, 5, 0)
    assert np.array_equal(rows_of(kind(**options), U, 9, seed=1),
                          rows_of(kind(**options), U, 9, seed=2))


def test_the_operator_holds_mass_over_step_squared_or_over_step() -> None:
    rng = np.random.default_rng(0)
    block = random_block(rng)
    n = block.size
    T = random_dictionary(n, 5, rng)
    for component, h in ((np.arange(n) % 2, 1e-4), (np.zeros(n, dtype=np.int64), 1e-2)):
        seen = (block.stiffness + block.mass / h) @ T.atoms
        given = replace(block, component=component)
        direct = DeimPoints(of="atoms").sample(given, 20, dictionary_of(seen), rng, NONE)
        assert np.array_equal(DeimPoints(step=1e-2).sample(given, 20, T, rng, NONE), direct)


def test_atoms_that_vanish_under_the_operator_are_refused_in_words() -> None:
    zero = sparse.csr_array((10, 10))
    block = replace(block_of(10), mass=zero, stiffness=zero)
    with pytest.raises(InputError, match="all atoms of link.elastic vanish"):
        DeimPoints().sample(
            block, 3, dictionary_of(np.eye(10)[:, :2]), np.random.default_rng(0), NONE)


def test_orthonormal_keeps_leading_spans_and_drops_repetitions() -> None:
    V = np.random.default_rng(0).standard_normal((30, 4)) * [1.0, 1e-9, 1e9, 1.0]
    Q = orthonormal(np.column_stack([V[:, :2], V[:, 0] + V[:, 1] * 1e9, V[:, 2:]]), "b")
    assert Q.shape == (30, 4)
    for j in range(1, 5):
        v = V[:, j - 1] / np.linalg.norm(V[:, j - 1])
        assert np.linalg.norm(v - Q[:, :j] @ (Q[:, :j].T @ v)) < 1e-12
