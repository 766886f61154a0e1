"""Centre of a named set: mean over its facets, axis of a bore or shaft, or a point that is given.

A set is an integration domain: its boundary facets, the cells or inner facets that it consists of,
in space its edges, or its points. The weights w_i of its nodes are the integrals of the shape
functions over the domain, divided by its measure, so that w . u is the mean of a nodal field u and
does not depend on how evenly the set is meshed.

The mean of a closed polygon inscribed in a circle is not the circle's centre where its edges
differ: with edges of half angle a on one side it is off by about a^2 / 3 of the radius at most. The
centre of a closed circle or cylinder, and of a surface of revolution between circles, is therefore
that of the circle or lies on the axis, fitted through the points. The weights are then corrected by
a linear function of the position,

    w_i (1 + l . (X_i - X_mean)),    J l = X_centre - X_mean,   J = sum w_i arm_i arm_i^T,

the smallest change (in the norm weighted by 1 / w) whose weighted mean position is the centre; they
still reproduce every displacement that is linear in the position, rotations included.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sparsemor.bodies.fem.quadrature import Quadrature
from sparsemor.bodies.mesh.cell_measures import triangulated
from sparsemor.core import BoolArray, FloatArray, InputError, IntArray, Mesh
from sparsemor.core.model.facets import (
    cell_facets,
    facet_keys,
    facet_numbers,
    rows_among,
)
from sparsemor.core.protocols.cells import KINDS, by_kind

ROUND = 1e-3
"""Largest distance of a point from a fitted circle or cylinder, relative to its radius."""
CORNERS, GAP = 5, 2.1
"""Smallest number of directions, and largest angle (rad) between neighbours, of the points about
the axis of a closed circle."""
FLAT = 1e-9
"""Smallest variance of a set's points in a direction, relative to the largest, in which its centre
can be moved."""
NO_CELLS = np.zeros(0, np.int64)
FAR = 1e2
"""Distance of the points from an axis, relative to their extent, at which a fit has failed."""

@dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """Centre of a set. weights (N,): of the mesh's nodes, sum 1, 0 outside of the set; their
    weighted mean position is `point` (d,), m, and that of displacements is its displacement; even
    (N,): those of the mean over the facets, at `mean` (d,), m; how: what the centre is, in
    words."""

    weights: FloatArray
    point: FloatArray
    even: FloatArray
    mean: FloatArray
    how: str

    @classmethod
    def of_points(
        cls, X: FloatArray, nodes: IntArray, weights: FloatArray | None = None,
        given: FloatArray | None = None,
    ) -> "Centre":
        """Mean of single points, number `nodes` of X (N, d), with weights (len(nodes),), equal ones
        if None; given (d,): position of the centre, m, instead. InputError for one off the line or
        plane on which all points lie."""
        even = np.zeros(len(X))
        even[nodes] = 1.0 / len(nodes) if weights is None else weights / weights.sum()
        mean = even @ X
        if given is None:
            return cls(even, mean, even, mean, "the mean of its points")
        return cls(_moved(even, X, given), given, even, mean, "the given point")

    @property
    def shift(self) -> float:
        """Distance of the centre from the mean of the facets, m."""
        return float(np.linalg.norm(self.point - self.mean))


def centre_of_set(
    mesh: Mesh, nodes: IntArray, given: FloatArray | None = None, name: str = ""
) -> Centre:
    """Centre of the set with the points `nodes`; given (d,): its position, m, instead; name: of the
    set, whose facets or cells the mesh may tag.

    InputError for a given position off the line or plane on which all points of the set lie.
    """
    facets, even = _integrals(mesh, nodes, name)
    even /= even.sum()
    mean = even @ mesh.points
    point, how, surface = given, "the given point", len(facets) > 0
    if point is None and surface:
        point, how = _of_revolution(mesh.points, facets, mean)
    if point is None:
        what = {True: "its facets", False: "its cells, edges or points"}[surface]
        return Centre(even, mean, even, mean, f"the mean of {what}")
    return Centre(_moved(even, mesh.points, point), point, even, mean, how)


def _integrals(mesh: Mesh, nodes: IntArray, name: str) -> tuple[IntArray, FloatArray]:
    """Segments or triangles (n, d) between the corners of a set's facets, none where it is no
    surface, and the integrals (N,) of the shape functions over the set.

    A set is made of facets or cells that the mesh tags, boundary facets, cells, inner facets or
    edges, the first of them that contain all its points; else of its boundary facets, else of its
    points.
    """
    from sparsemor.bodies.fem import element_matrices

    d, corners = mesh.dimension, nodes[nodes < len(mesh.corners)]
    inside = np.zeros(len(mesh.points), dtype=np.bool_)
    inside[corners] = True
    near = np.flatnonzero(np.count_nonzero(inside[mesh.cells], axis=1) > 1)
    every, _ = cell_facets(mesh.cells, d)
    number, count = facet_numbers(every)
    outer, own = every[count[number] == 1], every[inside[every].all(axis=1)]
    outer, tagged = outer[inside[outer].all(axis=1)], mesh.facet_sets.get(name, every[:0])
    cells = mesh.cell_sets.get(name, NO_CELLS)
    whole = near[inside[mesh.cells[near]].all(axis=1)]

    def complete(rows: IntArray) -> bool:
        return len(rows) > 0 and len(np.unique(rows)) == len(corners)

    facets = every[:0]
    if complete(tagged):
        facets = every[rows_among(every, tagged)]
    elif complete(mesh.cells[cells]):
        return facets, _sums(
            mesh, element_matrices.cell_quadratures(mesh, 1, cells, gradients=False))
    elif complete(outer):
        facets = outer
    elif complete(mesh.cells[whole]):
        return facets, _sums(
            mesh, element_matrices.cell_quadratures(mesh, 1, whole, gradients=False))
    elif complete(own):
        facets = own
    elif d == 3 and complete((edges := _edges(mesh, near, inside))[:, :2]):
        return facets, _along(mesh, edges)
    else:
        facets = outer
    if not len(facets):
        weights = np.zeros(len(mesh.points))
        weights[corners] = 1.0
        return facets, weights
    once = np.unique(facet_keys(facets), axis=0, return_index=True)[1]
    facets = facets[once]
    return triangulated(facets), element_matrices.facet_vector(mesh, facets)


def _sums(mesh: Mesh, parts: Sequence[tuple[IntArray, Quadrature]]) -> FloatArray:
    """(N,) integrals of the shape functions over cells."""
    found = np.zeros(len(mesh.points))
    for _, at in parts:
        np.add.at(found, at.shape.nodes, (at.shape.values * at.weights[:, None]).sum(axis=2))
    return found


def _edges(mesh: Mesh, near: IntArray, inside: BoolArray) -> IntArray:
    """(n, 2 or 3) nodes of the edges, each once, of the cells `near` (numbers) with both ends
    inside, a mask (N,): the ends, then with cells of second order the node between them."""
    rows = []
    for here, own in by_kind(mesh.cells[near], mesh.dimension):
        edges = np.array(KINDS[mesh.dimension, own.shape[1]].edges)
        parts = [own[:, edges]]
        if mesh.order == 2:
            parts.append(mesh.midpoints[near[here], : len(edges), None])
        rows.append(np.concatenate(parts, axis=2).reshape(len(own) * len(edges), 1 + mesh.order))
    found = np.concatenate(rows)
    found = found[inside[found[:, :2]].all(axis=1)]
    first = np.unique(np.sort(found[:, :2], axis=1), axis=0, return_index=True)[1]
    return found[first]


def _along(mesh: Mesh, edges: IntArray) -> FloatArray:
    """(N,) integrals of the shape functions along edges (n, 2 or 3), straight ones exactly."""
    found = np.zeros(len(mesh.points))
    size = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    shares = (1 / 6, 1 / 6, 2 / 3) if edges.shape[1] == 3 else (0.5, 0.5)
    np.add.at(found, edges, size[:, None] * np.array(shares))
    return found


def _moved(even: FloatArray, X: FloatArray, point: FloatArray) -> FloatArray:
    """(N,) weights nearest to `even`, of sum 1, with the weighted mean position `point` (d,), m:
    even_n (1 + linear . (X_n - mean)), linear by the second moments of the set. InputError for a
    point off the line or plane of the set."""
    mean = even @ X
    arm = X - mean
    size, axes = np.linalg.eigh(np.einsum("n,ni,nj->ij", even, arm, arm))
    spanned = size > FLAT * max(float(size.max()), 1e-300)
    away = axes.T @ (point - mean)
    off = float(np.linalg.norm(away[~spanned]))
    extent = float(np.ptp(X, axis=0).max())
    if off > 1e-6 * extent:
        raise InputError(
            f"{point.tolist()} is {off:.3g} m off the {('point', 'line', 'plane')[spanned.sum()]} "
            "in which all points of this set lie: the mean of their displacements is not the "
            "displacement there")
    linear = axes[:, spanned] @ (away[spanned] / size[spanned])
    moved = even * (1.0 + arm @ linear)
    return np.asarray(moved / moved.sum())


# ---------------------------------------------------------------------- circles and cylinders

def _of_revolution(
    X: FloatArray, facets: IntArray, mean: FloatArray
) -> tuple[FloatArray | None, str]:
    """Centre (d,), m, of a closed circle or cylinder, or of a surface between coaxial circles, and
    what it is in words; None for facets of another shape. X (N, d); facets: segments or triangles
    (n, d); mean (d,): of the set, whose height along the axis counts in the last case."""
    if X.shape[1] == 2:
        found = _circle(X[np.unique(facets)]) if _closed(facets) else None
        if found is None:
            return None, ""
        return found[0], f"that of a circle of radius {found[1]:.6g} m"
    found = _cylinder(X, facets)
    if found is not None:
        return found[0], f"the middle of a cylinder of radius {found[1]:.6g} m"
    axis = _axis_of_outline(X, facets)
    if axis is None:
        return None, ""
    at, along = axis
    return at + along * (along @ (mean - at)), "on the axis of its round rims"


def _closed(edges: IntArray) -> bool:
    """True if every point of edges (n, 2) is an end of exactly two."""
    return bool((np.unique(edges, return_counts=True)[1] == 2).all())


def _circle(X: FloatArray) -> tuple[FloatArray, float] | None:
    """Centre (2,) and radius of the circle through points (n, 2), by the linear fit
    |X - m|^2 = 2 c . (X - m) + r0, m the mean; None if they are not all round one circle."""
    middle = X.mean(axis=0)
    arm = X - middle
    A = np.column_stack([2.0 * arm, np.ones(len(X))])
    (*c, r0), _, rank, _ = np.linalg.lstsq(A, np.sum(arm**2, axis=1), rcond=1e-10)
    if rank < 3:
        return None
    centre = np.array(c)
    radius = float(np.sqrt(max(r0 + centre @ centre, 0.0)))
    return (middle + centre, radius) if _round(arm - centre, radius) else None


def _round(arm: FloatArray, radius: float) -> bool:
    """True if points at arm (n, 2) from a centre lie on the circle of this radius, in `CORNERS` or
    more directions all round."""
    if np.abs(np.linalg.norm(arm, axis=1) - radius).max() > ROUND * radius:
        return False
    angles = np.sort(np.arctan2(arm[:, 1], arm[:, 0]))
    gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
    return bool(np.count_nonzero(gaps > ROUND) >= CORNERS and gaps.max() < GAP)


def _cylinder(X: FloatArray, facets: IntArray) -> tuple[FloatArray, float] | None:
    """Point (3,) on the axis at the middle of a cylinder's surface, and its radius, from triangles
    on it (n, 3); None for another surface.

    Gauss-Newton iteration on the distances of the points from the axis p + z a, from the direction
    a that is most nearly perpendicular to all normals.
    """
    P = X[np.unique(facets)]
    normals = np.cross(X[facets[:, 1]] - X[facets[:, 0]], X[facets[:, 2]] - X[facets[:, 0]])
    area = np.linalg.norm(normals, axis=1, keepdims=True)
    a = np.linalg.eigh((normals / np.sqrt(area)).T @ (normals / np.sqrt(area)))[1][:, 0]
    p, radius, extent = P.mean(axis=0), 0.0, float(np.ptp(P, axis=0).max())
    for _ in range(30):
        e = _across(a)
        arm = P - p
        flat = arm @ e.T
        r = np.linalg.norm(flat, axis=1)
        if not r.all() or not r.max() < FAR * extent:
            return None
        radius = float(r.mean())
        unit, z = flat / r[:, None], (arm @ a)[:, None]
        # derivatives of |flat| - radius by two shifts of p, two tilts of a, and the radius
        J = np.hstack([-unit, -z * unit, -np.ones((len(P), 1))])
        step = np.linalg.lstsq(J, radius - r, rcond=1e-10)[0]
        p, a = p + step[:2] @ e, a + step[2:4] @ e
        a /= np.linalg.norm(a)
        if np.abs(step[:2]).max() < 1e-14 * radius and np.abs(step[2:4]).max() < 1e-14:
            break
    e = _across(a)
    if not _round((P - p) @ e.T, radius):
        return None
    # middle along the axis: mean of the triangles' heights, by areas on the developed surface
    flat, z = (X - p) @ e.T, (X - p) @ a
    angle = np.arctan2(flat[:, 1], flat[:, 0])[facets]
    turn = (np.diff(angle, axis=1) + np.pi) % (2.0 * np.pi) - np.pi
    rise = np.diff(z[facets], axis=1)
    developed = np.abs(turn[:, 0] * rise[:, 1] - turn[:, 1] * rise[:, 0])
    if not developed.any():  # flat: a disk whose points are all on its rim
        return None
    return p + a * np.average(z[facets].mean(axis=1), weights=developed), radius


def _axis_of_outline(X: FloatArray, facets: IntArray) -> tuple[FloatArray, FloatArray] | None:
    """Point (3,), m, and direction (3,) of the common axis of the circles that bound triangles (n,
    3), whose edges belong to one triangle alone; None if they are bounded by other curves, by
    circles with other axes or by none."""
    sides = np.sort(facets[:, [(0, 1), (1, 2), (0, 2)]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    rim = edges[count == 1]
    if not len(rim) or not _closed(rim):
        return None
    rims = list(_rims(X, rim))
    if not all(r is not None for r in rims):
        return None
    found = [r for r in rims if r is not None]
    at, along, radius = found[0]
    for centre, normal, _ in found[1:]:
        off = centre - at
        off -= along * (along @ off)
        if abs(along @ normal) < 1.0 - ROUND or np.linalg.norm(off) > ROUND * radius:
            return None
    centres = np.array([centre for centre, _, _ in found])
    away = centres - at
    far = int(np.argmax(np.abs(away @ along)))
    reach = float(np.linalg.norm(away[far]))
    if reach > ROUND * radius:  # two centres give the direction better than one plane
        along = away[far] / reach
    return centres.mean(axis=0), along


def _rims(X: FloatArray, rim: IntArray) -> Iterator[tuple[FloatArray, FloatArray, float] | None]:
    """Centre, normal and radius of each closed curve of edges (n, 2), point numbers of X (N, 3);
    None for one that is no circle. A curve is a connected part of the edges, fitted in its plane,
    that of the two largest singular values of its points."""
    numbers, ends = np.unique(rim, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = coo_array((np.ones(len(rim)), (ends[:, 0], ends[:, 1])), shape=(len(numbers),) * 2)
    of = connected_components(graph, directed=False)[1]
    for which in range(int(of.max()) + 1):
        P = X[numbers[of == which]]
        middle = P.mean(axis=0)
        size, axes = np.linalg.svd(P - middle, full_matrices=False)[1:]
        found = _circle((P - middle) @ axes[:2].T) if size[2] <= ROUND * size[0] else None
        yield None if found is None else (middle + found[0] @ axes[:2], axes[2], found[1])


def _across(a: FloatArray) -> FloatArray:
    """(2, 3) two unit vectors perpendicular to the unit vector a and to each other."""
    e = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
    e /= np.linalg.norm(e)
    return np.array([e, np.cross(a, e)])
