"""Orientation of cells: those with negative volume are renumbered."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.mesh.check import some
from sparsemor.bodies.mesh.simplices import corner_measures
from sparsemor.core import FloatArray, InputError, IntArray
from sparsemor.core.model.facets import cell_facets, facet_numbers
from sparsemor.core.protocols.cells import by_kind, padded

TURNED: Mapping[tuple[int, int], list[int]] = {
    (2, 3): [0, 2, 1], (2, 4): [0, 3, 2, 1], (3, 4): [0, 1, 3, 2], (3, 6): [3, 4, 5, 0, 1, 2],
    (3, 8): [4, 5, 6, 7, 0, 1, 2, 3]}
"""Corners of inverted cells in positive orientation, by dimension and number of corners."""


def oriented(points: FloatArray, cells: IntArray) -> IntArray:
    """Cells in positive orientation: mesh generators write each surface in its own. InputError
    where cells lie on one side of a facet that they share, so that they overlap."""
    inverted = np.asarray((corner_measures(points, cells) < 0).all(axis=1))
    d, kinds = points.shape[1], by_kind(cells, points.shape[1])
    turned = np.asarray(padded(
        [np.where(inverted[here][:, None], own[:, TURNED[d, own.shape[1]]], own)
         for here, own in kinds], [here for here, _ in kinds]))
    if inverted.all() or not inverted.any():
        return turned
    facets, owner = cell_facets(turned, d)
    number, _ = facet_numbers(facets)
    first = facets.argmin(axis=1)
    before, after = (facets[np.arange(len(facets)), (first + k) % facets.shape[1]]
                     for k in (-1, 1))
    ahead = after < before if facets.shape[1] > 2 else first == 0
    if facets.shape[1] == 4:  # of three corners the last is repeated
        three = facets[:, 2] == facets[:, 3]
        a, b, c = facets[three, :3].T
        ahead[three] = (a < b) ^ (b < c) ^ (a < c)
    total = np.bincount(number, weights=np.where(ahead, 1.0, -1.0))
    folded = np.unique(owner[np.abs(total[number]) > 1])
    if folded.size:
        bad = np.intersect1d(folded, np.flatnonzero(inverted))
        raise InputError(
            f"{len(bad)} of {len(cells)} cells are inverted and overlap their neighbours: "
            f"{some(bad)}; repair the mesh")
    return turned
