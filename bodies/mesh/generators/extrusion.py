"""Triangulation of the interior of a closed outline by a prescribed number of triangles of similar
size, and its extrusion in layers of prisms, three tetrahedra per prism.

A triangulation of a simply connected region with N points, B of them on the outline, has T = 2 N -
2 - B triangles: with given B and N the number is exact for any smoothing.
"""

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from sparsemor.bodies.mesh.cell_measures import signed_measures
from sparsemor.core import BoolArray, FloatArray, InputError, IntArray, MeshSize

ROUNDS = 10
"""Number of smoothing iterations: more of them change the worst triangle's quality by 2 % at most.
"""


def interior_points(triangles: int, outline: int) -> int:
    """Number of interior points for a given number of triangles; InputError if it is not a
    nonnegative integer."""
    twice = triangles + 2 - outline
    if twice % 2 or twice < 0:
        least = outline - 2
        raise InputError(
            f"{triangles} triangles cannot be made with {outline} points on the outline: the "
            f"number must be at least {least} and, like it, {'odd' if outline % 2 else 'even'}; "
            f"take {max(least, triangles + 1)}", "triangles")
    return twice // 2


def plan_mesh(
    outline: FloatArray, triangles: int, fixed: FloatArray | None = None, rounds: int = ROUNDS
) -> tuple[FloatArray, IntArray]:
    """Deterministic triangulation: points (N, 2), m, and counter-clockwise triangles (T, 3).

    outline (B, 2): a closed polygon without crossings, counter-clockwise, its points at about equal
    distances; fixed (f, 2): interior points that must be nodes. Order of the points: outline,
    fixed, others, which are moved to the centroids of their triangles `rounds` times. InputError
    when the outline is too coarse.
    """
    B = len(outline)
    held = np.zeros((0, 2)) if fixed is None else np.asarray(fixed, dtype=np.float64)
    inner = _with_fixed(_lattice(outline, interior_points(triangles, B)), held)
    points = np.concatenate([outline, inner])
    first = B + len(held)
    for _ in range(rounds):
        points[first:] = _centred(points, _triangulate(points, outline))[first:]
    cells = _triangulate(points, outline)
    if len(cells) != triangles:
        raise InputError(
            f"{len(cells)} triangles were made, not {triangles}: the outline of {B} points is too "
            "coarse for its corners, or too fine for so few triangles", "triangles")
    return points, cells


def inside(points: FloatArray, outline: FloatArray) -> BoolArray:
    """(n,) True for points (n, 2) inside a polygon (B, 2), by crossings of a ray to the right."""
    x, y = points[:, :1], points[:, 1:]
    (x0, y0), (x1, y1) = outline.T, np.roll(outline, -1, axis=0).T
    spans = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.asarray((spans & (x < crossing)).sum(axis=1) % 2 == 1)


def polygon_area(outline: FloatArray) -> float:
    """Signed area of a polygon (B, 2), m2: positive if counter-clockwise."""
    (x, y), (x1, y1) = outline.T, np.roll(outline, -1, axis=0).T
    return float(np.sum(x * y1 - x1 * y) / 2)


def _lattice(outline: FloatArray, count: int) -> FloatArray:
    """(count, 2) points of a triangular lattice inside the outline (B, 2), at least 0.6 times its
    spacing away from it; the widest lattice that has so many, in steps of half a percent."""
    if count == 0:
        return np.zeros((0, 2))
    sides = np.roll(outline, -1, axis=0) - outline
    border = cKDTree(np.concatenate([outline + s * sides for s in np.linspace(0, 1, 8)[:-1]]))
    # one lattice point a cell of area sqrt(3)/2 spacing^2; a finer lattice holds more of them
    spacing = float(np.sqrt(polygon_area(outline) / count * 2 / np.sqrt(3)))
    while True:
        grid = _triangular(outline.min(axis=0), outline.max(axis=0), spacing)
        away, _ = border.query(grid, distance_upper_bound=0.6 * spacing)
        grid = grid[np.isinf(away)]
        grid = grid[inside(grid, outline)]
        if len(grid) >= count:
            break
        spacing *= 0.995
    # what is too many goes where the smoothing closes the gap: evenly over the region
    return np.asarray(grid[np.linspace(0, len(grid) - 1, count).round().astype(np.int64)])


def _triangular(low: FloatArray, high: FloatArray, spacing: float) -> FloatArray:
    """Points of a triangular lattice over a box, rows along x, symmetric about its middle."""
    height = spacing * np.sqrt(3) / 2
    columns, rows = np.ceil((high - low) / [spacing, height]).astype(np.int64) // 2 + 1
    i, j = np.meshgrid(np.arange(-columns, columns + 1), np.arange(-rows, rows + 1))
    x = spacing * (i + 0.5 * (j % 2))
    return np.stack([x.ravel(), height * j.ravel()], axis=1) + (low + high) / 2


def _with_fixed(inner: FloatArray, fixed: FloatArray) -> FloatArray:
    """The fixed points, then the interior points, where each fixed point replaces the nearest
    interior one."""
    if len(fixed) > len(inner):
        raise InputError(
            f"{len(fixed)} points must be nodes, but only {len(inner)} lie inside: take more "
            "triangles", "triangles")
    left = inner
    for point in fixed:
        left = np.delete(left, np.argmin(np.sum((left - point) ** 2, axis=1)), axis=0)
    return np.concatenate([fixed, left])


def _centred(points: FloatArray, cells: IntArray) -> FloatArray:
    """Each point at the centroid of the triangles around it (one Lloyd iteration on that patch)."""
    area = signed_measures(points, cells)
    moment = area[:, None] * points[cells].mean(axis=1)
    at, n = cells.ravel(), len(points)
    total = np.bincount(at, np.repeat(area, 3), n)
    moved = [np.bincount(at, np.repeat(m, 3), n) / total for m in moment.T]
    return np.stack(moved, axis=1)


def _triangulate(points: FloatArray, outline: FloatArray) -> IntArray:
    """(T, 3) Delaunay triangles inside the outline, the first of the points, counter-clockwise; all
    sides of the outline are edges. InputError for points on one line."""
    try:
        cells = Delaunay(points).simplices.astype(np.int64)
    except QhullError as error:  # all points on one line
        reason = str(error).partition("\n")[0]
        raise InputError(f"the outline cannot be triangulated: {reason}") from None
    # a triangle outside has all its corners on the outline
    suspect = np.flatnonzero((cells < len(outline)).all(axis=1))
    outside = ~inside(points[cells[suspect]].mean(axis=1), outline)
    cells = np.delete(cells, suspect[outside], axis=0)
    turned = signed_measures(points, cells) < 0
    cells[turned] = cells[turned][:, [0, 2, 1]]
    return np.asarray(cells)


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
