"""Mesh files read by meshio: VTK, Medit, Salome."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.bodies.mesh.formats.file_content import (
    CELLS,
    CellBlock,
    Content,
    MeshGroup,
    dimension_of,
)
from sparsemor.bodies.mesh.formats.gmsh import WORD

TAGS = ("gmsh:physical", "medit:ref", "CellEntityIds")
"""Names in meshio of data of cells that are tags of groups."""


def read(full: Path, kind: str) -> Content:
    """Content of a file of meshio's format `kind`; any exception where it cannot be read."""
    import meshio

    meshio._mesh.topological_dimension.setdefault("wedge15", 3)  # it knows all others
    readers = {"vtk": meshio.vtk, "vtu": meshio.vtu, "medit": meshio.medit, "med": meshio.med}
    with _silent():
        raw = readers[kind].read(str(full))
    return content_of(raw)


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Context that suppresses printed output and warnings of meshio; the file is checked
    afterwards."""
    nowhere = io.StringIO()
    with (contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere),
          warnings.catch_warnings(), np.errstate(all="ignore")):
        warnings.simplefilter("ignore")
        yield


def content_of(raw: Any) -> Content:
    """meshio's mesh as arrays of the expected shapes and types: blocks of cells with cells, and
    groups of its cell sets, tags and point sets. Raises ValueError for other shapes."""
    points = np.asarray(raw.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points of shape {points.shape}, where (n, 2) or (n, 3) is expected")
    blocks: list[CellBlock] = []
    kept: dict[int, int] = {}
    for number, block in enumerate(raw.cells):
        if not len(block.data):
            continue
        kind = str(block.type)
        dimension_of(kind)
        nodes = np.asarray(block.data, dtype=np.int64)
        count = CELLS[kind][2] if kind in CELLS else None
        if count is not None and nodes.shape[1:] != (count,):
            raise ValueError(f"cells of shape {nodes.shape}, where (n, {count}) is expected")
        kept[number] = len(blocks)  # of meshio's block among those that are not empty
        blocks.append(CellBlock(kind, nodes))
    groups: dict[str, MeshGroup] = {}
    for name, per_block in raw.cell_sets.items():
        for number, rows in enumerate(per_block):
            if rows is not None and len(rows) and not str(name).startswith("gmsh:"):
                chosen = np.asarray(rows, dtype=np.int64)
                groups.setdefault(str(name), MeshGroup()).cells.append((kept[number], chosen))
    for name, tag, number, rows in _tagged(raw, kept, blocks):
        group = name or f"{WORD[blocks[number].dimension]}_{tag}"
        groups.setdefault(group, MeshGroup()).cells.append((number, rows))
    for name, numbers in (*raw.point_sets.items(), *_point_families(raw)):
        groups.setdefault(str(name), MeshGroup()).points.append(
            np.asarray(numbers, dtype=np.int64).ravel())
    return Content(points, tuple(blocks), groups)


def _tagged(
    raw: Any, new: dict[int, int], blocks: list[CellBlock]
) -> Iterator[tuple[str, int, int, Any]]:
    """Name or "", tag, block and rows of the cells of each tag but 0, which is that of no group.

    raw: meshio's mesh; new: number of its block -> number in `blocks`, without empty ones. Names
    are in `field_data`, by dimension and tag; files of Salome have families of cells with names
    instead.
    """
    names = {(int(d), int(tag)): str(name) for name, (tag, d) in raw.field_data.items()}
    for per_block in (raw.cell_data[key] for key in TAGS if key in raw.cell_data):
        for number, block in new.items():
            tags = np.asarray(per_block[number])
            for tag in np.unique(tags):
                if tag != 0:
                    yield (names.get((blocks[block].dimension, int(tag)), ""), int(tag), block,
                           np.flatnonzero(tags == tag))
    for number, families in enumerate(raw.cell_data.get("cell_tags", ())):  # of Salome
        for family, members in getattr(raw, "cell_tags", {}).items():
            rows = np.flatnonzero(np.asarray(families) == family)
            if len(rows) and number in new:
                for name in members:
                    yield str(name), 0, new[number], rows


def _point_families(raw: Any) -> Iterator[tuple[str, Any]]:
    """Name and points of the groups of nodes of a Salome file."""
    families = np.asarray(raw.point_data.get("point_tags", ()))
    for family, members in getattr(raw, "point_tags", {}).items():
        rows = np.flatnonzero(families == family)
        yield from ((str(name), rows) for name in members if len(rows))
