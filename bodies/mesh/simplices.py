"""Measures and gradients of linear simplices, in 2-D and 3-D."""

from math import factorial

import numpy as np

from sparsemor.core import FloatArray, IntArray, Mesh


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
