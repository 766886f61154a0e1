"""Mesh from a file, converted to linear simplices."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import Field

from sparsemor.bodies.mesh.check import check_mesh, some
from sparsemor.bodies.mesh.formats import abaqus, gmsh, nastran, other
from sparsemor.bodies.mesh.formats.content import QUADRATIC, SIMPLEX, BadLine, CellBlock, Content
from sparsemor.bodies.mesh.formats.counts import difference
from sparsemor.bodies.mesh.groups import Sets, sets_of
from sparsemor.bodies.mesh.simplices import EDGES, rows_among, signed_measures
from sparsemor.core import FloatArray, InputError, IntArray, Mesh, MeshPlugin, Note, information
from sparsemor.core.model.facets import cell_facets, facet_numbers
from sparsemor.core.simulation.memory.limits import bounded_address_space

FORMATS = {
    ".msh": "gmsh", ".inp": "abaqus", ".vtk": "vtk", ".vtu": "vtu", ".bdf": "nastran",
    ".fem": "nastran", ".nas": "nastran", ".mesh": "medit", ".meshb": "medit", ".med": "med"}
"""File name extensions, and the name of their format. meshio supports more formats, but their
readers do not terminate on some damaged files, or they contain neither triangles nor tetrahedra."""
OWN: dict[str, Callable[[bytes, str], Content]] = {
    "gmsh": gmsh.read, "abaqus": abaqus.read, "nastran": nastran.read}
"""Readers of this package; meshio reads the other formats (decision 0032)."""
STRAIGHT = 1e-3
"""Distance of a quadratic cell's node from the middle of its edge, relative to the edge, up to
which the edge is straight: files may have few digits."""
BASE, PER_BYTE = 2**28, 200
"""Memory limit for reading a file: a constant, bytes, and bytes per byte of the file."""
_MOST_LETTERS = 200
"""Number of characters of a reader's error message that is repeated."""


class MeshFile(MeshPlugin):
    """Mesh file of triangles or tetrahedra.

    Gmsh (msh), Abaqus (inp), VTK (vtk, vtu), Nastran (bdf, fem, nas), Medit (mesh, meshb) or Salome
    (med, with the package h5py).

    The simplices of the highest dimension become the body; groups of the file become sets with the
    cells, facets and points that the file tags. Unused points are dropped. Quadratic triangles and
    tetrahedra are read by their corners if their edges are straight; the order of the elements is
    an option of the body. Inverted cells are reoriented, unless they overlap others. A line that
    cannot be read is an error, and so is a number of cells that differs from a plain count of the
    lines of the file.
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
                return _clean(content, self.scale, self.path)
        except InputError as error:
            faults = "; ".join(f.message for f in error.faults)
            colon = "" if faults.startswith(":") else ": "
            raise InputError(f"{self.path}{colon}{faults}", "path") from None


def _read(full: Path, written: str) -> Content:
    """Content of the file, compared with a plain count of its lines. Readers may print, or run out
    of memory on damaged files: both are caught."""
    kind = FORMATS.get(full.suffix.lower())
    if kind is None:
        endings = ", ".join(FORMATS)
        raise InputError(f"'{written}' has none of the supported formats: its name must end in "
                         f"{endings}; convert it, for example with `meshio convert`", "path")
    if not full.is_file():
        raise InputError(
            f"there is no file '{written}'; paths start at the folder of the scene", "path"
        )
    try:
        with bounded_address_space(BASE + PER_BYTE * full.stat().st_size):
            data = full.read_bytes()
            content = OWN[kind](data, written) if kind in OWN else other.read(full, kind)
            different = difference(kind, data, content.counts())
    except BadLine as error:
        raise InputError(f"{written}{error.faults[0].message}", "path") from None
    # each of meshio's readers fails in its own way; whatever it is, the file is the cause
    except (Exception, SystemExit) as error:
        raise InputError(f"'{written}' cannot be read as {kind}: {_reason(error, full, written)}",
                         "path") from None
    if different:
        raise InputError(f"'{written}': {different}: it is damaged, or misread", "path")
    return content


def _reason(error: BaseException, full: Path, written: str) -> str:
    """Error message of a reader on one line, with the path as the scene has it."""
    if isinstance(error, MemoryError):
        return "a number in it asks for far more memory than a file of this size can fill"
    if isinstance(error, ModuleNotFoundError):
        return f"that takes the package {error.name}, which is not installed"
    text = " ".join(str(error).replace(str(full), written).split())
    text = text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]}..."
    return f"{text} ({type(error).__name__})" if text else "it is damaged, or another format"


def _clean(content: Content, scale: float, name: str) -> Mesh:
    d = max((block.dimension for block in content.blocks), default=0)
    chosen = [i for i, block in enumerate(content.blocks) if block.dimension == d]
    cells = _simplices(content, d, [content.blocks[i] for i in chosen])
    points = scale * _coordinates(content.points, cells, d)
    used = np.unique(cells)
    new = np.full(len(points), -1, dtype=np.int64)
    new[used] = np.arange(used.size)
    sets = sets_of(content, d, chosen, new)
    mesh = Mesh(points[used], _oriented(points[used], new[cells]), sets.points,
                facet_sets=sets.facets, cell_sets=sets.cells, notes=content.notes)
    check_mesh(mesh)
    return replace(mesh, notes=(*mesh.notes, *_others(content, d, name),
                                *_notes(mesh, sets, name)))


def _others(content: Content, d: int, name: str) -> Iterator[Note]:
    """Note on elements of lower dimension in files whose elements are parts of a structure; in
    others, such as Gmsh's, they are there to name something."""
    count: dict[str, int] = {}
    for block in content.blocks:
        if block.dimension < d and block.place and "$" not in block.place:
            count[block.place] = count.get(block.place, 0) + len(block.nodes)
    if count:
        what = ", ".join(f"{n} ({place.lstrip(':')})" for place, n in count.items())
        yield information(f"{name}: {sum(count.values())} elements of lower dimension name points, "
                          f"edges and faces, and are no part of the body: {what[:200]}",
                          "mesh_file")


