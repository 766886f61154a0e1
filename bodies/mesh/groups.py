"""Groups, tags and sets of a mesh file as sets of points."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from sparsemor.core import IntArray

SIMPLEX = {2: "triangle", 3: "tetra"}
GMSH_WORD = ("point", "curve", "surface", "volume")
"""Gmsh's term for a group of each dimension; a tag 3 of lines without a name is `curve_3`."""


def dimension_of(cell_type: str) -> int:
    """Dimension (0 to 3) of a cell type, by its name in meshio."""
    from meshio._mesh import topological_dimension

    return int(topological_dimension[cell_type])


def named_points(raw: Any) -> dict[str, IntArray]:
    """Name -> point numbers (unsorted, possibly repeated) of the sets of a meshio mesh.

    Where a point set and a set of cells share a name, the point set is used.
    """
    gathered: dict[str, list[IntArray]] = {}
    for name, points in (*_cell_sets(raw), *_physical(raw)):
        gathered.setdefault(name, []).append(points)
    sets = {name: np.concatenate(parts) for name, parts in gathered.items()}
    return sets | {
        str(name): np.asarray(points, dtype=np.int64) for name, points in raw.point_sets.items()
    }


def _cell_sets(raw: Any) -> Iterator[tuple[str, IntArray]]:
    for name, per_block in raw.cell_sets.items():
        if str(name).startswith("gmsh:"):  # bookkeeping of the format, not the user's names
            continue
        for block, numbers in zip(raw.cells, per_block, strict=True):
            if numbers is not None and len(numbers):
                chosen = np.asarray(block.data)[np.asarray(numbers, dtype=np.int64)]
                yield str(name), chosen.ravel().astype(np.int64)


def _physical(raw: Any) -> Iterator[tuple[str, IntArray]]:
    tags = raw.cell_data.get("gmsh:physical")
    if tags is None:
        return
    names = {(int(d), int(tag)): str(name) for name, (tag, d) in raw.field_data.items()}
    for block, block_tags in zip(raw.cells, tags, strict=True):
        d = dimension_of(block.type)
        for tag in np.unique(block_tags):
            if tag != 0:  # 0 is Gmsh's "in no group"
                name = names.get((d, int(tag)), f"{GMSH_WORD[d]}_{int(tag)}")
                chosen = np.asarray(block.data)[np.asarray(block_tags) == tag]
                yield name, chosen.ravel().astype(np.int64)
