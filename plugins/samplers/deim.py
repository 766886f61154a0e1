"""Discrete empirical interpolation points, greedy or by pivoted QR, and GappyPOD+E beyond them."""

from typing import Literal

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.plugins.samplers.candidates import Rows
from sparsemor.plugins.samplers.factor import EPS, RowFactor
from sparsemor.plugins.samplers.span import SpanSampler


class Deim(SpanSampler):
    """As many interpolation points as independent atoms; further rows by GappyPOD+E.

    Points: Chaturantabut and Sorensen 2010, doi 10.1137/090766498 (`greedy`); Drmac and Gugercin
    2016, doi 10.1137/15M1019271 (`qr`, Q-DEIM). Oversampling: Peherstorfer, Drmac and Gugercin
    2020, doi 10.1137/19M1307391. Nothing is drawn: the seed has no effect.
    """

    method: Literal["qr", "greedy"] = "qr"
    """`qr` takes the pivots of a column-pivoted QR of the vectors' transpose, whatever their order;
    `greedy` takes one row a vector, where interpolation by the vectors before it is worst."""

    def choose(self, U: FloatArray, rows: Rows, rng: np.random.Generator) -> None:
        if self.method == "greedy":
            interpolation_points(U, rows)
        pivots(U, rows)
        raise_smallest(U, rows)


def pivots(U: FloatArray, rows: Rows) -> None:
    """Rows of U (n, k) with the largest part that the rows taken do not span, until they span all.

    From no rows these are the pivots of LAPACK's column-pivoted QR of U^T. What required rows
    span is taken away first, so that no pivot repeats them.
    """
    _, V, rank = RowFactor(U[rows.taken]).singular(U.shape[1])
    rest = U @ V[:, rank:]
    unspanned = rest.shape[1]
    while rows.left and unspanned > 0:
        for i in rows.take(np.einsum("ij,ij->i", rest, rest)):
            size = np.linalg.norm(rest[i])
            if unspanned and size > 0.0:
                direction = rest[i] / size
                rest = rest - np.outer(rest @ direction, direction)
                unspanned -= 1
        if not rest.any():
            break


def interpolation_points(U: FloatArray, rows: Rows) -> None:
    """DEIM's greedy rule on the columns of U (n, k) in their order.

    With p rows taken, the next one is where column p + 1 is fitted worst by the p columns before
    it. Required rows, and all rows of a node, thus stand for as many points of the first columns.
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


def raise_smallest(U: FloatArray, rows: Rows) -> None:
    """GappyPOD+E: the row that raises the smallest singular value of the sampled U (n, k) most.

    Score: what the row u adds to s_k^2 at least, times 2, with the two smallest singular values
    s_k <= s_{k-1}, the right vector w of s_k and g = s_{k-1}^2 - s_k^2:
    g + |u|^2 - sqrt((g + |u|^2)^2 - 4 g (u w)^2)  (bound of Ipsen and Nadler 2009).
    """
    k = U.shape[1]
    factor = RowFactor(U[rows.taken])
    length = np.einsum("ij,ij->i", U, U)
    while rows.left:
        s, V, _ = factor.singular(k)
        least = np.append(s, np.zeros(k - s.size))[-2:] ** 2
        g, along = least[0] - least[-1], (U @ V[:, -1]) ** 2
        score = along  # what counts when only one value is smallest, or two are alike
        if g > EPS * least[0]:
            # a - sqrt(a^2 - b) as b / (a + sqrt(a^2 - b)): no difference of nearly equal numbers
            a, b = g + length, 4.0 * g * along
            score = b / (a + np.sqrt(np.maximum(a * a - b, 0.0)))
        factor.add(U[rows.take(score)])
