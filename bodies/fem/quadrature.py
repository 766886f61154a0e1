"""Shape functions at the quadrature points of cells or boundary facets, from a scikit-fem basis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sparsemor.core import FloatArray, IntArray, Mesh

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


def from_basis(basis: Any, gradients: bool = True) -> Quadrature:
    """Quadrature of a scikit-fem `Basis` or `FacetBasis` of any scalar element.

    gradients: False for laws without gradients; on facets, nodes whose shape functions vanish there
    are then left out.
    """
    nodes = basis.element_dofs.T.astype(np.int64)
    values = np.stack([np.asarray(b[0]) for b in basis.basis], axis=1)  # (E, n, Q)
    slopes = np.stack([np.asarray(b[0].grad) for b in basis.basis], axis=1) if gradients else None
    if slopes is None:
        nodes, values = _without_vanishing(nodes, values)
    else:
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


def _without_vanishing(nodes: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Nodes (E, m) and values (E, m, Q) without shape functions that vanish at all points of an
    element; unchanged where their number differs between elements."""
    acts = np.abs(values).max(axis=2) > EQUAL
    count = np.unique(acts.sum(axis=1))
    if len(count) != 1 or count[0] == nodes.shape[1]:
        return nodes, values
    at = np.argsort(~acts, axis=1, kind="stable")[:, : count[0]]
    return np.take_along_axis(nodes, at, 1), np.take_along_axis(values, at[:, :, None], 1)


def on_cells(
    mesh: Mesh, degree: int, cells: IntArray | None = None, *, gradients: bool = True,
    at_nodes: bool = False, positive: bool = False,
) -> Quadrature:
    """Quadrature of the cells of a mesh (all, or those with the given numbers), exact for
    polynomials of this degree. at_nodes: points at the nodes with equal weights, as for lumped
    matrices; positive: without negative weights."""
    from sparsemor.bodies.fem import forms

    return from_basis(forms.cell_basis(mesh, degree, cells, at_nodes, positive), gradients)


def on_facets(
    mesh: Mesh, facets: IntArray, degree: int, *, gradients: bool = False
) -> Quadrature:
    """Quadrature of boundary facets (F, d) of point numbers, in their order, exact for polynomials
    of this degree."""
    from sparsemor.bodies.fem import forms

    return from_basis(forms.facet_basis(mesh, facets, degree), gradients)
