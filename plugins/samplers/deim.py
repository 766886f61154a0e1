"""Discrete empirical interpolation points, greedy or by pivoted QR, and oversampling by
GappyPOD+E."""

from typing import Literal

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.plugins.samplers.candidate_rows import GreedyRows, SpanSampler
from sparsemor.plugins.samplers.smallest_singular_pair import EPS, RowFactor, Smallest

NEW = 1e-8
"""Norm of a row's component outside the span of the rows taken, below which it adds no information,
such as another row of the same node."""


class DeimPoints(SpanSampler):
    """Q-DEIM: as many interpolation points as independent atoms; further rows by GappyPOD+E.

    Points: Chaturantabut and Sorensen 2010, doi 10.1137/090766498 (`greedy`); Drmac and Gugercin
    2016, doi 10.1137/15M1019271 (`qr`, Q-DEIM). Oversampling: Peherstorfer, Drmac and Gugercin
    2020, doi 10.1137/19M1307391. Deterministic: the seed has no effect.
    """

    method: Literal["qr", "greedy"] = "qr"
    """`qr` takes the pivots of a column-pivoted QR of the vectors' transpose, independent of their
    order; `greedy` takes one row per vector, where its interpolation by the vectors before it has
    the largest error."""

    def choose(self, U: FloatArray, rows: GreedyRows, rng: np.random.Generator) -> None:
        if self.method == "greedy":
            interpolation_points(U, rows)
        pivots(U, rows)
        raise_smallest(U, rows)


def pivots(U: FloatArray, rows: GreedyRows) -> None:
    """Adds the rows of U (n, k) with the largest component outside the span of the rows taken.

    Ends when they span all columns. From an empty set, these are the pivots of LAPACK's
    column-pivoted QR of U^T. The span of required rows is projected out first, so that no pivot
    repeats them.
    """
    _, V, rank = RowFactor(U[rows.taken]).singular(U.shape[1])
    W = U @ V[:, rank:]  # rows without their parts in the span of the rows taken
    # columns of W are orthonormal, and so are those of what is left of them: some row has at least
    # 1/n left of its square until all is spanned, and the differences below keep their digits
    left = np.einsum("ij,ij->i", W, W)
    unspanned, found = W.shape[1], 0
    Q = np.zeros((unspanned, unspanned))
    while rows.left and found < unspanned:
        for i in rows.take(left):  # the row with the largest part left, and others of its node
            new = W[i]
            for _ in range(2):
                new = new - (Q[:found] @ new) @ Q[:found]
            size = np.linalg.norm(new)
            if found < unspanned and size > NEW:  # else it adds nothing to the span
                Q[found] = new / size
                left -= (W @ Q[found]) ** 2
                found += 1


def interpolation_points(U: FloatArray, rows: GreedyRows) -> None:
    """Adds rows by DEIM's greedy rule on the columns of U (n, k) in their order.

    With p rows taken, the next one is where the fit of column p + 1 by the p columns before it has
    the largest error. Required rows, and all rows of a node, thus count as interpolation points of
    the first columns.
    """
    while rows.left:
        p = int(rows.taken.sum())
        if p >= U.shape[1]:
            return
        error = U[:, p]
        if p:
            fit = np.linalg.lstsq(U[rows.taken, :p], U[rows.taken, p], rcond=None)[0]
            error = error - U[:, :p] @ fit
        rows.take(np.abs(error))


def raise_smallest(U: FloatArray, rows: GreedyRows) -> None:
    """Adds rows by GappyPOD+E: those that most raise the smallest singular value of the sampled U
    (n, k).

    Score of a row u: twice a lower bound of the increase of s_k^2, with the two smallest singular
    values s_k <= s_{k-1}, the right vector w of s_k and g = s_{k-1}^2 - s_k^2: g + |u|^2 - sqrt((g
    + |u|^2)^2 - 4 g (u w)^2) (bound of Ipsen and Nadler 2009).
    """
    if not rows.left:
        return
    smallest = Smallest(U[rows.taken])
    length = np.einsum("ij,ij->i", U, U)
    while rows.left:
        above, least = smallest.s**2  # s_{k-1}^2, s_k^2
        g, along = above - least, (U @ smallest.vector) ** 2
        score = along  # what counts when only one value is smallest, or two are alike
        if np.isfinite(g) and g > EPS * above:
            # a - sqrt(a^2 - b) as b / (a + sqrt(a^2 - b)): no difference of nearly equal numbers
            a, b = g + length, 4.0 * g * along
            score = b / (a + np.sqrt(np.maximum(a * a - b, 0.0)))
        smallest.add(U[rows.take(score)])
