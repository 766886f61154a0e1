"""Check for tunnelling: a time step that moved a surface through the other one, which the forces at
its end do not reveal."""

import numpy as np

from sparsemor.bodies.contact.broad_phase import BroadPhase
from sparsemor.bodies.contact.kinematics import Kinematics
from sparsemor.bodies.contact.surface import Planes, Surface, tree_of
from sparsemor.core import FloatArray, IntArray


def too_deep(
    first: Surface, second: Surface, now: Kinematics, h: float, reach: float, near: BroadPhase
) -> float:
    """Largest depth (m) of a node of the first surface below the second, if it exceeds `reach` (m)
    and did not one step of h (s) before; else 0.

    Before a step in which it crosses a facet, a node is no farther from the facet than the distance
    that both move in the step.
    """
    before, facing = now.a - h * now.va, now.b - h * now.vb
    deforms = now.sizes.u2 > 0
    speed = float(np.linalg.norm(now.va, axis=1).max())
    if deforms:
        speed += float(np.linalg.norm(now.vb, axis=1).max())
    tree = tree_of(facing, second.facets) if deforms else second.tree
    found = tree.query(before, k=np.arange(1, min(4 * near.most, tree.n) + 1),
                       distance_upper_bound=second.radius + reach + h * speed)[1]
    node, rank = np.nonzero(found < tree.n)
    facet = found[node, rank]
    depth = _depth(now.a[node], now.b if deforms else None, second, facet)
    deep = np.flatnonzero(depth > reach)
    if not len(deep):
        return 0.0
    was = _depth(before[node[deep]], facing if deforms else None, second, facet[deep])
    return float(depth[deep[(was <= reach) & (was > -np.inf)]].max(initial=0.0))


def _depth(
    z: FloatArray, points: FloatArray | None, surface: Surface, facet: IntArray
) -> FloatArray:
    """(m,) depth, m, of points z (m, d) below the facets `facet` (m,); -inf outside the facet's
    cell.

    points: current node positions of the surface, None if it does not deform.
    """
    if points is None:
        planes, cells = surface.planes.some(facet), surface.cells.some(facet)
    else:
        planes = Planes.of(points[surface.facets[facet]])
        cells = surface.cells_at(facet, planes)
    rel = (z - planes.corner)[:, :, None]
    depth = -(planes.n[:, None] @ rel)[:, 0, 0]
    eta = (planes.g @ rel)[:, :, 0]
    eta[:, 0] += 1.0
    borders = cells.values(eta[:, None], depth[:, None])
    inside = (borders >= 0).all(axis=(1, 2))
    return np.where(inside, depth, -np.inf)
