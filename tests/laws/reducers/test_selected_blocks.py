"""Blocks with few active atoms of many: what is left out of the arithmetic changes no number."""

import numpy as np

from sparsemor.core import FloatArray, Frame
from sparsemor.reducers.sparse.row_compression import compact_elastic
from sparsemor.reducers.step import operators
from sparsemor.reducers.step.blocks.compressed_prescribed import CompressedPrescribed
from sparsemor.reducers.step.blocks.selected_prescribed import SelectedPrescribed
from sparsemor.reducers.step.predictor import Prediction

M, K, S, G = 30, 240, 12, 3
ACTIVE = np.arange(5, 5 + S)


def random_operators(rng: np.random.Generator) -> operators.TestedElastic:
    def some(*shape: int) -> FloatArray:
        return rng.standard_normal(shape)

    frame: Frame = None  # type: ignore[assignment]  # not read by a block
    return operators.TestedElastic(
        frame, some(M, K), some(M, K), some(M, K), some(G, M, K), some(M, 2), some(M, 7),
        some(M, 0), some(M), np.zeros((0, K, K)), some(2, K), ())


def test_operators_of_few_active_atoms_are_those_of_all_columns() -> None:
    rng = np.random.default_rng(1)
    t, left = random_operators(rng), rng.standard_normal((S, M))
    whole = CompressedPrescribed.of(t, left, ACTIVE, 2.0, 3.0)
    few = SelectedPrescribed.of(t.by_columns(), left, ACTIVE, 2.0, 3.0)
    x, v, a = np.zeros((3, K))
    for u in (x, v, a):
        u[:40] = rng.standard_normal(40)  # also of atoms that have left the support
    at, kappa = Prediction(x, v, a, rng.standard_normal(7), 0.0), rng.standard_normal((4, G))
    np.testing.assert_allclose(few.bounds(kappa), whole.bounds(kappa))
    for one, other in zip(few.rates(K), whole.rates(K), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    table = np.concatenate((kappa.ravel()[: 2 * G], rng.standard_normal(2 + 1 + S)))
    pasts = [b.begin(at, 2.0, 3.0, table) for b in (whole, few)]
    d = rng.standard_normal(S)
    for _ in range(2):
        new = [b.improve(d, past) for b, past in zip((whole, few), pasts, strict=True)]
        np.testing.assert_allclose(new[1], new[0], rtol=1e-12)
        d = new[0] / np.linalg.norm(new[0])
    noise = [b.noise(d, past) for b, past in zip((whole, few), pasts, strict=True)]
    np.testing.assert_allclose(noise[1], noise[0], rtol=1e-12)
    none = SelectedPrescribed.of(t, np.zeros((0, M)), ACTIVE[:0], 2.0, 3.0)
    assert none.G.shape == (G, 0, 0) and not none.sizes.any()


def test_rows_are_not_turned_where_columns_are_no_fewer() -> None:
    t = random_operators(np.random.default_rng(2))
    found = compact_elastic(t, t.mass)
    assert found.operators is t and found.B is t.mass and found.reach == found.first == M
