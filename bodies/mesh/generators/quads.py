"""Structured blocks of quadrilaterals, and their subdivision into triangles."""

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray


def grid_quads(numbers: IntArray) -> IntArray:
    """Corners (Q, 4) of the quads of a grid of point numbers (I + 1, J + 1), row by row.

    The corners run (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1): counter-clockwise when i, j
    point along right-handed directions.
    """
    corners = (numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:])
    return np.stack([c.ravel() for c in corners], axis=1)


def split_quads(quads: IntArray, main: BoolArray) -> IntArray:
    """Triangles (2 Q, 3), two per quad: split along corners 0-2 where `main` (Q,), else along 1-3.
    """
    along_02 = quads[:, [0, 1, 2, 0, 2, 3]]
    along_13 = quads[:, [0, 1, 3, 1, 2, 3]]
    return np.where(main[:, None], along_02, along_13).reshape(-1, 3)


def shorter_diagonal(points: FloatArray, quads: IntArray, ties: BoolArray) -> BoolArray:
    """(Q,) True where diagonal 0-2 is the shorter one; `ties` (Q,) decides equal lengths.

    Lengths within 1e-9 of each other are equal, so that round-off has no influence.
    """
    first = np.linalg.norm(points[quads[:, 0]] - points[quads[:, 2]], axis=1)
    second = np.linalg.norm(points[quads[:, 1]] - points[quads[:, 3]], axis=1)
    equal = np.abs(first - second) <= 1e-9 * (first + second)
    return np.where(equal, ties, first < second)


def checkerboard(columns: int, rows: int) -> BoolArray:
    """(columns * rows,) True for quads with even i + j, in the order of `grid_quads`."""
    i, j = np.indices((columns, rows))
    return np.asarray((i + j) % 2 == 0).ravel()
