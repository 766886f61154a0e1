"""Shape functions at the quadrature points of cells or boundary facets, from a scikit-fem basis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sparsemor.core import FloatArray, IntArray

EQUAL = 1e-12
"""Largest difference of shape functions or gradients, relative to their size, at which they count
as equal, and largest value at which a shape function vanishes on a facet."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFunctions:
    """Scalar shape functions of E elements with n nodes each, at Q quadrature points.

    nodes (E, n): node numbers. values (E, n, Q), or (1, n, Q) where all elements have the same.
    gradients (E, n, d, Q), 1/m, or (E, n, d, 1) where they are constant in each element; None where
    no law needs them.
    """

    nodes: IntArray
    values: FloatArray
    gradients: FloatArray | None

    def part(self, elements: IntArray) -> ShapeFunctions:
        """Shape functions of some of the elements."""
        return ShapeFunctions(
            self.nodes[elements],
            self.values if len(self.values) == 1 else self.values[elements],
            None if self.gradients is None else self.gradients[elements])

    def renumbered(self, used: IntArray) -> ShapeFunctions:
        """The shape functions with node numbers replaced by their positions in `used`, sorted."""
        return replace(self, nodes=np.searchsorted(used, self.nodes))

    def along(self, axis: int | None) -> FloatArray:
        """Shape functions (E or 1, n, Q), or for an axis their derivatives (E, n, Q or 1)."""
        if axis is None:
            return self.values
        assert self.gradients is not None
        return self.gradients[:, :, axis]


@dataclass(frozen=True, slots=True, eq=False)
class Quadrature:
    """Quadrature points of E elements: shape functions, weights (E, Q), m2 or m3 (or m of an edge),
    and coordinates (d, E, Q), m."""

    shape: ShapeFunctions
    weights: FloatArray
    coordinates: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Quadrature], order: IntArray) -> Quadrature:
        """Quadrature of the elements of all parts, which have as many nodes and points, in the
        given order (E,): element i is number order[i] of the parts one after the other. Shape
        functions are kept once if all are equal; constant gradients (one point) are repeated next
        to others."""
        values = [q.shape.values for q in parts]
        same = all(len(v) == 1 and np.abs(v - values[0]).max() <= EQUAL for v in values)
        steep = [q.shape.gradients for q in parts if q.shape.gradients is not None]
        wide = max((g.shape[3] for g in steep), default=0)
        return cls(
            ShapeFunctions(
                np.concatenate([q.shape.nodes for q in parts])[order],
                values[0] if same else np.concatenate([np.broadcast_to(
                    q.shape.values, (len(q.weights), *q.shape.values.shape[1:]))
                    for q in parts])[order],
                np.concatenate([np.broadcast_to(g, (*g.shape[:3], wide)) for g in steep])[order]
                if steep else None),
            np.concatenate([q.weights for q in parts])[order],
            np.concatenate([q.coordinates for q in parts], axis=1)[:, order])


def from_basis(basis: Any, gradients: bool = True) -> Quadrature:
    """Quadrature of a scikit-fem `Basis` of any scalar element; gradients: False for laws without
    gradients. Equal shape functions of all cells are kept once (1, n, Q), gradients that are
    constant in each cell at one point (E, n, d, 1)."""
    nodes = basis.element_dofs.T.astype(np.int64)
    values = np.stack([np.asarray(b[0]) for b in basis.basis], axis=1)  # (E, n, Q)
    slopes = np.stack([np.asarray(b[0].grad) for b in basis.basis], axis=1) if gradients else None
    if slopes is not None:
        slopes = slopes.transpose(2, 1, 0, 3)  # (d, n, E, Q)
        size = np.abs(slopes).max(initial=0.0)
        if np.ptp(slopes, axis=3).max(initial=0.0) <= EQUAL * size:
            slopes = slopes[..., :1]
    if len(values) and np.ptp(values, axis=0).max() <= EQUAL:
        values = values[:1]
    return Quadrature(
        ShapeFunctions(nodes, np.ascontiguousarray(values), None if slopes is None else
                       np.ascontiguousarray(slopes)),
        np.array(basis.dx), np.array(basis.global_coordinates()))
