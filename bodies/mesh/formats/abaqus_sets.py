"""Node sets, element sets and surfaces of an Abaqus file as numbers of points and elements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sparsemor.bodies.mesh.formats.abaqus_statements import integer, key_of, shown
from sparsemor.bodies.mesh.formats.file_content import (
    CELLS,
    BadLine,
    CellBlock,
    MeshGroup,
    Numbering,
)
from sparsemor.core import BoolArray, IntArray
from sparsemor.core.model.facets import cell_facets, facet_numbers
from sparsemor.core.protocols.cells import KINDS, padded

_FACES = {
    "triangle": ((0, 1), (1, 2), (2, 0)), "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3),
                   (3, 7, 4, 0))}
"""Corners of the faces S1, S2, ... of each kind of cells."""
MODEL = ""
"""Name of the scope outside parts and assembly."""


@dataclass(slots=True, eq=False)
class Scope:
    """Nodes (labels, coordinates in the unit of the file), elements (blocks) and sets of a part, of
    an instance, of the assembly, or of a file without parts, as the file writes them; line: where
    it starts. Sets (nodes, elements, surfaces): name -> definitions, whose union it is."""

    name: str
    line: int
    labels: list[int] = field(default_factory=list)
    coordinates: list[tuple[float, float, float]] = field(default_factory=list)
    starts: list[tuple[int, int]] = field(default_factory=list)
    """Number of nodes before each *NODE, and its line."""
    blocks: list[tuple[str, list[int], list[list[int]], str]] = field(default_factory=list)
    """Type of cells, element labels, node labels, place."""
    nsets: dict[str, list["SetDefinition"]] = field(default_factory=dict)
    elsets: dict[str, list["SetDefinition"]] = field(default_factory=dict)
    surfaces: dict[str, list["SetDefinition"]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class SetDefinition:
    """Data lines of a set: (line, words); how: list, range, elements (nodes of an element set) or,
    of a surface, ELEMENT or NODE; instance: to which its labels belong."""

    keyword: str
    how: str
    lines: list[tuple[int, list[str]]]
    instance: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Copy of the mesh of a scope: numbers of its first point, of its first element and of the
    first element of each of its blocks among all; its numberings."""

    scope: Scope
    first_point: int
    first_element: int
    starts: IntArray
    nodes: Numbering
    elements: Numbering


