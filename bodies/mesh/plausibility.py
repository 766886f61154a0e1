"""Warnings about the mesh and the sets of a flexible body: input that is valid but most likely a
mistake."""

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.mesh.sets import PointSet
from sparsemor.core import FloatArray, Mesh, Note
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
