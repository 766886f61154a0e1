"""Mesh from a file."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
from pydantic import Field

from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.mesh.formats import abaqus, by_meshio, gmsh, nastran
from sparsemor.bodies.mesh.formats.cell_counts import difference
from sparsemor.bodies.mesh.formats.file_content import CELLS, BadLine, CellBlock, Content
from sparsemor.bodies.mesh.groups_to_sets import Sets, sets_of
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh, oriented, some
from sparsemor.core import (
    BoolArray,
    FloatArray,
    InputError,
    IntArray,
    Mesh,
    MeshPlugin,
    Note,
    information,
)
from sparsemor.core.model.facets import (
    cell_facets,
    group_equal_rows,
    rows_among,
)
from sparsemor.core.protocols.cells import KINDS, by_kind, padded

FORMATS = {
    ".msh": "gmsh", ".inp": "abaqus", ".vtk": "vtk", ".vtu": "vtu", ".bdf": "nastran",
    ".fem": "nastran", ".nas": "nastran", ".mesh": "medit", ".meshb": "medit", ".med": "med"}
"""File name extensions, and the name of their format. meshio supports more formats, but their
readers do not terminate on some damaged files, or they contain no cells of a body."""
OWN: dict[str, Callable[[bytes, str], Content]] = {
    "gmsh": gmsh.read, "abaqus": abaqus.read, "nastran": nastran.read}
"""Readers of this package; meshio reads the other formats (decision 0032)."""
STRAIGHT = 1e-6
"""Distance of a node from the middle of its edge, relative to the edge, up to which the edge is
straight."""
SAME = 1e-3
"""Distance between the nodes that two cells have on one edge, relative to it, up to which they are
the same."""
BASE, PER_BYTE = 2**28, 200
"""Memory limit for reading a file: a constant, bytes, and bytes per byte of the file."""
_MOST_LETTERS = 200
"""Number of characters of a reader's error message that is repeated."""


class MeshFile(MeshPlugin):
    """Mesh file of triangles and quadrilaterals (2-D), or tetrahedra, wedges and hexahedra (3-D).

    Gmsh (msh), Abaqus (inp), VTK (vtk, vtu), Nastran (bdf, fem, nas), Medit (mesh, meshb) or Salome
    (med, with the package h5py).

    The cells of the highest dimension become the body; groups of the file become sets with the
    cells, facets and points that the file tags. Unused points are dropped. Cells of second order
    keep their curved edges; what a file has inside facets and cells is not read but follows from
    the edges, so that serendipity cells (quad8, wedge15, hexahedron20) become complete ones.
    Inverted cells are reoriented, unless they overlap others. A line that cannot be read is an
    error, and so is a number of cells that differs from a plain count of the lines of the file.
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
    """Content of the file `full`, in messages as `written` in the scene, compared with a plain
    count of its lines. Readers may print, or run out of memory on damaged files: both are
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
    try:
        with _bounded_address_space(BASE + PER_BYTE * full.stat().st_size):
            data = full.read_bytes()
            content = OWN[kind](data, written) if kind in OWN else by_meshio.read(full, kind)
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


@contextmanager
def _bounded_address_space(extra: int) -> Iterator[None]:
    """Context that limits the address space of this process to its present size and `extra` bytes:
    larger allocations raise MemoryError. Without effect on systems that have no such limit."""
    try:
        import resource

        size = int(psutil.Process().memory_info().vms)
        before = resource.getrlimit(resource.RLIMIT_AS)
        limits = [size + extra, *(v for v in before if v != resource.RLIM_INFINITY)]
        resource.setrlimit(resource.RLIMIT_AS, (min(limits), before[1]))
    except (ImportError, OSError, ValueError):
        yield
        return
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


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
    """Mesh of the cells of the highest dimension, scaled, with cells turned the right way round,
    sets of its groups, and notes. new: number in the mesh of each point of the file, -1 for unused
    ones; cells of second order are made from those of first order and their bent edges."""
    d = max((block.dimension for block in content.blocks), default=0)
    chosen = [i for i, block in enumerate(content.blocks) if block.dimension == d]
    cells = _corners(content, d, [content.blocks[i] for i in chosen])
    points = scale * _coordinates(content.points, cells, d)
    used = np.unique(cells)
    new = np.full(len(points), -1, dtype=np.int64)
    new[used] = np.arange(used.size)
    sets = sets_of(content, d, chosen, new)
    mesh = Mesh(points[used], oriented(points[used], new[cells]), sets.points,
                facet_sets=sets.facets, cell_sets=sets.cells, notes=content.notes)
    check_mesh(mesh)
    ends, middles = _edge_nodes([content.blocks[i] for i in chosen])
    if len(ends):
        check_mesh(mesh := _unfolded(mesh, *_bent(points, new, ends, middles), name))
    return replace(mesh, notes=(*mesh.notes, *_others(content, d, name),
                                *_notes(mesh, sets, name)))


