"""Mesh checks, all faults with numbers and positions; orientation of inverted cells; warnings about
the mesh and the sets of a flexible body, valid input that is most likely a mistake.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sparsemor.bodies.mesh.cell_measures import corner_measures, longest_edges
from sparsemor.bodies.mesh.point_sets import PointSet
from sparsemor.core import BoolArray, Fault, FloatArray, InputError, IntArray, Mesh, Note
from sparsemor.core.model.facets import (
    cell_facets,
    facet_keys,
    facet_numbers,
    group_equal_rows,
    rows_among,
)
from sparsemor.core.protocols.cells import KINDS, by_kind, padded
from sparsemor.core.protocols.mesh import outside_box_notes

COINCIDENT = 1e-9
"""Distance of two nodes, relative to the mesh's diagonal, below which they coincide."""
COLD, SPACE, ROOM = 150.0, 5.0, 250.0
"""Radiation temperatures (K) between `SPACE` and `COLD` are most likely degrees Celsius, and up to
`ROOM` where another one is; below `SPACE` the surroundings may be outer space."""
SMALLEST, LARGEST = 1e-4, 50.0
"""Extents of a body, m, between which there is no note."""
LIGHT, HEAVY = 100.0, 25_000.0
"""Densities of ordinary materials, kg/m^3."""
CELSIUS = 273.15
"""0 degrees Celsius, K."""


def mesh_notes(
    name: str, mesh: Mesh, sets: Mapping[str, PointSet], density: float
) -> tuple[Note, ...]:
    """Warnings about the size of a body of the given density, kg/m^3, about coincident nodes that
    are not shared, and about sets far from the mesh."""
    found = [note for key, one in sets.items() if one.nearest is not None
             for note in outside_box_notes(f"bodies.{name}.sets.{key}", one.nearest, mesh.points)]
    found += size_notes(name, mesh, density)
    found += [note for key, one in sets.items() if one.centre is not None
              for note in far_centre(f"bodies.{name}.sets.{key}.centre", np.array(one.centre),
                                     mesh.points[mesh.point_sets[key]])]
    count = coincident_nodes(mesh.corners)
    if count:
        found.append(Note(
            f"{count} nodes of {name} coincide with another node but are not shared: the mesh is "
            "cut open there, as by a crack; merge them in the mesh file unless a crack is "
            "intended", "coincident_nodes"))
    return tuple(found)


def size_notes(name: str, mesh: Mesh, density: float) -> Iterator[Note]:
    """Warning about a body of ordinary density whose largest extent is not that of a part of a
    machine: a mesh in millimetres or micrometres, read as metres, or scaled twice."""
    extent = float(np.ptp(mesh.points, axis=0).max())
    if LIGHT < density < HEAVY and not SMALLEST < extent < LARGEST:
        why = ("a mesh in millimetres takes `scale: 1.0e-3`, or sizes in metres"
               if extent >= LARGEST else "check the unit of its sizes, which are metres")
        yield Note(f"{name} is {extent:.3g} m long at a density of {density:.4g} kg/m^3: {why}",
                   "unlikely_size")


def far_centre(key: str, centre: FloatArray, points: FloatArray) -> Iterator[Note]:
    """Warning if a centre (d,) is further outside the bounding box of the set's points (n, d), m,
    than the box's diagonal."""
    low, high = points.min(axis=0), points.max(axis=0)
    away = float(np.linalg.norm(centre - np.clip(centre, low, high)))
    size = float(np.linalg.norm(high - low))
    if away > size:
        yield Note(f"{key} is {away:.3g} m outside the points of the set, which are within "
                   f"{size:.3g} m: its displacement is extrapolated that far", "distant_point")


def coincident_nodes(points: FloatArray) -> int:
    """Number of nodes, at points (N, d), that coincide with a node of smaller number."""
    radius = COINCIDENT * float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    return len(np.unique(pairs[:, 1]))


def celsius_notes(
    load: str, surroundings: float, starts: Mapping[str, FloatArray | None],
    references: Mapping[str, FloatArray | None],
) -> tuple[Note, ...]:
    """Warnings about radiation temperatures that look like degrees Celsius.

    surroundings: temperature at the start, K; starts, references: body -> initial and stress-free
    temperatures (N,), K. A stress-free temperature below `COLD` shows that others up to `ROOM` are.
    """
    cold = {f"the reference temperature of {name}": float(T.min())
            for name, T in references.items() if T is not None and SPACE < T.min() < COLD}
    limit = ROOM if cold else COLD
    cold |= {f"the initial temperature of {name}": float(T.min())
             for name, T in starts.items() if T is not None and T.min() < limit}
    if SPACE < surroundings < COLD or (cold and surroundings < limit):
        cold["the surroundings"] = surroundings
    return tuple(
        Note(f"loads.{load} radiates with temperatures in K, and {what} is {T:g} K, which is "
             f"{T - CELSIUS:.4g} degrees Celsius: if {T:g} degrees Celsius are meant, write "
             f"{T + CELSIUS:g}", "celsius") for what, T in cold.items())


