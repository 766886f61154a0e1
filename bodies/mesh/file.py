"""Mesh from a file, read by meshio and converted to linear simplices."""

import contextlib
import io
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from sparsemor.bodies.mesh.check import check_mesh, some
from sparsemor.bodies.mesh.groups import SIMPLEX, dimension_of, named_points
from sparsemor.bodies.mesh.simplices import EDGES, signed_measures
from sparsemor.core import FloatArray, InputError, IntArray, Mesh, Plugin, bounded_address_space

FORMATS = {
    ".msh": "gmsh", ".inp": "abaqus", ".vtk": "vtk", ".vtu": "vtu", ".bdf": "nastran",
    ".fem": "nastran", ".nas": "nastran", ".mesh": "medit", ".meshb": "medit", ".med": "med"}
"""File name extensions, and meshio's name of their format. meshio supports more formats, but their
readers do not terminate on some damaged files, or they contain neither triangles nor tetrahedra."""
QUADRATIC = {2: "triangle6", 3: "tetra10"}
STRAIGHT = 1e-3
"""Distance of a quadratic cell's node from the middle of its edge, relative to the edge, up to
which the edge is straight: files may have few digits."""
BASE, PER_BYTE = 2**28, 200
"""Memory limit for reading a file: a constant, bytes, and bytes per byte of the file."""
_MOST_LETTERS = 200
"""Number of characters of a reader's error message that is repeated."""


class MeshFile(Plugin):
    """Mesh file of triangles or tetrahedra, read by meshio.

    Gmsh (msh), Abaqus (inp), VTK (vtk, vtu), Nastran (bdf, fem, nas), Medit (mesh, meshb) or Salome
    (med, with the package h5py).

    The simplices of the highest dimension become the body; all other cells and groups in the file
    only name sets of points: physical groups and tags, cell sets, point sets. Unused points are
    dropped. Quadratic triangles and tetrahedra are read by their corners if their edges are
    straight; the order of the elements is an option of the body. If all cells are inverted, they
    are reoriented; if only some are, the mesh is rejected.
    """

    path: str = Field(min_length=1)
    """The file, relative to the scene's folder."""
    scale: float = Field(default=1.0, gt=0)
    """Metres per length unit of the file: 1e-3 for a drawing in millimetres."""

    def files(self, base: Path) -> tuple[Path, ...]:
        """The mesh file: its content identifies a run and its cached results."""
        return (base / self.path,)

    def build(self, base: Path) -> Mesh:
        """The mesh from the file `base / path`; InputError with key `path` if it cannot be used."""
        content = _read(base / self.path, self.path)
        try:
            with np.errstate(all="ignore"):  # points that are not finite are reported by number
                return _clean(content, self.scale)
        except InputError as error:
            faults = "; ".join(f.message for f in error.faults)
            raise InputError(f"{self.path}: {faults}", "path") from None


@dataclass(frozen=True, slots=True, eq=False)
class _Content:
    """Content of a mesh file: points (n, 2 or 3); cells: (type, dimension, point numbers (m,
    corners)) of each nonempty block; sets: name -> point numbers, unsorted."""

    points: FloatArray
    cells: tuple[tuple[str, int, IntArray], ...]
    sets: Mapping[str, IntArray]


