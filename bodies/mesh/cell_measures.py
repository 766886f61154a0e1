"""Measures of cells, in 2-D and 3-D."""

from math import factorial

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.core.model.facets import SIMPLICES
from sparsemor.core.protocols.cells import KINDS, by_kind, padded


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


def corner_measures(points: FloatArray, cells: IntArray) -> FloatArray:
    """(E, j) measure, m2 or m3, of the simplex of the edges that meet at each corner of a cell, of
    a simplex at one; all positive for a positively oriented cell that is not folded over."""
    d = points.shape[1]
    kinds = by_kind(cells, d)
    return np.asarray(padded([np.linalg.det(edge_vectors(points, own[:, np.array(
        KINDS[d, own.shape[1]].turns)].reshape(-1, d + 1))).reshape(len(own), -1) / factorial(d)
        for _, own in kinds], [here for here, _ in kinds]))


def triangulated(facets: IntArray) -> IntArray:
    """Segments or triangles (S, d) between the corners of facets (F, w)."""
    if facets.shape[1] < 4:
        return facets
    found = facets[:, np.array(SIMPLICES[4, False])].reshape(-1, 3)
    return np.asarray(found[(np.diff(np.sort(found, axis=1), axis=1) > 0).all(axis=1)])
