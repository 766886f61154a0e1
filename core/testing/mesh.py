"""Law kit of a mesh."""

from pathlib import Path

import numpy as np

from sparsemor.core.protocols.cells import KINDS, by_kind
from sparsemor.core.protocols.mesh import Mesh, MeshPlugin
from sparsemor.core.testing.random_inputs import law


def check_mesh_plugin(plugin: MeshPlugin, base: Path | None = None) -> None:
    """Laws of a mesh: well-formed, positively oriented cells that use every point, sorted point
    sets, and the same mesh from a second build. base: folder of the scene file, by default the
    working one."""
    folder = Path.cwd() if base is None else base
    mesh, again = plugin.build(folder), plugin.build(folder)
    _points_and_cells(mesh)
    for name, members in mesh.point_sets.items():
        law(members.size > 0, f"point set {name} is empty")
        law(bool(np.all(np.diff(members) > 0)), f"point set {name} is not sorted or not distinct")
        law(0 <= members[0] and members[-1] < len(mesh.points), f"point set {name} leaves the mesh")
    for name, cells in mesh.cell_sets.items():
        law(bool(np.all(np.diff(cells) > 0)) and (cells >= 0).all() and (
            cells < len(mesh.cells)).all(), f"cell set {name} is not sorted, or leaves the mesh")
    for name, facets in mesh.facet_sets.items():
        law(facets.shape[1:] in ((mesh.dimension,), (4,)) and (facets >= 0).all() and (
            facets < len(mesh.points)).all(), f"facet set {name} leaves the mesh")
    law(not {*mesh.cell_sets, *mesh.facet_sets} - {*mesh.point_sets},
        "a set of cells or facets has no points")
    law(np.array_equal(mesh.points, again.points) and np.array_equal(mesh.cells, again.cells),
        "two builds give different meshes")
    law(_sets(mesh) == _sets(again), "two builds give different sets")


def _sets(mesh: Mesh) -> list[dict[str, object]]:
    return [{n: m.tolist() for n, m in sets.items()}
            for sets in (mesh.point_sets, mesh.facet_sets, mesh.cell_sets)]


def _points_and_cells(mesh: Mesh) -> None:
    """Checks points and cells of a mesh: finite, of a known kind, none inverted."""
    n, d = mesh.points.shape
    law(d in (2, 3), f"points have {d} coordinates, not 2 or 3")
    law(bool(np.isfinite(mesh.points).all()), "a point is not finite")
    law(mesh.cells.ndim == 2 and (d, mesh.cells.shape[1]) in KINDS and len(mesh.cells) > 0,
        f"cells of shape {mesh.cells.shape} are of no kind in {d} dimensions")
    law(np.array_equal(np.unique(mesh.nodes), np.arange(n)),
        "a cell names a point that does not exist, or a point is in no cell")
    bad = 0
    for _, own in by_kind(mesh.cells, d):
        # each corner with its neighbours, the edges to which have a positive determinant
        a = mesh.points[own[:, np.array(KINDS[d, own.shape[1]].turns)]]
        bad += int((np.linalg.det(a[:, :, 1:] - a[:, :, :1]) <= 0).any(axis=1).sum())
    law(bad == 0, f"{bad} cells are inverted or flat")
