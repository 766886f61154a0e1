"""Whether a step took a surface through the other one, which the forces at its end cannot show."""

from typing import Any

import numpy as np

from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.side import Points
from sparsemor.bodies.contact.surface import Surface, plane, tree_of
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import FloatArray, IntArray


def too_deep(
    first: Surface, second: Surface, a: Points, b: Points, h: float, reach: float, near: Near
) -> float:
    """How far (m) a point of the first surface is below the second, where that is more than
    `reach` and was not so a step of h (s) before; else 0.

    A point that crosses a facet within the step was no farther from it before than both moved.
    """
    before, facing = a.z - h * a.rate, b.z - h * b.rate
    moved = h * float(np.abs(a.rate).max() + np.abs(b.rate).max())
    if not np.isfinite(moved):
        return 0.0
    tree = tree_of(facing, second.facets)
    found = tree.query(plane(before), k=np.arange(1, min(4 * near.most, tree.n) + 1),
                       distance_upper_bound=second.radius + reach + moved)[1]
    node, rank = np.nonzero(found < tree.n)
    facet = found[node, rank]
    was, is_in = _seen(before[node], facing, second, facet), _seen(a.z[node], b.z, second, facet)
    deep = (is_in > reach) & (was <= reach) & (was > -np.inf)
    return float(is_in[deep].max(initial=0.0))


def _seen(z: ComplexArray, corners: ComplexArray, surface: Surface, facet: IntArray) -> FloatArray:
    """(m,) depth of points below their facets, m; -inf outside the facet's cell."""
    ends = corners[surface.facets[facet]]
    e: Any = ends[:, 1] - ends[:, 0]
    zeta = (z - ends[:, 0]) / e
    turn = surface.turns[facet]
    inside = (zeta.real >= turn[:, 0] * zeta.imag) & (
        zeta.real <= 1.0 - turn[:, 1] * zeta.imag)
    return np.where(inside, np.abs(e) * zeta.imag, -np.inf)
