"""Closest-point projection onto a surface of segments (2-D) or triangles (3-D), and check of the
initial configuration for overlap of two bodies."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.contact.surface import Surface
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core import BoolArray, FloatArray, InputError, IntArray
from sparsemor.core.model.facets import linear_surface


@dataclass(frozen=True, slots=True, eq=False)
class ClosestPoints:
    """Closest points of n points on a surface: facet (n,); weights (n, d), barycentric coordinates
    in the facet; distance (n,), m."""

    facet: IntArray
    weights: FloatArray
    distance: FloatArray


def nearest(points: FloatArray, corners: FloatArray) -> ClosestPoints:
    """Closest point on a surface for each of points (n, d), m, d = 2 or 3; of facets at the same
    distance the one of lowest number.

    corners (F, d, d): corners of the facets, ordered for outward normals.

    Broad phase: a search tree over the facets' centroids. A facet whose centroid is farther than
    the distance to some facet plus the largest facet radius cannot be the nearest.
    """
    middles = corners.mean(axis=1)
    radius = float(np.linalg.norm(corners - middles[:, None], axis=2).max())
    tree = cKDTree(middles)
    _, first = tree.query(points)
    _, reach = closest_points(points, corners[first])
    found = tree.query_ball_point(points, reach + radius * (1.0 + 1e-12))
    count = np.array([len(f) for f in found])
    owner = np.repeat(np.arange(len(points)), count)
    facet = np.concatenate([np.asarray(f, np.int64) for f in found])
    weights, distance = closest_points(points[owner], corners[facet])
    order = np.lexsort((facet, distance, owner))
    best = order[np.searchsorted(owner[order], np.arange(len(points)))]
    return ClosestPoints(facet[best], weights[best], distance[best])


def closest_points(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closest point of facet i (corners[i] of (n, d, d)) to points[i] of (n, d): its barycentric
    coordinates (n, d) and its distance (n,), m."""
    d = points.shape[1]
    if d == 2:
        w = _on_segment(points, corners[:, 0], corners[:, 1])
        weights = np.stack([1.0 - w, w], axis=1)
    else:
        weights = _on_triangle(points, corners)
    at = (weights[:, :, None] * corners).sum(axis=1)
    return weights, np.asarray(np.linalg.norm(points - at, axis=1))


def _on_segment(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(n,) coordinate in [0, 1], from a to b, of the closest point on each segment."""
    along = b - a
    share = ((points - a) * along).sum(axis=1) / (along * along).sum(axis=1)
    return np.asarray(np.clip(share, 0.0, 1.0))


def _on_triangle(points: FloatArray, corners: FloatArray) -> FloatArray:
    """(n, 3) barycentric coordinates of the point of triangle i, corners (n, 3, 3), that is closest
    to points[i] (n, 3): the foot of the normal where it is inside, else the closest point of the
    three edges."""
    a, b, c = corners.transpose(1, 0, 2)
    p, q, r = b - a, c - a, points - a
    pp, qq, pq = (p * p).sum(axis=1), (q * q).sum(axis=1), (p * q).sum(axis=1)
    rp, rq = (r * p).sum(axis=1), (r * q).sum(axis=1)
    area = pp * qq - pq * pq
    foot = np.stack([(qq * rp - pq * rq) / area, (pp * rq - pq * rp) / area], axis=1)
    inner = np.concatenate([1.0 - foot.sum(axis=1, keepdims=True), foot], axis=1)
    options, far = [], []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        s = _on_segment(points, corners[:, i], corners[:, j])
        w = np.zeros_like(inner)
        w[:, i], w[:, j] = 1.0 - s, s
        options.append(w)
        at = (w[:, :, None] * corners).sum(axis=1)
        far.append(np.linalg.norm(points - at, axis=1))
    edge = np.stack(options)[np.argmin(np.stack(far), axis=0), np.arange(len(points))]
    return np.where(inner.min(axis=1, keepdims=True) >= 0, inner, edge)


OVERLAP = 0.1
"""Largest admissible initial penetration, as a fraction of the smallest facet of both surfaces."""
AT_ONCE = 2_000_000
"""Number of point-facet combinations evaluated together."""


def check_start(first: Surface, second: Surface) -> None:
    """Raises InputError (key `between`) if a node of either surface is inside the other body, in
    their initial poses, by more than `OVERLAP` times the shortest edge of all facets (`sizes`)."""
    size = float(min(first.sizes.min(), second.sizes.min()))
    for one, other in ((first, second), (second, first)):
        found = _deepest(one, other, OVERLAP * size)
        if found is None:
            continue
        place = ", ".join(f"{x:.6g}" for x in found[0])
        a, b = one.body.name, other.body.name
        raise InputError(
            f"bodies {a!r} and {b!r} overlap at the start: a point of {a!r} at ({place}) m is "
            f"{found[1]:.3g} m below the surface of {b!r}, more than {OVERLAP:g} of the smallest "
            f"facet ({size:.3g} m); correct a pose", "between")


def _deepest(one: Surface, other: Surface, allowed: float) -> tuple[FloatArray, float] | None:
    """Position in space (d,) of the node of `one` that is deepest inside the other body, m, and its
    distance from the other surface, m; None if none exceeds `allowed`, m."""
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


def placed(body: FloatingBody, X: FloatArray) -> FloatArray:
    """(n, d) initial positions in space of reference points X (n, d), m."""
    return np.asarray(body.pose[: X.shape[1]] + X @ body.start_rotation().T)


def _in_box(body: FloatingBody, z: FloatArray) -> BoolArray:
    """(n,) True for points z (n, d) in space that are inside the body's bounding box, aligned with
    the body axes."""
    X = body.X
    own = (z - body.pose[: z.shape[1]]) @ body.start_rotation()
    return np.asarray(((own > X.min(axis=0)) & (own < X.max(axis=0))).all(axis=1))


def within(body: FloatingBody, z: FloatArray) -> BoolArray:
    """(n,) True for points z (n, d) in space inside the undeformed body in its initial pose: its
    boundary subtends the full (solid) angle there."""
    assert body.mesh is not None
    corners = placed(body, body.X)[linear_surface(body.mesh.nodes, body.d)]
    share = np.zeros(len(z))
    for part in np.array_split(np.arange(len(z)), 1 + len(z) * len(corners) // AT_ONCE):
        share[part] = _view(corners[None] - z[part, None, None]).sum(axis=1)
    return np.asarray(share > 0.5)


def _view(rays: FloatArray) -> FloatArray:
    """(n, F) signed fraction of the full angle that each facet subtends, from the vectors `rays`
    (n, F, d, d) to its corners.

    Angle over 2 pi in the plane, solid angle over 4 pi in space, which is 2 arctan2(...) (Van
    Oosterom and Strackee, 10.1109/TBME.1983.325207). Positive where the point is behind the facet;
    the sum over a closed surface is 1 inside and 0 outside.
    """
    if rays.shape[3] == 2:
        a, b = rays[:, :, 0], rays[:, :, 1]
        across = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        return np.asarray(np.arctan2(across, (a * b).sum(-1)) / (2.0 * np.pi))
    a, b, c = (rays[:, :, i] for i in range(3))
    p, q, r = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    over = p * q * r + (a * b).sum(-1) * r + (b * c).sum(-1) * p + (c * a).sum(-1) * q
    return np.asarray(np.arctan2((a * np.cross(b, c)).sum(-1), over) / (2.0 * np.pi))