def _others(content: Content, d: int, name: str) -> Iterator[Note]:
    """Note on elements of lower dimension than d in files whose elements are parts of a structure;
    in others, such as Gmsh's (sections with $), they are there to name something. place: line and
    keyword of a block of elements, such as `:67: *ELEMENT`; name: of the file."""
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
    """Notes about groups of the file of which the body has nothing (sets.empty), or not all facets
    that the file lists; name: of the file."""
    notes = []
    if sets.empty:
        notes.append(information(
            f"{name}: no point of the groups {', '.join(sets.empty)[:200]} is in a cell of the "
            "body: they are left out", "mesh_file"))
    facets, _ = cell_facets(mesh.cells, mesh.dimension)
    for key, tagged in sets.facets.items():
        lost = int(np.count_nonzero(~rows_among(tagged, facets)))
        if lost:
            kind = "edges" if mesh.dimension == 2 else "faces"
            notes.append(Note(
                f"{name}: {lost} of {len(tagged)} {kind} of the group {key!r} are no {kind} of "
                "cells of the body, so that loads leave them out: mesh both together",
                "mesh_file"))
    return notes


def _corners(content: Content, d: int, blocks: Sequence[CellBlock]) -> IntArray:
    """(E, p) corners of the cells of all blocks, which have the highest dimension d, one block
    after the other; shorter rows repeat their last corner. InputError for cells of other kinds, or
    with points that do not exist."""
    wrong = [b for b in blocks if d < 2 or b.kind not in CELLS]
    if wrong or not blocks:
        found = ", ".join(sorted({b.kind for b in blocks})) or "no cells"
        at = next((f"{b.place.strip()} has " for b in wrong if b.place), "")
        raise InputError(
            f"{at}its highest cells are {found}; a body is made of triangles and quadrilaterals "
            "(2-D) or tetrahedra, wedges and hexahedra (3-D), of first or second order: mesh it "
            "with those"
        )
    for block in blocks:
        cells = block.nodes
        bad = np.flatnonzero(((cells < 0) | (cells >= len(content.points))).any(axis=1))
        if bad.size:
            raise InputError(f"{bad.size} cells name points that do not exist: {some(bad)}")
    stops = np.cumsum([len(b.nodes) for b in blocks])
    return np.asarray(padded([_whole(b) for b in blocks], [
        np.arange(stop - len(b.nodes), stop) for b, stop in zip(blocks, stops, strict=True)]))


def _whole(block: CellBlock) -> IntArray:
    """(n, p) corners of the cells of a block; quadrilaterals and hexahedra of first order that
    repeat corners of an edge or of two, as triangles and wedges. InputError for others that do."""
    _, p, q = CELLS[block.kind]  # numbers of corners and nodes
    cells = block.nodes[:, :p].copy()
    repeats = np.flatnonzero((np.diff(np.sort(cells, axis=1), axis=1) == 0).any(axis=1))
    if not repeats.size or p == block.dimension + 1:
        return cells
    bad = []
    for row in repeats:
        # turned about the axis until the corners 2 and 3 (and 6 and 7 above them) are the same
        own, ring = cells[row], [0, 1, 2, 3]
        turned = [np.concatenate([np.roll(own[k : k + 4], -s) for k in range(0, p, 4)])
                  for s in ring]
        fit = next((t for t in turned if t[2] == t[3] and len(np.unique(t)) == 3 * p // 4
                    and (p == 4 or t[6] == t[7])), None) if p in (4, 8) and q == p else None
        if fit is None:
            bad.append(row)
        else:
            # shorter rows repeat their last corner: of a wedge 3 corners below, 3 above, 2 repeats
            cells[row] = fit if p == 4 else [*fit[:3], *fit[4:7], fit[6], fit[6]]
    if bad:
        raise InputError(f"{len(bad)} cells of type {block.kind} name a corner twice: "
                         f"{some(np.array(bad))}; collapsed cells are read as triangles and wedges "
                         "of first order where they are such")
    return cells


