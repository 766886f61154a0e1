"""Leverage-score sampling of rows."""

from typing import Literal

import numpy as np
from scipy import linalg

from sparsemor.core import FloatArray
from sparsemor.plugins.samplers.candidate_rows import GreedyRows, SpanSampler


class Leverage(SpanSampler):
    """Leverage-score sampling: rows drawn with probability proportional to score, or the m largest.

    The score of row u of an orthonormal basis U (n, k) of the sampled vectors is |u|^2 or, given
    required rows R, u (U_R^T U_R + m/n)^-1 u^T, its leverage relative to these and m average rows.
    Mahoney 2011, doi 10.1561/2200000035; the largest: Papailiopoulos, Kyrillidis and Boutsidis
    2014, doi 10.1145/2623330.2623698.
    """

    method: Literal["random", "top"] = "random"
    """`random` draws without replacement; `top` takes the m largest scores, which may cluster in
    one region and miss others."""

    def choose(self, U: FloatArray, rows: GreedyRows, rng: np.random.Generator) -> None:
        """Takes units (rows or nodes) by the leverage scores of their rows of U (n, k), whose
        columns are orthonormal: the largest, or a draw with these weights. Both take units in the
        order of increasing keys, one a unit."""
        if rows.left == 0:
            return
        scores = leverage(U, U[rows.taken], rows.left)
        weight = np.bincount(rows.node, np.where(rows.taken, 0.0, scores))
        if self.method == "top":
            # a node by its mean: a node of which some rows are required is not worth less
            rows.take_in_order(-weight / np.maximum(np.bincount(rows.node, ~rows.taken), 1))
            return
        # Efraimidis and Spirakis 2006, doi 10.1016/j.ipl.2005.11.003: one key a unit, the least
        # keys are a weighted draw without replacement
        rows.take_in_order(rng.exponential(size=weight.size) / np.maximum(weight, 1e-200))


def leverage(U: FloatArray, kept: FloatArray, m: int) -> FloatArray:
    """Leverage scores (n,) of the rows of U (n, k), orthonormal columns, given rows `kept` (p, k)
    and m rows to draw."""
    G = kept.T @ kept + m / U.shape[0] * np.eye(U.shape[1])
    W = linalg.solve_triangular(linalg.cholesky(G, lower=True), U.T, lower=True)
    return np.asarray(np.einsum("ij,ij->j", W, W))
