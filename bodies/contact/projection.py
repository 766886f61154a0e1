"""Closest-point projection onto a surface of segments (2-D) or triangles (3-D)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.core import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ClosestPoints:
    """Closest points of n points on a surface: facet (n,); weights (n, d), barycentric coordinates
    in the facet; distance (n,), m."""

    facet: IntArray
    weights: FloatArray
    distance: FloatArray


def nearest(points: FloatArray, corners: FloatArray) -> ClosestPoints:
    """Closest point on a surface for each of points (n, d), d = 2 or 3.

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
    """(n, 3) barycentric coordinates of the closest point of each triangle: the foot of the normal
    where it is inside, else the closest point of the three edges."""
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
