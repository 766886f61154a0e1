"""Nested dissection by node positions: elimination order and number of entries of the factors."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray
from sparsemor.core.protocols.linear_solver import DofLocations

LEAF = 8
"""Number of nodes up to which a subdomain is not divided further: its factor is counted as
dense."""


@dataclass(frozen=True, slots=True, eq=False)
class Dissection:
    """Elimination order of the unknowns, and number of entries of the Cholesky factor.

    order (n,): unknowns in the order of their elimination; entries: of the factor in this order,
    known before the factorization.
    """

    order: IntArray
    entries: int


def dissect(A: Csr, places: DofLocations) -> Dissection:
    """Nested dissection of A (n, n): subdomains are bisected, separators are eliminated last.

    Each subdomain is cut in two equal halves across the axis where the separator is smallest
    (George 1973, doi 10.1137/0710032). A separator of s unknowns whose subdomain touches b unknowns
    of earlier separators fills s (s + 1) / 2 + s b entries. In 3-D that is up to half of what
    minimum degree fills.
    """
    node = node_numbers(places)
    # first unknown of each node; edges between nodes as numbers, node * count + other node
    first = np.flatnonzero(np.diff(node, prepend=-1))
    pattern = A.tocoo()
    i, j = node[pattern.row], node[pattern.col]
    pairs = np.unique(i[i != j] * np.int64(len(first)) + j[i != j])
    cuts = _Cuts(places.coordinates[first], np.bincount(node).astype(np.float64),
                 pairs // max(len(first), 1), pairs % max(len(first), 1))
    position, entries = cuts.run()
    return Dissection(np.argsort(position[node], kind="stable"), int(entries))


def factor_entries(A: Csr, places: DofLocations | None) -> int:
    """Number of entries of the Cholesky factor of A; without positions of the unknowns, a
    conservative estimate for a compact body."""
    if places is not None:
        return dissect(A, places).entries
    n = A.shape[0]
    return int(min(n * (n + 1) / 2, 2 * n**1.6))


def node_numbers(places: DofLocations) -> IntArray:
    """Node number (n,) of each unknown, from 0: unknowns of one node follow each other with
    increasing component."""
    new = np.ones(len(places.component), dtype=np.bool_)
    new[1:] = (np.diff(places.component) <= 0) | np.any(
        np.diff(places.coordinates, axis=0) != 0.0, axis=1)
    return np.asarray(np.cumsum(new) - 1)


@dataclass(frozen=True, slots=True, eq=False)
class _Cuts:
    """Nested dissection of the graph of nodes, all subdomains of one level at once.

    X (N, d): positions; weight (N,): number of unknowns of each node; (i, j): edges of the graph,
    in both directions.
    """

    X: FloatArray
    weight: FloatArray
    i: IntArray
    j: IntArray

    def run(self) -> tuple[IntArray, float]:
        """Position (N,) of each node in the elimination order, and the number of entries of the
        factor."""
        n = len(self.X)
        part = np.zeros(n, dtype=np.int64)  # number of a node's part, -1 once it has a place
        # base: first of the places of each part
        place, base, entries = np.zeros(n, dtype=np.int64), np.zeros(1, dtype=np.int64), 0.0
        while (part >= 0).any():
            parts = len(base)
            side, cut = self._cut(part, parts)
            s = np.bincount(part[cut], self.weight[cut], parts)
            # a separator's columns are dense: in itself, and in the earlier separators around it
            entries += float(np.sum(s * (s + 1) / 2 + s * self._border(part, parts)))
            half = np.where(cut | (part < 0), -1, 2 * part + side)
            sizes = np.bincount(half[half >= 0], minlength=2 * parts).reshape(parts, 2)
            # of a part's places the lower half gets the first, its separator the last
            place[cut] = (base + sizes.sum(axis=1))[part[cut]] + _rank(part[cut], parts)
            base = np.stack([base, base + sizes[:, 0]], axis=1).ravel()[sizes.ravel() > 0]
            part = _renumbered(half)
        return place, entries

    def _cut(self, part: IntArray, parts: int) -> tuple[BoolArray, BoolArray]:
        """Masks (N,) of the nodes in the upper half of their subdomain, and of the nodes of
        separators. part (N,): number of each node's subdomain, -1 for none; parts: how many.

        Each subdomain is bisected along the axis, and with the separator on the side, that gives
        the fewest separating unknowns; subdomains of at most `LEAF` nodes become separators as a
        whole.
        """
        inside = part >= 0
        least = np.full(parts, np.inf)
        side, cut = np.zeros((2, len(part)), dtype=np.bool_)
        for axis in range(self.X.shape[1]):
            upper = self._upper(part, parts, axis)
            # edges between nodes i and j of one subdomain that the cut divides
            across = (part[self.i] >= 0) & (part[self.i] == part[self.j]) & (
                upper[self.i] != upper[self.j])
            touching = np.zeros(len(part), dtype=np.bool_)
            # nodes with an edge across the cut, of either half alone, separate the halves
            touching[self.i[across]] = True
            for separator in (touching & ~upper, touching & upper):
                count = np.bincount(part[separator], self.weight[separator], parts)
                better = inside & (count < least)[part]
                side[better], cut[better] = upper[better], separator[better]
                least = np.minimum(least, count)
        small = np.bincount(part[inside], minlength=parts) <= LEAF
        return side, cut | (inside & small[part])

    def _upper(self, part: IntArray, parts: int, axis: int) -> BoolArray:
        """Mask (N,) of the nodes in the upper half of their subdomain along an axis."""
        inside = np.flatnonzero(part >= 0)
        order = inside[np.lexsort((self.X[inside, axis], part[inside]))]
        counts = np.bincount(part[inside], minlength=parts)
        upper = np.zeros(len(part), dtype=np.bool_)
        upper[order] = _rank(part[order], parts) >= counts[part[order]] // 2
        return upper

    def _border(self, part: IntArray, parts: int) -> FloatArray:
        """Number (parts,) of unknowns of earlier separators that are connected to each
        subdomain."""
        out = (part[self.i] >= 0) & (part[self.j] < 0)
        n = np.int64(len(part))
        touching = np.unique(part[self.i[out]] * n + self.j[out])
        found = np.bincount(touching // n, self.weight[touching % n], parts)
        return np.asarray(found, dtype=np.float64)


def _rank(groups: IntArray, parts: int) -> IntArray:
    """Rank (k,) of each entry within its group: the number of earlier entries of the same group."""
    order = np.argsort(groups, kind="stable")
    counts = np.bincount(groups, minlength=parts)
    rank = np.empty(len(groups), dtype=np.int64)
    rank[order] = np.arange(len(groups)) - np.repeat(np.cumsum(counts) - counts, counts)
    return rank


def _renumbered(part: IntArray) -> IntArray:
    """Subdomain numbers (N,) from 0 without gaps; -1 stays."""
    inside = part >= 0
    fresh = part.copy()
    fresh[inside] = np.unique(part[inside], return_inverse=True)[1]
    return fresh