SHOWN = 5
FLAT = 1e-12
"""A cell is degenerate when its measure is below this times its longest edge to the power d."""


def check_mesh(mesh: Mesh) -> None:
    """Checks a mesh; InputError with every fault.

    Faults: points that are not finite, cells that refer to missing points, inverted, degenerate,
    folded and duplicate cells, facets of more than two cells, points in no cell, and parts that are
    not connected by facets (two cells that share one point only form a hinge).
    """
    faults = _broken(mesh) or _cells(mesh) + _connections(mesh)
    faults = faults or _bent(mesh)
    if faults:
        raise InputError([Fault("mesh", message) for message in faults])


def some(numbers: IntArray) -> str:
    """List of the first numbers for messages: `3, 7, 9` or `3, 7, 9, 12, 15, ...`."""
    return ", ".join(str(n) for n in numbers[:SHOWN]) + (", ..." if len(numbers) > SHOWN else "")


def _place(point: FloatArray) -> str:
    """Coordinates of a point, m, for messages."""
    return "(" + ", ".join(f"{c:.6g}" for c in point) + ")"


def _centre(mesh: Mesh, cell: int) -> str:
    return _place(mesh.points[mesh.cells[cell]].mean(axis=0))


def _broken(mesh: Mesh) -> list[str]:
    """Faults of the arrays: their shapes, no cells, points that are not finite, cells and midpoints
    outside of the points."""
    n, d = mesh.points.shape
    if mesh.cells.ndim != 2 or (d, mesh.cells.shape[1]) not in KINDS or (len(mesh.cells) and any(
            (d, own.shape[1]) not in KINDS for _, own in by_kind(mesh.cells, d))):
        return [f"points of {d} coordinates and cells of shape {mesh.cells.shape} do not make a "
                "mesh of triangles and quadrilaterals (2-D) or tetrahedra, wedges and hexahedra "
                "(3-D)"]
    if not len(mesh.cells):
        return ["there are no cells"]
    faults = []
    if mesh.midpoints.size and not len(mesh.corners) <= mesh.midpoints.min() <= (
            mesh.midpoints.max()) < n:
        faults.append("midpoints are not numbered after the corners, or leave the mesh")
    infinite = np.flatnonzero(~np.isfinite(mesh.points).all(axis=1))
    if infinite.size:
        faults.append(f"{infinite.size} points are not finite: {some(infinite)}")
    outside = np.flatnonzero(((mesh.cells < 0) | (mesh.cells >= n)).any(axis=1))
    if outside.size:
        faults.append(f"{outside.size} cells name points outside 0..{n - 1}: {some(outside)}")
    return faults


def _cells(mesh: Mesh) -> list[str]:
    """Faults of cells: inverted, degenerate, folded over, twice. measure (E, j): of the simplex of
    the edges that meet at each corner, m2 or m3, positive for a sound cell; least (E,): that of a
    flat one; kind, first: number of each cell among different ones, and the first cell of each."""
    measure = corner_measures(mesh.points, mesh.cells)
    least = FLAT * longest_edges(mesh.points, mesh.cells) ** mesh.dimension
    flat = (np.abs(measure) <= least[:, None]).any(axis=1)
    inverted = (measure < 0).all(axis=1)
    kind, first, _ = group_equal_rows(np.sort(mesh.cells, axis=1))
    again = first[kind] != np.arange(len(mesh.cells))
    faults = []
    for bad, what in (
        (~flat & inverted, "inverted (their points run the wrong way round)"),
        (flat, "degenerate (their points lie on one line or plane)"),
        (~flat & ~inverted & (measure < 0).any(axis=1), "folded over (an angle above 180 degrees, "
         "or points in another order)"),
        (again, "duplicates of earlier cells"),
    ):
        numbers = np.flatnonzero(bad)
        if numbers.size:
            faults.append(
                f"{numbers.size} of {len(mesh.cells)} cells are {what}: {some(numbers)}; "
                f"the first is at {_centre(mesh, int(numbers[0]))}"
            )
    return faults


def _bent(mesh: Mesh) -> list[str]:
    """Cells that are folded over inside or by their curved edges: the determinant of their map is
    not positive at a node or quadrature point."""
    if mesh.order == 1 and mesh.cells.shape[1] == mesh.dimension + 1:
        return []
    from sparsemor.bodies.fem import element_matrices

    found = element_matrices.folded(mesh)
    return [f"{found.size} of {len(mesh.cells)} cells are folded over inside or by their "
            f"curved edges: {some(found)}; the first is at {_centre(mesh, int(found[0]))}: mesh it "
            "finer there, or optimise the mesh"] if found.size else []