class AbaqusSets:
    """Sets of all scopes as numbers of points and of elements among all."""

    def __init__(self, placed: Mapping[str, Placed], spelled: Mapping[str, Mapping[str, None]],
                 blocks: Sequence[CellBlock]) -> None:
        self.placed, self.spelled, self.blocks = placed, spelled, blocks
        self.missing: list[str] = []
        """Remarks on ranges with labels that do not exist."""
        self.starts = np.cumsum([0, *(len(b.nodes) for b in blocks)])
        self.known: dict[tuple[str, str, str], IntArray] = {}
        self.active: set[tuple[str, str, str]] = set()
        self.top = max((b.dimension for b in blocks), default=0)

    def groups(self) -> dict[str, MeshGroup]:
        """Groups by every spelling of their names; a set of an instance as `instance.set`, and as
        `set` too, unless the model outside of parts has one of this name; all elements of an
        instance as `instance`. placed: scope -> its mesh in the numbering of the model."""
        found: dict[str, MeshGroup] = {}
        outer = self.placed[MODEL].scope
        taken = {*outer.nsets, *outer.elsets, *outer.surfaces}
        for scope, placed in self.placed.items():
            own = placed.scope
            for key in dict.fromkeys([*own.nsets, *own.elsets, *own.surfaces]):
                names = [""] if scope == MODEL else [f"{n}." for n in self._spellings(scope)]
                if scope != MODEL and key not in taken:
                    names.append("")
                for name in (a + b for a in names for b in self._spellings(key)):
                    self._collect(found.setdefault(name, MeshGroup()), scope, key)
            if scope != MODEL and placed.starts[-1] > placed.first_element:
                for name in self._spellings(scope):
                    if name not in taken:
                        self._tag(found.setdefault(name, MeshGroup()),
                                  np.arange(placed.first_element, placed.starts[-1]))
        return found

    def _spellings(self, key: str) -> list[str]:
        """Names under which a set is known: as the file spells it, and in capitals."""
        return list({**self.spelled.get(key, {}), key: None})

    def _collect(self, group: MeshGroup, scope: str, key: str) -> None:
        """Adds to a group the nodes, elements and surfaces of a name in a part or instance."""
        own = self.placed[scope].scope
        if key in own.nsets:
            group.points.append(self.numbers("node", scope, key))
        if key in own.elsets:
            self._tag(group, self.numbers("element", scope, key))
        for entry in own.surfaces.get(key, ()):
            self._surface(group, scope, entry)

    def _tag(self, group: MeshGroup, elements: IntArray) -> None:
        """Adds elements, by numbers in the whole model, to a group: block and rows in it."""
        block_of = np.searchsorted(self.starts, elements, side="right") - 1
        for b in np.unique(block_of):
            group.cells.append((int(b), elements[block_of == b] - self.starts[b]))

    def numbers(self, what: str, scope: str, key: str) -> IntArray:
        """Sorted numbers, in the model, of the nodes or elements (what) of the set `key` of a
        scope. known: results; active: sets that are being evaluated, to find one that contains
        itself."""
        at = (what, scope, key)
        if at not in self.known:
            sets = self.placed[scope].scope
            entries = (sets.nsets if what == "node" else sets.elsets)[key]
            if at in self.active:
                line = next((n for e in entries for n, _ in e.lines), sets.line)
                raise BadLine(line, entries[0].keyword, f"the set {key} contains itself")
            self.active.add(at)
            parts = [p for entry in entries for p in self._entry(what, scope, entry)]
            self.known[at] = np.unique(np.concatenate([np.zeros(0, np.int64), *parts]))
            self.active.remove(at)
        return self.known[at]

    def _entry(self, what: str, scope: str, entry: SetDefinition) -> list[IntArray]:
        """Numbers of the nodes or elements (`what`) of one definition of a set: how `block`: all
        elements of the blocks with these numbers in its scope; `elements`: the nodes of an element
        set; `range`: first, last, step; else a list of labels and names of sets, whose labels are
        those of the scope `where`."""
        where = self._scope(entry.instance or scope, entry)
        placed = self.placed[where]
        if entry.how == "block":
            return [np.arange(placed.starts[b], placed.starts[b + 1])
                    for _, words in entry.lines for b in map(int, words)]
        if entry.how == "elements":
            return [self._nodes_of(self._named("element", scope, where, words[0], line, entry))
                    for line, words in entry.lines]
        if entry.how == "range":
            return [self._range(what, placed, words, line, entry) for line, words in entry.lines]
        found = []
        for line, words in entry.lines:
            labels = [w for w in words if w.isdecimal()]
            if labels:
                found.append(self._labelled(what, where, labels, line, entry))
            found += [self._named(what, scope, where, w, line, entry)
                      for w in words if w and not w.isdecimal()]
        return found

    def _scope(self, name: str, entry: SetDefinition) -> str:
        """The name of a part or instance. Raises BadLine for one that is not there."""
        if name not in self.placed:
            line = next((n for n, _ in entry.lines), 0)
            raise BadLine(line, entry.keyword, f"there is no instance {name!r}")
        return name

    def _labelled(self, what: str, scope: str, words: Sequence[str], lines: int | Sequence[int],
                  entry: SetDefinition) -> IntArray:
        """Numbers, in the model, of nodes or elements (what) of a scope by their labels, which are
        in the given line or lines. BadLine for one that does not exist."""
        placed = self.placed[scope]
        lines = [lines] * len(words) if isinstance(lines, int) else lines
        numbers = np.array([integer(w, at, entry.keyword)
                            for w, at in zip(words, lines, strict=True)], dtype=np.int64)
        rows = (placed.nodes if what == "node" else placed.elements).rows(numbers)
        bad = np.flatnonzero(rows < 0)
        if bad.size:
            raise BadLine(lines[bad[0]], entry.keyword, f"there is no {what} {numbers[bad[0]]}")
        return rows + (placed.first_point if what == "node" else placed.first_element)

    def _range(
        self, what: str, placed: Placed, words: Sequence[str], line: int, entry: SetDefinition
    ) -> IntArray:
        """Numbers, in the model, of the nodes or elements (what) of a range of labels: first, last,
        step (GENERATE); those that do not exist are noted (missing)."""
        numbers = [integer(w, line, entry.keyword) for w in words]
        first, last, step = [*numbers, 1][:3] if len(numbers) in (2, 3) else (0, 0, 0)
        if step < 1 or last < first:
            raise BadLine(line, entry.keyword, "GENERATE takes first, last, step on each line, "
                          f"first <= last and step > 0 (given: {', '.join(words)[:80]})")
        numbering = placed.nodes if what == "node" else placed.elements
        found = numbering.between(first, last, step)
        lost = (last - first) // step + 1 - len(found)
        if lost:
            self.missing.append(
                f":{line}: {entry.keyword}: {lost} of the {what}s in this range do not exist")
        return numbering.rows(found) + (
            placed.first_point if what == "node" else placed.first_element)

    def _named(self, what: str, scope: str, where: str, word: str, line: int, entry: SetDefinition
               ) -> IntArray:
        """Numbers of the nodes or elements (what) of `set`, in the scope `where` of the definition
        or in that in which it is written (scope), `instance.set` or `instance.label`. A name may
        have a dot itself, so that each is tried. BadLine for none."""
        sets = "nsets" if what == "node" else "elsets"
        for at, key in ((where, key_of(word)), (scope, key_of(word))):
            if key in getattr(self.placed[at].scope, sets):
                return self.numbers(what, at, key)
        for dot in (i for i, letter in enumerate(word) if letter == "."):
            inside, rest = key_of(word[:dot]), word[dot + 1:]
            if inside in self.placed and inside != MODEL:
                if rest.isdecimal():
                    return self._labelled(what, inside, [rest], line, entry)
                if key_of(rest) in getattr(self.placed[inside].scope, sets):
                    return self.numbers(what, inside, key_of(rest))
        raise BadLine(line, entry.keyword, f"there is no set of {what}s {shown(word)[:80]!r}")

    def _nodes_of(self, elements: IntArray) -> IntArray:
        """Numbers of the nodes of elements, repeated where several have one."""
        group = MeshGroup()
        self._tag(group, elements)
        return np.concatenate([np.zeros(0, np.int64), *(
            self.blocks[b].nodes[rows].ravel() for b, rows in group.cells)])

    def _surface(self, group: MeshGroup, scope: str, entry: SetDefinition) -> None:
        """Adds a surface to the group: faces of single elements or of sets, or nodes (entry.how
        NODE). Words of a line: label or set, then the face, such as S2; single: face -> lines and
        labels of single elements, which are read together."""
        where = self._scope(entry.instance or scope, entry)
        what = "node" if entry.how == "NODE" else "element"
        single: dict[str, tuple[list[int], list[str]]] = {}
        for line, words in entry.lines:
            face = words[1].upper() if len(words) > 1 and what == "element" else ""
            if words[0].isdecimal():
                lines, labels = single.setdefault(face, ([], []))
                lines.append(line)
                labels.append(words[0])
            else:
                self._on(group, self._named(what, scope, where, words[0], line, entry), face,
                         line, entry)
        for face, (lines, labels) in single.items():
            self._on(group, self._labelled(what, where, labels, lines, entry), face, lines[0],
                     entry)

    def _on(
        self, group: MeshGroup, chosen: IntArray, face: str, line: int, entry: SetDefinition
    ) -> None:
        """Adds nodes, or the given face of elements, to the group of a surface."""
        if entry.how == "NODE":
            group.points.append(chosen)
            return
        found = MeshGroup()
        self._tag(found, chosen)
        for b, rows in found.cells:
            self._faces(group, b, rows, face, line, entry)

    def _faces(
        self, group: MeshGroup, b: int, rows: IntArray, face: str, line: int, entry: SetDefinition
    ) -> None:
        """Adds the face `face` of some elements (rows) of block b to the group: elements that are
        facets themselves (one dimension below `top`, the highest) as they are, on either side;
        without a name all free faces of the others. BadLine for others."""
        block, d = self.blocks[b], self.blocks[b].dimension
        if d == self.top - 1 and face in ("", "SPOS", "SNEG"):
            group.cells.append((b, rows))
            return
        if block.kind not in CELLS or d != self.top or d < 2:
            raise BadLine(line, entry.keyword, f"face {face or 'of all sides'!r} of {block.kind} "
                          "cells: only faces S1, S2, ... of solids and plane cells, and SPOS, SNEG "
                          "of the facets of a solid, are supported")
        if not face:
            group.facets.extend(self._free(b, rows))
            return
        corners = CELLS[block.kind][1]
        sides = {f"S{n}": side for n, side in enumerate(
            _FACES[KINDS[d, corners].names[0]], 1)}
        if face not in sides:
            raise BadLine(line, entry.keyword, f"face {face[:40]!r} of {block.kind} cells: they "
                          f"have {', '.join(sides)}")
        group.facets.append(block.nodes[rows][:, list(sides[face])])

    def _free(self, b: int, rows: IntArray) -> list[IntArray]:
        """(F, w) facets of cells that belong to no other cell."""
        first, facets, owner, free = self._free_facets
        mine = free & np.isin(owner, first[b] + rows)
        return [facets[mine]] if mine.any() else []

    @cached_property
    def _free_facets(self) -> tuple[dict[int, int], IntArray, IntArray, BoolArray]:
        """Number of the first cell of each block of the highest dimension among all of those;
        facets of these cells, the cell of each, and True for those that belong to no other cell."""
        d = self.top
        solids = [i for i, block in enumerate(self.blocks)
                  if block.dimension == d and block.kind in CELLS]
        stops = np.cumsum([0, *(len(self.blocks[i].nodes) for i in solids)]).tolist()
        cells = padded([self.blocks[i].nodes[:, : CELLS[self.blocks[i].kind][1]] for i in solids],
                       [np.arange(a, b) for a, b in zip(stops, stops[1:], strict=False)])
        facets, owner = cell_facets(cells, d)
        number, count = facet_numbers(facets)
        return (dict(zip(solids, stops, strict=False)), facets, owner,
                np.asarray(count[number] == 1))
