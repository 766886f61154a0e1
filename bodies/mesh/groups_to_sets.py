"""Groups of a mesh file as sets of points, facets and cells of the body."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sparsemor.bodies.mesh.formats.file_content import CELLS, Content, MeshGroup
from sparsemor.core import InputError, IntArray
from sparsemor.core.model.facets import facet_keys


@dataclass(frozen=True, slots=True, eq=False)
class Sets:
    """Sets of a body: name -> sorted point numbers, facets (F, w), sorted cell numbers; names of
    the groups that contain nothing of the body."""

    points: dict[str, IntArray] = field(default_factory=dict)
    facets: dict[str, IntArray] = field(default_factory=dict)
    cells: dict[str, IntArray] = field(default_factory=dict)
    empty: list[str] = field(default_factory=list)


def sets_of(content: Content, d: int, chosen: Sequence[int], new: IntArray) -> Sets:
    """Sets of the body that consists of the blocks `chosen`, of dimension d, one after the other;
    new (n,): number in the body of each point of the file, -1 for unused ones.

    Where a group has points, edges or faces besides cells, its points are theirs: a name that is
    given to a surface and to a volume is a surface for joints and loads, and a region for
    materials. Where it has none, its points are those of its cells. A group of the file has points,
    facets, and cells as numbers of a block and rows in it.
    """
    starts = dict(zip(chosen, np.cumsum([0, *(len(content.blocks[b].nodes) for b in chosen)]),
                      strict=False))
    sets = Sets()
    for name, group in content.groups.items():
        _check(name, group, content)
        lower_points = [_renumbered(p, new) for p in group.points]
        cells, cell_nodes, facets = [], [], list(group.facets)
        for b, rows in group.cells:
            block = content.blocks[b]
            nodes = block.nodes[rows]
            if b in starts:
                cells.append(starts[b] + rows)
                cell_nodes.append(nodes)
            else:
                lower_points.append(_renumbered(nodes, new))
                if block.dimension == d - 1 and block.kind in CELLS:
                    facets.append(nodes[:, : CELLS[block.kind][1]])
        lower_points += [_renumbered(f, new) for f in facets]
        points = _union(lower_points)
        if not points.size:
            points = _union([_renumbered(nodes, new) for nodes in cell_nodes])
        if not points.size:  # such as the centre of an arc, which is in no cell
            sets.empty.append(name)
            continue
        sets.points[name] = points
        if cells:
            sets.cells[name] = _union(cells)
        in_body = [new[f][(new[f] >= 0).all(axis=1)] for f in facets if f.shape[1] >= d]
        if sum(map(len, in_body)):
            wide = max(f.shape[1] for f in in_body)
            same_width = [np.pad(f, ((0, 0), (0, wide - f.shape[1])), mode="edge")
                          for f in in_body]
            sets.facets[name] = np.unique(facet_keys(np.concatenate(same_width)), axis=0)
    return sets


def _check(name: str, group: MeshGroup, content: Content) -> None:
    """Raises InputError for a group with numbers of points or cells that the file does not have."""
    for numbers in (*group.points, *group.facets):
        if numbers.size and not 0 <= numbers.min() <= numbers.max() < len(content.points):
            raise InputError(f"set {name!r} names points that do not exist")
    for b, rows in group.cells:
        block = content.blocks[b]
        if rows.size and not 0 <= rows.min() <= rows.max() < len(block.nodes):
            raise InputError(f"set {name!r} names cells that do not exist")
        nodes = block.nodes[rows]
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(content.points):
            raise InputError(f"set {name!r} names points that do not exist")


def _renumbered(points: IntArray, new: IntArray) -> IntArray:
    """Numbers in the body of points of the file, without those that it does not have."""
    kept = new[points.ravel()]
    return np.asarray(kept[kept >= 0])


def _union(parts: Sequence[IntArray]) -> IntArray:
    """Sorted numbers that are in any of the arrays."""
    return np.unique(np.concatenate([np.zeros(0, np.int64), *parts]))