def _connections(mesh: Mesh) -> list[str]:
    """Faults of connections: points in no cell, facets of more than two cells, triangles on
    quadrilaterals, pieces. number, count: of each facet of each cell its number among the different
    ones, and how many cells have it; owner: its cell."""
    faults = []
    unused = np.setdiff1d(np.arange(len(mesh.corners)), mesh.cells)
    if unused.size:
        faults.append(
            f"{unused.size} of {len(mesh.corners)} points are in no cell: {some(unused)}; "
            f"the first is at {_place(mesh.points[unused[0]])}"
        )
    facets, owner = cell_facets(mesh.cells, mesh.dimension)
    number, count = facet_numbers(facets)
    crowded = np.unique(owner[count[number] > 2])
    name = "edge" if mesh.dimension == 2 else "face"
    if crowded.size:
        faults.append(
            f"{int(np.sum(count > 2))} {name}s belong to more than two cells, so cells overlap: "
            f"cells {some(crowded)}; the first is at {_centre(mesh, int(crowded[0]))}"
        )
    return faults + _unequal(mesh, facets, count[number] == 1) + _pieces(
        mesh, owner, number, name)


def _unequal(mesh: Mesh, facets: IntArray, outer: BoolArray) -> list[str]:
    """Fault of triangles of tetrahedra or wedges on quadrilaterals of other cells, whose
    displacements do not fit together. facets (F, w): of all cells, of triangles the last corner
    repeated; outer (F,): True for those of one cell. facet_keys: rows with sorted corners."""
    if facets.shape[1] < 4:
        return []
    own = facet_keys(facets[outer])
    quads, triangles = own[own[:, 2] < own[:, 3]], own[own[:, 2] == own[:, 3], :3]
    parts = quads[:, np.array([(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)])].reshape(-1, 3)
    bad = np.flatnonzero(rows_among(triangles, parts))
    return [f"{bad.size} triangular faces lie on quadrilateral ones of other cells, the first at "
            f"{_place(mesh.points[triangles[bad[0]]].mean(axis=0))}: tetrahedra and hexahedra do "
            "not fit together without pyramids, which are not supported"] if bad.size else []


def _pieces(mesh: Mesh, owner: IntArray, facet: IntArray, name: str) -> list[str]:
    """Fault of a mesh whose cells are not all connected by facets (`name`: edge or face); owner,
    facet (F,): cell and number of each facet of each cell, as edges of a graph of both."""
    cells, facets = len(mesh.cells), int(facet.max()) + 1
    joined = coo_array(
        (np.ones(len(owner)), (owner, cells + facet)), shape=(cells + facets, cells + facets)
    )
    pieces, label = connected_components(joined, directed=False)
    if pieces == 1:
        return []
    sizes = np.bincount(label[:cells], minlength=pieces)
    cell = int(np.flatnonzero(label[:cells] == np.argmin(sizes))[0])
    return [
        f"{pieces} pieces share no {name}; the smallest has {sizes.min()} cells, near "
        f"{_centre(mesh, cell)}: merge coincident points, or make a body of each piece"
    ]


TURNED: Mapping[tuple[int, int], list[int]] = {
    (2, 3): [0, 2, 1], (2, 4): [0, 3, 2, 1], (3, 4): [0, 1, 3, 2], (3, 6): [3, 4, 5, 0, 1, 2],
    (3, 8): [4, 5, 6, 7, 0, 1, 2, 3]}
"""Corners of inverted cells in positive orientation, by dimension and number of corners."""


def oriented(points: FloatArray, cells: IntArray) -> IntArray:
    """Cells in positive orientation: mesh generators write each surface in its own. InputError
    where cells lie on one side of a facet that they share, so that they overlap: both run through
    it in the same direction, seen from its corner of least number (ahead, one sign for each)."""
    inverted = np.asarray((corner_measures(points, cells) < 0).all(axis=1))
    d, kinds = points.shape[1], by_kind(cells, points.shape[1])
    turned = np.asarray(padded(
        [np.where(inverted[here][:, None], own[:, TURNED[d, own.shape[1]]], own)
         for here, own in kinds], [here for here, _ in kinds]))
    if inverted.all() or not inverted.any():
        return turned
    facets, owner = cell_facets(turned, d)
    number, _ = facet_numbers(facets)
    first = facets.argmin(axis=1)
    before, after = (facets[np.arange(len(facets)), (first + k) % facets.shape[1]]
                     for k in (-1, 1))
    ahead = after < before if facets.shape[1] > 2 else first == 0
    if facets.shape[1] == 4:  # of three corners the last is repeated
        three = facets[:, 2] == facets[:, 3]
        a, b, c = facets[three, :3].T
        # the same sign by comparisons, as the repeated corner would be a neighbour of the least
        ahead[three] = (a < b) ^ (b < c) ^ (a < c)
    total = np.bincount(number, weights=np.where(ahead, 1.0, -1.0))
    folded = np.unique(owner[np.abs(total[number]) > 1])
    if folded.size:
        bad = np.intersect1d(folded, np.flatnonzero(inverted))
        raise InputError(
            f"{len(bad)} of {len(cells)} cells are inverted and overlap their neighbours: "
            f"{some(bad)}; repair the mesh")
    return turned
