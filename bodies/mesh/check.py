"""Mesh checks: all faults, with numbers and positions."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sparsemor.bodies.mesh.simplices import longest_edges, signed_measures
from sparsemor.core import Fault, FloatArray, InputError, IntArray, Mesh
from sparsemor.core.model.facets import facet_numbers, group_equal_rows

SHOWN = 5
FLAT = 1e-12
"""A cell is degenerate when its measure is below this times its longest edge to the power d."""


def check_mesh(mesh: Mesh) -> None:
    """Checks a mesh; InputError with every fault.

    Faults: points that are not finite, cells that refer to missing points, inverted, degenerate and
    duplicate cells, facets of more than two cells, points in no cell, and parts that are not
    connected by facets (two cells that share one point only form a hinge).
    """
    faults = _broken(mesh) or _cells(mesh) + _connections(mesh)
    if faults:
        raise InputError([Fault("mesh", message) for message in faults])


def some(numbers: IntArray) -> str:
    """List of the first numbers for messages: `3, 7, 9` or `3, 7, 9, 12, 15, ...`."""
    return ", ".join(str(n) for n in numbers[:SHOWN]) + (", ..." if len(numbers) > SHOWN else "")


def _place(point: FloatArray) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in point) + ")"


def _centre(mesh: Mesh, cell: int) -> str:
    return _place(mesh.points[mesh.cells[cell]].mean(axis=0))


def _broken(mesh: Mesh) -> list[str]:
    n, d = mesh.points.shape
    if d not in (2, 3) or mesh.cells.ndim != 2 or mesh.cells.shape[1] != d + 1:
        return [f"points of {d} coordinates and cells of shape {mesh.cells.shape} do not make a "
                "mesh of triangles (2-D) or tetrahedra (3-D)"]
    if not len(mesh.cells):
        return ["there are no cells"]
    faults = []
    infinite = np.flatnonzero(~np.isfinite(mesh.points).all(axis=1))
    if infinite.size:
        faults.append(f"{infinite.size} points are not finite: {some(infinite)}")
    outside = np.flatnonzero(((mesh.cells < 0) | (mesh.cells >= n)).any(axis=1))
    if outside.size:
        faults.append(f"{outside.size} cells name points outside 0..{n - 1}: {some(outside)}")
    return faults


def _cells(mesh: Mesh) -> list[str]:
    measure = signed_measures(mesh.points, mesh.cells)
    flat = np.abs(measure) <= FLAT * longest_edges(mesh.points, mesh.cells) ** mesh.dimension
    kind, first, _ = group_equal_rows(np.sort(mesh.cells, axis=1))
    again = first[kind] != np.arange(len(mesh.cells))
    faults = []
    for bad, what in (
        (~flat & (measure < 0), "inverted (their points run the wrong way round)"),
        (flat, "degenerate (their points lie on one line or plane)"),
        (again, "duplicates of earlier cells"),
    ):
        numbers = np.flatnonzero(bad)
        if numbers.size:
            faults.append(
                f"{numbers.size} of {len(mesh.cells)} cells are {what}: {some(numbers)}; "
                f"the first is at {_centre(mesh, int(numbers[0]))}"
            )
    return faults


def _connections(mesh: Mesh) -> list[str]:
    faults = []
    unused = np.setdiff1d(np.arange(len(mesh.points)), mesh.cells)
    if unused.size:
        faults.append(
            f"{unused.size} of {len(mesh.points)} points are in no cell: {some(unused)}; "
            f"the first is at {_place(mesh.points[unused[0]])}"
        )
    number, count = facet_numbers(mesh.cells)
    owner = np.repeat(np.arange(len(mesh.cells)), mesh.dimension + 1)
    crowded = np.unique(owner[count[number] > 2])
    name = "edge" if mesh.dimension == 2 else "face"
    if crowded.size:
        faults.append(
            f"{int(np.sum(count > 2))} {name}s belong to more than two cells, so cells overlap: "
            f"cells {some(crowded)}; the first is at {_centre(mesh, int(crowded[0]))}"
        )
    return faults + _pieces(mesh, owner, number, name)


def _pieces(mesh: Mesh, owner: IntArray, facet: IntArray, name: str) -> list[str]:
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