def _notes(mesh: Mesh, sets: Sets, name: str) -> list[Note]:
    """Notes about groups of which the body has nothing, or not all facets."""
    notes = []
    if sets.empty:
        notes.append(information(
            f"{name}: no point of the groups {', '.join(sets.empty)[:200]} is in a cell of the "
            "body: they are left out", "mesh_file"))
    facets = cell_facets(mesh.cells)
    for key, tagged in sets.facets.items():
        lost = int(np.count_nonzero(~rows_among(tagged, facets)))
        if lost:
            kind = "edges" if mesh.dimension == 2 else "faces"
            notes.append(Note(
                f"{name}: {lost} of {len(tagged)} {kind} of the group {key!r} are no {kind} of "
                "cells of the body, so that loads leave them out: mesh both together",
                "mesh_file"))
    return notes


def _simplices(content: Content, d: int, blocks: Sequence[CellBlock]) -> IntArray:
    wrong = [b for b in blocks if d < 2 or b.kind not in (SIMPLEX[d], QUADRATIC[d])]
    if wrong or not blocks:
        found = ", ".join(sorted({b.kind for b in blocks})) or "no cells"
        at = next((f"{b.place.strip()} has " for b in wrong if b.place), "")
        raise InputError(
            f"{at}its highest cells are {found}; a body is made of triangles (2-D) or tetrahedra "
            "(3-D) only, linear or quadratic: mesh it with those"
        )
    for block in blocks:
        cells = block.nodes
        bad = np.flatnonzero(((cells < 0) | (cells >= len(content.points))).any(axis=1))
        if bad.size:
            raise InputError(f"{bad.size} cells name points that do not exist: {some(bad)}")
        _check_straight(content.points, cells[:, : d + 1], cells[:, d + 1 :])
    return np.concatenate([block.nodes[:, : d + 1] for block in blocks])


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
    """Cells in positive orientation: mesh generators write each surface in its own. InputError
    where cells lie on one side of a facet that they share, so that they overlap."""
    inverted = signed_measures(points, cells) < 0
    turned = np.where(inverted[:, None], cells[:, [*range(cells.shape[1] - 2), -1, -2]], cells)
    if inverted.all() or not inverted.any():
        return turned
    facets = cell_facets(turned)
    number, _ = facet_numbers(turned)
    ahead = facets[:, 0] < facets[:, 1]
    if facets.shape[1] == 3:  # sign of the permutation that sorts the three corners
        ahead = ahead ^ (facets[:, 1] < facets[:, 2]) ^ (facets[:, 0] < facets[:, 2])
    total = np.bincount(number, weights=np.where(ahead, 1.0, -1.0))
    folded = np.flatnonzero(np.abs(total[number]) > 1) // cells.shape[1]
    if folded.size:
        bad = np.intersect1d(folded, np.flatnonzero(inverted))
        raise InputError(
            f"{len(bad)} of {len(cells)} cells are inverted and overlap their neighbours: "
            f"{some(bad)}; repair the mesh")
    return turned
