"""Measures of simplices and gradients of their shape functions, in 2-D and 3-D."""

from math import factorial

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray, Mesh
from sparsemor.core.model.facets import group_equal_rows

EDGES = np.array([[0, 1, 0, 0, 1, 2], [1, 2, 2, 3, 3, 3]])
"""Local corners of the edges of a simplex, in the order of midpoints; a triangle has the first
three."""


def edge_vectors(points: FloatArray, cells: IntArray) -> FloatArray:
    """(E, d, d) edge vectors of each cell, m: row i runs from its corner 0 to its corner i + 1."""
    return np.asarray(points[cells[:, 1:]] - points[cells[:, :1]])


def signed_measures(points: FloatArray, cells: IntArray) -> FloatArray:
    """(E,) area (m2) or volume (m3) of each cell; negative for inverted cells."""
    return np.asarray(np.linalg.det(edge_vectors(points, cells)) / factorial(points.shape[1]))


def longest_edges(points: FloatArray, cells: IntArray) -> FloatArray:
    """(E,) length of each cell's longest edge, m."""
    first, second = np.triu_indices(cells.shape[1], 1)
    edges = points[cells[:, first]] - points[cells[:, second]]
    return np.asarray(np.linalg.norm(edges, axis=2).max(axis=1))


def gradients(mesh: Mesh) -> FloatArray:
    """(E, d + 1, d) gradient of each corner's linear shape function, 1/m, constant in a cell."""
    inner = np.linalg.inv(edge_vectors(mesh.points, mesh.cells)).transpose(0, 2, 1)
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)


def rows_among(rows: IntArray, others: IntArray) -> BoolArray:
    """(R,) True for the rows of an integer array (R, 2 to 4), entries >= 0, whose numbers are those
    of one of the rows of another, in any order."""
    number, _, _ = group_equal_rows(np.sort(np.concatenate([others, rows]), axis=1))
    return np.isin(number[len(others):], number[:len(others)])
