"""Extrusion of a plane triangulation in layers of prisms, three tetrahedra per prism."""

import numpy as np

from sparsemor.core import FloatArray, IntArray, MeshSize


def extrude(
    points: FloatArray, triangles: IntArray, heights: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Points ((L + 1) N, 3), m, and positively oriented tetrahedra (3 L T, 4) of an extruded
    triangulation.

    points (N, 2), m; triangles (T, 3), counter-clockwise; heights (L + 1,), m, ascending: z of the
    layers' faces. Point i of face k has number k N + i. Each lateral quadrilateral is split from
    the lower point of smaller to the upper point of larger rank, so that neighbours agree
    (Dompierre et al. 1999, "How to subdivide pyramids, prisms and hexahedra into tetrahedra").
    Ranks are a fixed random permutation: point numbers increase along the rows of a triangulation,
    and with ranks by number all diagonals would have similar directions. The hottest point of the
    coarse brake disk would then be at 406 K; it is at 424 K with permuted ranks, and at 426 to 431
    K on meshes of 290 thousand tetrahedra of either kind.
    """
    n, layers = len(points), len(heights) - 1
    rank = np.random.default_rng(0).permutation(n)[triangles]
    plan = np.tile(points, (layers + 1, 1))
    solid = np.column_stack([plan, np.repeat(heights, n)])
    a, b, c = np.take_along_axis(triangles, np.argsort(rank, axis=1), axis=1).T
    prism = np.stack([a, b, c, c + n, a, b, c + n, b + n, a, a + n, b + n, c + n], axis=1)
    # sorting turned some triangles over: exchange two corners of all three tetrahedra there
    odd = _is_odd(rank)
    prism[odd] = prism[odd][:, [0, 2, 1, 3, 4, 6, 5, 7, 8, 10, 9, 11]]
    cells = prism[None] + n * np.arange(layers)[:, None, None]
    return solid, cells.reshape(-1, 4)


def _is_odd(rank: IntArray) -> IntArray:
    """Numbers of the triangles (ranks (T, 3)) whose sorting by rank is an odd permutation."""
    a, b, c = rank.T
    exchanges = (a > b).astype(np.int64) + (a > c) + (b > c)
    return np.flatnonzero(exchanges % 2 == 1)


def extruded(outline: int, triangles: int, layers: int) -> MeshSize:
    """Size of the mesh of an extruded triangulation with given numbers of points on its outline,
    triangles and layers."""
    return MeshSize((layers + 1) * (triangles + 2 + outline) // 2, 3 * triangles * layers, 3)
