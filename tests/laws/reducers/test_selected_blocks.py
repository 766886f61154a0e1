"""Rows of blocks with more atoms than rows."""

import numpy as np

from sparsemor.core import FloatArray, Frame
from sparsemor.reducers.sparse.row_compression import compact, elastic_columns
from sparsemor.reducers.step import projected_operators

M, K, G = 30, 240, 3


def random_operators(rng: np.random.Generator) -> projected_operators.ProjectedElastic:
    def some(*shape: int) -> FloatArray:
        return rng.standard_normal(shape)

    frame: Frame = None  # type: ignore[assignment]  # not read by a block
    return projected_operators.ProjectedElastic(
        frame, some(M, K), some(M, K), some(M, K), some(G, M, K), some(M, 2), some(M, 7),
        some(M, 0), some(M), np.zeros((0, K, K)), some(2, K), ())


def test_rows_are_not_turned_where_columns_are_no_fewer() -> None:
    t = random_operators(np.random.default_rng(2))
    found = compact(t, t.mass, elastic_columns(t))
    assert found.operators is t and found.B is t.mass and found.reach == M
