"""How deep a surface in space is in the other body at the start."""

import numpy as np

from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.bodies.mesh.simplices import boundary
from sparsemor.bodies.spatial.body import SpatialBody
from sparsemor.core.arrays import BoolArray, FloatArray

AT_ONCE = 2_000_000
"""Points times facets that are looked at together."""


def deepest(one: Surface, other: Surface, allowed: float) -> tuple[FloatArray, float] | None:
    """The point (3,) of `one` that is deepest inside the other body, and its depth, m; None where
    none is deeper than allowed."""
    z = placed(one.body, one.X)
    z = z[_in_box(other.body, z)]
    if not len(z):
        return None
    depth = nearest(z, placed(other.body, other.X)[other.facets]).distance
    z, depth = z[depth > allowed], depth[depth > allowed]  # `within` looks at every facet
    inside = within(other.body, z)
    if not inside.any():
        return None
    worst = int(np.argmax(np.where(inside, depth, -1.0)))
    return z[worst], float(depth[worst])


def placed(body: SpatialBody, X: FloatArray) -> FloatArray:
    """(n, 3) positions at the start of reference points X (n, 3), m."""
    return np.asarray(body.pose[:3] + X @ body.start_rotation().T)


def _in_box(body: SpatialBody, z: FloatArray) -> BoolArray:
    """(n,) which points in space are inside the box about the body in its own axes."""
    own = (z - body.pose[:3]) @ body.start_rotation()
    low, high = body.X.min(axis=0), body.X.max(axis=0)
    return np.asarray(((own > low) & (own < high)).all(axis=1))


def within(body: SpatialBody, z: FloatArray) -> BoolArray:
    """(n,) which points z (n, 3) in space are inside the undeformed body at the start: its surface
    fills their field of view (solid angle by Van Oosterom and Strackee, 10.1109/TBME.1983.325207).
    """
    assert body.mesh is not None
    corners = placed(body, body.X)[boundary(body.mesh)]
    angle = np.zeros(len(z))
    for part in np.array_split(np.arange(len(z)), 1 + len(z) * len(corners) // AT_ONCE):
        a, b, c = (corners[None, :, i] - z[part, None] for i in range(3))
        p, q, r = (np.linalg.norm(x, axis=2) for x in (a, b, c))
        over = p * q * r + (a * b).sum(-1) * r + (b * c).sum(-1) * p + (c * a).sum(-1) * q
        angle[part] = 2.0 * np.arctan2((a * np.cross(b, c)).sum(-1), over).sum(axis=1)
    return np.asarray(angle > 2.0 * np.pi)