def _edge_nodes(blocks: Sequence[CellBlock]) -> tuple[IntArray, IntArray]:
    """Ends (m, 2) and node (m,) of the edges of cells of second order, once for each cell."""
    ends, middles = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
    for block in blocks:
        d, p, q = CELLS[block.kind]
        if q > p:
            edges = np.array(KINDS[d, p].edges)
            ends.append(block.nodes[:, edges].reshape(-1, 2))
            middles.append(block.nodes[:, p : p + len(edges)].ravel())
    return np.concatenate(ends), np.concatenate(middles)


def _bent(
    points: FloatArray, new: IntArray, ends: IntArray, middles: IntArray
) -> tuple[IntArray, FloatArray]:
    """Ends (m, 2), numbers in the body, and positions (m, d), m, of the nodes of edges that are not
    straight; InputError where cells have different ones on the same edge. points (n, d), m, of the
    file, new (n,): their numbers in the body; ends (k, 2), middles (k,): of the edges of all cells,
    in numbers of the file."""
    number, first, _ = group_equal_rows(np.sort(ends, axis=1))
    own, at = ends[first], points[middles[first]]
    size = np.linalg.norm(points[own[:, 1]] - points[own[:, 0]], axis=1)
    apart = np.linalg.norm(points[middles] - at[number], axis=1) > SAME * size[number]
    if apart.any():
        shown = ", ".join(f"{x:.6g}" for x in at[number[np.flatnonzero(apart)[0]]])
        raise InputError(f"{len(np.unique(number[apart]))} edges of cells of second order have "
                         f"different nodes in two cells, the first at ({shown}): the cells do not "
                         "fit together, or their nodes are in another order")
    bent = np.linalg.norm(at - points[own].mean(axis=1), axis=1) > STRAIGHT * size
    return new[own[bent]], at[bent]


def _unfolded(linear: Mesh, edges: IntArray, places: FloatArray, name: str) -> Mesh:
    """Mesh of second order with nodes at places (m, d) on edges (m, 2) with these ends. Where they
    fold a cell over, as mesh generators do at the bores of coarse meshes, all edges of the cell are
    bent half as much, until they do not; a note says so. bend (m,): factor of the distance of a
    node from the middle of its edge, 0 below a hundredth; name: of the file."""
    from sparsemor.bodies.fem import element_matrices

    made = mesh = with_midpoints(linear, edges, places)
    n, straight = len(linear.points), linear.points[edges].mean(axis=1)
    keys = np.sort(edges, axis=1) @ np.array([n, 1])  # edges as single integers
    eased: BoolArray = np.zeros(len(edges), np.bool_)
    bend, bad = np.ones(len(edges)), np.zeros(0, np.int64)
    while (now := element_matrices.folded(mesh)).size:
        bad = np.union1d(bad, now)
        own = np.concatenate([np.sort(cells[:, np.array(KINDS[linear.dimension, cells.shape[1]]
                                                        .edges)].reshape(-1, 2), axis=1)
                              for _, cells in by_kind(linear.cells[now], linear.dimension)])
        here = np.isin(keys, own @ np.array([n, 1]))
        if not bend[here].any():
            break  # folded over by their corners: the check of the mesh says so
        eased = eased | here
        bend = np.where(here, 0.5 * bend * (bend > 1e-2), bend)
        mesh = with_midpoints(linear, edges, straight + bend[:, None] * (places - straight))
    if not bad.size:
        return mesh
    away = np.linalg.norm(mesh.points - made.points, axis=1).max()
    return replace(mesh, notes=(*mesh.notes, Note(
        f"{name}: {bad.size} of {len(mesh.cells)} cells are folded over by their curved edges "
        f"({some(bad)}): {np.count_nonzero(eased)} edges are bent less, by up to {away:.3g} m; "
        "optimise the mesh of second order (Gmsh: Mesh.HighOrderOptimize), or make it finer",
        "mesh_file")))


def _coordinates(points: FloatArray, cells: IntArray, d: int) -> FloatArray:
    """(n, d) coordinates of the points; those of a plane mesh may have a third, constant one.
    InputError for solids in the plane, or plane cells that do not lie in a plane z = constant."""
    if points.shape[1] < d:
        raise InputError(f"its points have {points.shape[1]} coordinates, and solids take 3")
    across = points[np.unique(cells), d:]
    extent = float(np.ptp(points[np.unique(cells)], axis=0).max())
    if across.size and float(np.ptp(across)) > 1e-9 * extent:
        raise InputError(
            f"its cells do not lie in the plane z = constant (z from {across.min():.6g} to "
            f"{across.max():.6g}); a shell in space is not supported"
        )
    return points[:, :d]
