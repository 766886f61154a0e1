"""A mesh from a file, in any format that meshio reads, rebuilt as clean linear simplices."""

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from sparsemor.bodies.mesh.check import check_mesh, some
from sparsemor.bodies.mesh.groups import SIMPLEX, dimension_of, named_points
from sparsemor.bodies.mesh.simplices import signed_measures
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.mesh import Mesh
from sparsemor.core.plugin import Plugin


class MeshFile(Plugin):
    """Triangles or tetrahedra from a file (Gmsh, Abaqus, VTK, ...).

    The simplices of the highest dimension become the body; everything else in the file only names
    sets of points: physical groups and tags, cell sets, point sets. Unused points are dropped.
    A mesh whose cells all run the wrong way round is turned; one where some do is refused.
    """

    path: str = Field(min_length=1)
    """The file, relative to the scene's folder."""
    scale: float = Field(default=1.0, gt=0)
    """Metres per length unit of the file: 1e-3 for a drawing in millimetres."""

    def files(self, base: Path) -> tuple[Path, ...]:
        """The mesh file: part of the identity of a run and of the key of its products."""
        return (base / self.path,)

    def build(self, base: Path) -> Mesh:
        """The mesh of `base / path`; InputError with key `path` when it cannot be used."""
        raw = _read(base / self.path, self.path)
        try:
            return _clean(raw, self.scale)
        except InputError as error:
            faults = "; ".join(f.message for f in error.faults)
            raise InputError(f"{self.path}: {faults}", "path") from None


def _read(full: Path, given: str) -> Any:
    """meshio's mesh. It prints, and may leave the interpreter, on bad files: both are caught."""
    if not full.is_file():
        raise InputError(
            f"there is no file '{given}'; paths start at the folder of the scene", "path"
        )
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            import meshio

            return meshio.read(full)
    # each of meshio's readers fails in its own way; whatever it is, the file is the cause
    except (Exception, SystemExit) as error:
        words = [said.getvalue(), "" if isinstance(error, SystemExit) else str(error)]
        text = " ".join(" ".join(words).replace(str(full), given).split())
        reason = text or type(error).__name__
        raise InputError(f"'{given}' cannot be read as a mesh: {reason}", "path") from None


def _clean(raw: Any, scale: float) -> Mesh:
    d = max((dimension_of(block.type) for block in raw.cells), default=0)
    cells = _simplices(raw, d)
    points = scale * _coordinates(np.asarray(raw.points, dtype=np.float64), cells, d)
    used = np.unique(cells)
    new = np.full(len(points), -1, dtype=np.int64)
    new[used] = np.arange(used.size)
    mesh = Mesh(points[used], _oriented(points[used], new[cells]), _renumbered(raw, new))
    check_mesh(mesh)
    return mesh


def _simplices(raw: Any, d: int) -> IntArray:
    kinds = {block.type for block in raw.cells if dimension_of(block.type) == d}
    if d not in SIMPLEX or kinds != {SIMPLEX[d]}:
        found = ", ".join(sorted(kinds)) or "no cells"
        raise InputError(
            f"its highest cells are {found}; a body is made of linear triangles (2-D) or "
            "tetrahedra (3-D) only: mesh it with those"
        )
    blocks = [np.asarray(b.data, dtype=np.int64) for b in raw.cells if b.type == SIMPLEX[d]]
    cells = np.concatenate(blocks)
    bad = np.flatnonzero(((cells < 0) | (cells >= len(raw.points))).any(axis=1))
    if bad.size:
        raise InputError(f"{bad.size} cells name points that do not exist: {some(bad)}")
    return cells


def _coordinates(points: FloatArray, cells: IntArray, d: int) -> FloatArray:
    """The d coordinates that count; a flat mesh may come with a third one, if it is constant."""
    across = points[np.unique(cells), d:]
    extent = float(np.ptp(points[np.unique(cells)], axis=0).max())
    if across.size and float(np.ptp(across)) > 1e-9 * extent:
        raise InputError(
            f"its triangles do not lie in the plane z = constant (z from {across.min():.6g} to "
            f"{across.max():.6g}); a shell in space is not supported"
        )
    return points[:, :d]


def _oriented(points: FloatArray, cells: IntArray) -> IntArray:
    inverted = np.flatnonzero(signed_measures(points, cells) < 0)
    if 0 < inverted.size < len(cells):
        raise InputError(
            f"{inverted.size} of {len(cells)} cells are inverted, the others are not: "
            f"{some(inverted)}; repair the mesh"
        )
    if not inverted.size:
        return cells
    return cells[:, [*range(cells.shape[1] - 2), -1, -2]]


def _renumbered(raw: Any, new: IntArray) -> dict[str, IntArray]:
    sets = {}
    for name, points in named_points(raw).items():
        kept = np.unique(new[points])
        kept = kept[kept >= 0]
        if kept.size:  # such as the centre of an arc, which is in no cell
            sets[name] = kept
    return sets