def _read(full: Path, written: str) -> _Content:
    """Arrays of the file. Readers may print, or run out of memory on damaged files: both are
    caught."""
    kind = FORMATS.get(full.suffix.lower())
    if kind is None:
        endings = ", ".join(FORMATS)
        raise InputError(f"'{written}' has none of the supported formats: its name must end in "
                         f"{endings}; convert it, for example with `meshio convert`", "path")
    if not full.is_file():
        raise InputError(
            f"there is no file '{written}'; paths start at the folder of the scene", "path"
        )
    import meshio

    readers = {"gmsh": meshio.gmsh, "abaqus": meshio.abaqus, "vtk": meshio.vtk, "vtu": meshio.vtu,
               "nastran": meshio.nastran, "medit": meshio.medit, "med": meshio.med}
    try:
        with (_silent(), bounded_address_space(BASE + PER_BYTE * full.stat().st_size)):
            return _arrays(readers[kind].read(str(full)))
    # each of meshio's readers fails in its own way; whatever it is, the file is the cause
    except (Exception, SystemExit) as error:
        raise InputError(f"'{written}' cannot be read as {kind}: {_reason(error, full, written)}",
                         "path") from None


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Context that suppresses printed output and warnings of meshio; the file is checked
    afterwards."""
    nowhere = io.StringIO()
    with (contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere),
          warnings.catch_warnings(), np.errstate(all="ignore")):
        warnings.simplefilter("ignore")
        yield


def _reason(error: BaseException, full: Path, written: str) -> str:
    """Error message of a reader on one line, with the path as the scene has it."""
    if isinstance(error, MemoryError):
        return "a number in it asks for far more memory than a file of this size can fill"
    if isinstance(error, ModuleNotFoundError):
        return f"that takes the package {error.name}, which is not installed"
    text = " ".join(str(error).replace(str(full), written).split())
    text = text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]}..."
    return f"{text} ({type(error).__name__})" if text else "it is damaged, or another format"


def _arrays(raw: Any) -> _Content:
    """meshio's mesh as arrays of the expected shapes and types; any exception where that is
    impossible."""
    points = np.asarray(raw.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points of shape {points.shape}, where (n, 2) or (n, 3) is expected")
    cells = []
    for block in raw.cells:
        if not len(block.data):
            continue
        d, data = dimension_of(block.type), np.asarray(block.data, dtype=np.int64)
        count = d + 1 if block.type == SIMPLEX.get(d) else (
            (d + 1) * (d + 2) // 2 if block.type == QUADRATIC.get(d) else None)
        if count is not None and data.shape[1:] != (count,):
            raise ValueError(f"cells of shape {data.shape}, where (n, {count}) is expected")
        cells.append((str(block.type), d, data))
    sets = {name: numbers.ravel() for name, numbers in named_points(raw).items()}
    for name, numbers in sets.items():
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < len(points):
            raise ValueError(f"set {name!r} names points that do not exist")
    return _Content(points, tuple(cells), sets)


def _clean(content: _Content, scale: float) -> Mesh:
    d = max((d for _, d, _ in content.cells), default=0)
    cells = _simplices(content, d)
    points = scale * _coordinates(content.points, cells, d)
    used = np.unique(cells)
    new = np.full(len(points), -1, dtype=np.int64)
    new[used] = np.arange(used.size)
    mesh = Mesh(points[used], _oriented(points[used], new[cells]), _renumbered(content.sets, new))
    check_mesh(mesh)
    return mesh


def _simplices(content: _Content, d: int) -> IntArray:
    kinds = {kind for kind, dimension, _ in content.cells if dimension == d}
    if d not in SIMPLEX or not kinds <= {SIMPLEX[d], QUADRATIC[d]}:
        found = ", ".join(sorted(kinds)) or "no cells"
        raise InputError(
            f"its highest cells are {found}; a body is made of triangles (2-D) or tetrahedra "
            "(3-D) only, linear or quadratic: mesh it with those"
        )
    blocks = [numbers for _, dimension, numbers in content.cells if dimension == d]
    for cells in blocks:
        bad = np.flatnonzero(((cells < 0) | (cells >= len(content.points))).any(axis=1))
        if bad.size:
            raise InputError(f"{bad.size} cells name points that do not exist: {some(bad)}")
        _check_straight(content.points, cells[:, : d + 1], cells[:, d + 1 :])
    return np.concatenate([cells[:, : d + 1] for cells in blocks])


def _check_straight(points: FloatArray, cells: IntArray, midpoints: IntArray) -> None:
    """InputError if the nodes (E, 0, 3 or 6) of quadratic cells are not in the middle of their
    edges."""
    first, second = (points[cells[:, ends]] for ends in EDGES[:, : midpoints.shape[1]])
    away = np.linalg.norm(points[midpoints] - (first + second) / 2, axis=2)
    bent = np.flatnonzero((away > STRAIGHT * np.linalg.norm(second - first, axis=2)).any(axis=1))
    if bent.size:
        raise InputError(
            f"{bent.size} of {len(cells)} quadratic cells have curved edges, or nodes that are not "
            f"in their middle: {some(bent)}; write linear cells, or a finer mesh with straight "
            "edges")


def _coordinates(points: FloatArray, cells: IntArray, d: int) -> FloatArray:
    """(n, d) coordinates of the points; a plane mesh may have a third, constant one."""
    if points.shape[1] < d:
        raise InputError(f"its points have {points.shape[1]} coordinates, and tetrahedra take 3")
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


def _renumbered(named: Mapping[str, IntArray], new: IntArray) -> dict[str, IntArray]:
    sets = {}
    for name, points in named.items():
        kept = np.unique(new[points])
        kept = kept[kept >= 0]
        if kept.size:  # such as the centre of an arc, which is in no cell
            sets[name] = kept
    return sets
