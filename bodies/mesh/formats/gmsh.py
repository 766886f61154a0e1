"""Gmsh files (.msh) of the formats 2.2 and 4.1, text and binary.

Gmsh Reference Manual, chapter "Gmsh file formats". Physical groups become sets: those of format 4.1
by the entities, those of 2.2 by the first tag of each element. The sign of a tag is an orientation.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.bodies.mesh.formats.file_content import (
    BadLine,
    CellBlock,
    Content,
    MeshGroup,
    Numbering,
    dimension_of,
)
from sparsemor.core import FloatArray, IntArray, Note, information

TYPES = {
    1: ("line", 2), 2: ("triangle", 3), 3: ("quad", 4), 4: ("tetra", 4), 5: ("hexahedron", 8),
    6: ("wedge", 6), 7: ("pyramid", 5), 8: ("line3", 3), 9: ("triangle6", 6), 10: ("quad9", 9),
    11: ("tetra10", 10), 12: ("hexahedron27", 27), 13: ("wedge18", 18), 14: ("pyramid14", 14),
    15: ("vertex", 1), 16: ("quad8", 8), 17: ("hexahedron20", 20), 18: ("wedge15", 15),
    19: ("pyramid13", 13)}
"""Number of a type of elements -> type of cells, and its number of nodes."""
WORD = ("point", "curve", "surface", "volume")
"""Gmsh's term for a group of each dimension; a tag 3 of lines without a name is `curve_3`."""
_ORDER = {
    "tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "wedge15": [*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11],
    "hexahedron20": [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]}
"""Gmsh's corners and nodes of edges in the order of `CellKind.edges`, where that is another."""
_ORDER |= {"wedge18": _ORDER["wedge15"] + [15, 16, 17],
           "hexahedron27": _ORDER["hexahedron20"] + [*range(20, 27)]}
_REFUSED = {
    "$PartitionedEntities": "partitioned meshes are not supported: save it in one piece",
    "$NOD": "format 1 is not supported: save it as 4.1 (Mesh.MshFileVersion = 4.1)",
    "$ELM": "format 1 is not supported: save it as 4.1 (Mesh.MshFileVersion = 4.1)"}
_READ = {"$MeshFormat", "$PhysicalNames", "$Entities", "$Nodes", "$ParametricNodes", "$Elements",
         "$Comments"}


def read(data: bytes, name: str) -> Content:
    """Content of a Gmsh file; InputError with the line (text) and section of what cannot be read.
    """
    return _GmshReader(data, name).content()


class _Section:
    """Numbers of one section, one after the other; line: of its first line."""

    def __init__(self, name: str, data: bytes, line: int, binary: bool) -> None:
        self.name, self.data, self.line, self.binary = name, data, line, binary
        self.words = [] if binary else data.split()
        self.at = 0

    def fail(self, message: str) -> BadLine:
        """Error at the present number."""
        line = self.line
        if not self.binary:
            seen = 0
            for line, text in enumerate(self.data.split(b"\n"), self.line):  # noqa: B007
                seen += len(text.split())
                if seen >= self.at:
                    break
        return BadLine(line, self.name, message)

    def _take(self, count: int, kind: str) -> NDArray[Any]:
        """The next numbers of the section, of NumPy's type `kind`, as 64-bit ones. Raises BadLine
        where there are fewer, or others. at: position of the next one, a byte of `data` in a binary
        section, else a word of `words`."""
        if count < 0:
            raise self.fail(f"a count of {count}")
        if self.binary:
            size = np.dtype(kind).itemsize
            if count > (len(self.data) - self.at) // size:
                raise self.fail(f"ends where {count} more numbers were announced")
            found = np.frombuffer(self.data, kind, count, self.at)
            self.at += count * size
            return found.astype(np.float64 if kind == "<f8" else np.int64)
        words = self.words[self.at : self.at + count]
        self.at += len(words)
        if len(words) < count:
            raise self.fail(f"ends where {count - len(words)} more numbers were announced")
        convert = float if kind == "<f8" else int
        try:
            if any(b"_" in w for w in words):
                raise ValueError
            return np.array([convert(w) for w in words],
                            dtype=np.float64 if kind == "<f8" else np.int64)
        except (ValueError, OverflowError):
            bad = next((i for i, w in enumerate(words) if not _number(w, kind)), 0)
            self.at += bad + 1 - len(words)
            shown = words[bad][:40].decode("ascii", "replace")
            raise self.fail(f"{shown!r} is no {'' if kind == '<f8' else 'whole '}number") from None

    def ints(self, count: int) -> IntArray:
        return self._take(count, "<i4").astype(np.int64)

    def sizes(self, count: int) -> IntArray:
        return self._take(count, "<u8").astype(np.int64)

    def reals(self, count: int) -> FloatArray:
        return self._take(count, "<f8").astype(np.float64)

    def done(self) -> None:
        rest = self.data[self.at:].strip() if self.binary else self.words[self.at:]
        if rest:
            self.at += 0 if self.binary else 1
            raise self.fail("goes on after the last number that was announced")


def _number(word: bytes, kind: str) -> bool:
    if kind == "<f8":
        try:
            return b"_" not in word and float(word) is not None
        except ValueError:
            return False
    return re.fullmatch(rb"[+-]?\d{1,18}", word) is not None


@dataclass(slots=True, eq=False)
class _Elements:
    """Elements of one type, as the file has them: node labels and, of each, its groups."""

    nodes: list[IntArray] = field(default_factory=list)
    tags: list[tuple[int, IntArray]] = field(default_factory=list)
    """Tag of a group, rows."""
    count: int = 0


class _GmshReader:
    """Reader of one file: its sections in their order."""

    def __init__(self, data: bytes, name: str) -> None:
        """data, name: content and name of the file.

        names: (dimension, tag) -> name of a group; labels, points: of nodes, block by block;
        elements: Gmsh's number of a type -> its elements; skipped: names of sections not read.
        """
        self.data, self.name = data, name
        self.version = ""
        self.binary = False
        self.names: dict[tuple[int, int], str] = {}
        self.groups_of: dict[tuple[int, int], IntArray] = {}
        """Dimension and number of an entity -> tags of its groups."""
        self.labels: list[IntArray] = []
        self.points: list[FloatArray] = []
        self.elements: dict[int, _Elements] = {}
        self.skipped: list[str] = []

    def content(self) -> Content:
        """Points, cells and groups of the file: one block of cells for each type of elements, and a
        group for each tag, named by `$PhysicalNames` or by its dimension and number. Raises BadLine
        for nodes that are missing or there twice."""
        lines = {}
        for name, start, end, line in self._sections():
            lines[name] = line - 1
            self._section(name, self.data[start:end], line)
        if not self.version:
            raise BadLine(1, "$MeshFormat", "is missing: this is no Gmsh file")
        numbering = Numbering(np.concatenate([np.zeros(0, np.int64), *self.labels]))
        twice = numbering.repeated()
        if twice is not None:
            raise BadLine(lines["$Nodes"], "$Nodes", f"there are two nodes {twice}")
        blocks: list[CellBlock] = []
        groups: dict[str, MeshGroup] = {}
        for number, found in self.elements.items():
            kind, _ = TYPES[number]
            given = np.concatenate(found.nodes)
            rows = numbering.rows(given)
            if (rows < 0).any():
                raise BadLine(lines["$Elements"], "$Elements",
                              f"there is no node {given[rows < 0][0]}")
            rows = rows[:, _ORDER[kind]] if kind in _ORDER else rows
            tags = found.tags
            if self.version != "4.1":
                rows, tags = _once(rows, tags)
            place = f":{lines['$Elements']}: $Elements of type {number}"
            blocks.append(CellBlock(kind, rows, place))
            d = blocks[-1].dimension
            for tag, members in tags:
                name = self.names.get((d, tag), f"{WORD[d]}_{tag}")
                groups.setdefault(name, MeshGroup()).cells.append((len(blocks) - 1, members))
        points = np.concatenate([np.zeros((0, 3)), *self.points])
        return Content(points, tuple(blocks), groups, tuple(self._notes()))

    def _notes(self) -> list[Note]:
        """Notes on sections that are not read and on groups without elements."""
        notes = []
        if self.skipped:
            notes.append(information(f"{self.name}: the sections {', '.join(self.skipped)[:200]} "
                                     "are not read", "mesh_file"))
        used = {(dimension_of(TYPES[number][0]), tag) for number, found in self.elements.items()
                for tag, _ in found.tags}
        empty = [name for at, name in self.names.items() if at not in used]
        if empty:
            hint = ("" if self.version == "4.1" else
                    " (Mesh.SaveAll of this format drops them: save it as 4.1)")
            notes.append(Note(f"{self.name}: no element of the file is in the groups "
                              f"{', '.join(empty)[:200]}{hint}", "mesh_file"))
        return notes

    def _sections(self) -> list[tuple[str, int, int, int]]:
        """Name, first and last byte and first line of the content of each section, $Name to
        $EndName. BadLine for what is outside of sections, or for one that is not closed or not
        supported."""
        found = []
        at, line = 0, 1
        while True:
            head = re.compile(rb"[ \t\r\n]*(\$[A-Za-z0-9]+)[ \t]*\r?\n").match(self.data, at)
            if head is None:
                break
            name = head.group(1)
            if name.decode() in _REFUSED:
                first = line + self.data.count(b"\n", at, head.start(1))
                raise BadLine(first, name.decode(), _REFUSED[name.decode()])
            end = self.data.find(b"$End" + name[1:], head.end())
            if name.startswith(b"$End") or end < 0:
                raise BadLine(line + self.data.count(b"\n", at, head.end(1)), name.decode(),
                              "a section ends that did not begin" if end >= 0 or
                              name.startswith(b"$End") else f"has no $End{name[1:].decode()}")
            first = line + self.data.count(b"\n", at, head.end())
            found.append((name.decode(), head.end(), end, first))
            after = end + len(name) + 3
            line = first + self.data.count(b"\n", head.end(), after)
            at = after
        rest = self.data[at:].strip()
        if rest or not found:
            shown = rest[:40].split(b"\n")[0].decode("ascii", "replace")
            raise BadLine(line + (1 if found else 0), "$", f"a section starts here with $, not "
                          f"{shown!r}")
        return found

    def _section(self, name: str, data: bytes, line: int) -> None:
        """Reads the content `data` of the section `name` that begins at this line, in the form of
        the file's version (2.2 or 4.1); sections that no mesh needs are noted (skipped)."""
        if name == "$MeshFormat":
            self._format(data, line)
            return
        if not self.version:
            raise BadLine(line - 1, name, "comes before $MeshFormat")
        if name not in _READ:
            self.skipped.append(name)
            return
        section = _Section(name, data, line, self.binary)
        if name == "$PhysicalNames":
            self._physical_names(data, line)
        elif name == "$Entities" and self.version == "4.1":
            self._entities(section)
        elif name == "$Nodes":
            (self._nodes if self.version == "4.1" else self._nodes_22)(section)
        elif name == "$ParametricNodes":
            self._parametric_22(section)
        elif name == "$Elements":
            (self._elements if self.version == "4.1" else self._elements_22)(section)

    def _format(self, data: bytes, line: int) -> None:
        """$MeshFormat: version, text (0) or binary (1), size of reals; in a binary file then a 1,
        by which the order of bytes is checked. BadLine for what is not supported."""
        words = data.split(b"\n", 1)[0].split()
        if len(words) != 3 or self.version:
            raise BadLine(line, "$MeshFormat", "takes version, file type and data size, once")
        self.version = words[0].decode("ascii", "replace")
        self.binary = words[1] == b"1"
        if self.version not in ("2.2", "2.1", "2", "2.0", "4.1"):
            raise BadLine(line, "$MeshFormat", f"version {self.version[:20]} is not supported: "
                          "save it as 4.1 or 2.2 (Mesh.MshFileVersion = 4.1)")
        if words[1] not in (b"0", b"1") or words[2] != b"8":
            raise BadLine(line, "$MeshFormat", "file type 0 or 1 and data size 8 are supported")
        if self.binary and data.split(b"\n", 1)[1][:4] != b"\1\0\0\0":
            raise BadLine(line, "$MeshFormat", "binary numbers are not little-endian")

    def _physical_names(self, data: bytes, line: int) -> None:
        """$PhysicalNames: (dimension, tag) -> name of a group, from a count and lines `dimension
        tag "name"`; the sign of a tag is an orientation. line: number of the first line."""
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
        lines = [(n, t.strip()) for n, t in enumerate(text.split("\n"), line) if t.strip()]
        if not lines or not lines[0][1].isdecimal() or int(lines[0][1]) != len(lines) - 1:
            raise BadLine(line, "$PhysicalNames", "the number of names is not that of the lines")
        for number, row in lines[1:]:
            found = re.fullmatch(r'([0-3])\s+([+-]?\d{1,18})\s+"(.*)"', row)
            if found is None or not found.group(3).strip():
                raise BadLine(number, "$PhysicalNames", 'each line is: dimension, tag, "name"')
            at = int(found.group(1)), abs(int(found.group(2)))
            if at in self.names:
                raise BadLine(number, "$PhysicalNames", f"tag {at[1]} of dimension {at[0]} has a "
                              "name already")
            self.names[at] = found.group(3)

    # format 4.1

    def _entities(self, section: _Section) -> None:
        """$Entities (4.1): entity of the geometry -> tags of its groups. Counts of points, curves,
        surfaces and volumes; then of each its number, position or bounding box, tags, and, but for
        points, the entities that bound it. The sign of a tag is an orientation."""
        for d, count in enumerate(section.sizes(4)):
            for _ in range(count):
                number = int(section.ints(1)[0])
                section.reals(3 if d == 0 else 6)
                tags = section.ints(int(section.sizes(1)[0]))
                if d:
                    section.ints(int(section.sizes(1)[0]))
                if (d, number) in self.groups_of:
                    raise section.fail(f"there are two entities {number} of dimension {d}")
                self.groups_of[d, number] = np.unique(np.abs(tags))
        section.done()

    def _nodes(self, section: _Section) -> None:
        """$Nodes (4.1): blocks of labels and coordinates. Head: number of blocks, of nodes, least
        and greatest label; of a block: dimension and number of its entity, 1 if its coordinates are
        followed by d parameters, number of nodes."""
        blocks, total = (int(n) for n in section.sizes(4)[:2])
        read = 0
        for _ in range(blocks):
            d, _, parametric = (int(n) for n in section.ints(3))
            count = int(section.sizes(1)[0])
            if not 0 <= d <= 3 or parametric not in (0, 1):
                raise section.fail("a block of nodes starts with dimension, number, 0 or 1")
            self.labels.append(section.sizes(count))
            width = 3 + d * parametric
            self.points.append(section.reals(count * width).reshape(-1, width)[:, :3])
            read += count
        if read != total:
            raise section.fail(f"{total} nodes were announced, {read} are here")
        section.done()

    def _elements(self, section: _Section) -> None:
        """$Elements (4.1): blocks of elements of one type on one entity. Head: number of blocks, of
        elements, least and greatest label; of a block: dimension and number of its entity, type,
        number of elements; of an element: its label, node labels."""
        blocks, total = (int(n) for n in section.sizes(4)[:2])
        read = 0
        for _ in range(blocks):
            d, entity, number = (int(n) for n in section.ints(3))
            count = int(section.sizes(1)[0])
            width = self._width(section, number) + 1
            rows = section.sizes(count * width).reshape(-1, width)
            if self.groups_of and (d, entity) not in self.groups_of:
                raise section.fail(f"there is no entity {entity} of dimension {d} in $Entities")
            if count:
                self._add(number, rows[:, 1:], self.groups_of.get((d, entity), ()))
            read += count
        if read != total:
            raise section.fail(f"{total} elements were announced, {read} are here")
        section.done()

    def _width(self, section: _Section, number: int) -> int:
        """Number of nodes of elements of a type. Raises BadLine for one that is not supported."""
        if number not in TYPES:
            raise section.fail(f"elements of type {number} are not supported: save the mesh with "
                               "elements of order 1 or 2")
        return TYPES[number][1]

    def _add(self, number: int, nodes: IntArray, tags: Sequence[int] | IntArray) -> None:
        """Adds elements of a type, with node labels (n, q), that are all in the groups `tags`."""
        found = self.elements.setdefault(number, _Elements())
        rows = np.arange(found.count, found.count + len(nodes))
        found.nodes.append(nodes)
        found.count += len(nodes)
        found.tags += [(int(tag), rows) for tag in tags]

    # format 2.2

    def _nodes_22(self, section: _Section) -> None:
        """$Nodes (2.2): label and coordinates of each node; in a binary file 4 + 3 x 8 bytes
        each."""
        count = self._count(section)
        if section.binary:
            raw = section.data[section.at:]
            if len(raw) < 28 * count or count < 0:
                raise section.fail(f"ends before the {count} nodes that were announced")
            rows = np.frombuffer(raw, [("n", "<i4"), ("x", "<f8", 3)], count)
            self.labels.append(rows["n"].astype(np.int64))
            self.points.append(rows["x"].astype(np.float64).reshape(-1, 3))
            section.at += 28 * count
        else:
            words = section.reals(4 * count).reshape(-1, 4)
            self.labels.append(self._whole(section, words[:, 0]))
            self.points.append(words[:, 1:])
        section.done()

    def _whole(self, section: _Section, values: FloatArray) -> IntArray:
        """Labels that were read as reals. Raises BadLine for one that is no whole number."""
        if not (np.abs(values) < 2**53).all() or (values != np.floor(values)).any():
            raise section.fail("a number of a node is no whole number")
        return values.astype(np.int64)

    def _count(self, section: _Section) -> int:
        """Count in the first line, which is text in binary files, too."""
        if not section.binary:
            return int(section.ints(1)[0])
        first, _, _ = section.data.partition(b"\n")
        section.at = len(first) + 1
        if not re.fullmatch(rb"\s*\d{1,18}\s*", first):
            raise section.fail("does not start with a count")
        return int(first)

    def _parametric_22(self, section: _Section) -> None:
        """$ParametricNodes (2.2): as $Nodes, with the dimension d and number of an entity of the
        geometry and, on curves and surfaces, d parameters on it, which are dropped."""
        count = self._count(section)
        labels, points = [], []
        for _ in range(count):
            labels.append(section.ints(1))
            points.append(section.reals(3))
            d = int(section.ints(2)[0])
            if d not in (0, 1, 2, 3):
                raise section.fail("a node is: number, x, y, z, dimension, entity, parameters")
            section.reals(d if d in (1, 2) else 0)
        if count:
            self.labels.append(np.concatenate(labels))
            self.points.append(np.array(points))
        section.done()

    def _binary_22(self, section: _Section, count: int) -> dict[tuple[int, int], IntArray]:
        """(type, number of tags) -> tags and nodes of each element, a row each. A block has the
        head type, number of elements, number of tags; an element its label, tags, nodes."""
        gathered: dict[tuple[int, int], list[IntArray]] = {}
        read = 0
        while read < count:
            number, several, tags = (int(n) for n in section.ints(3))
            if not 0 <= tags < 1000 or several < 1:
                raise section.fail(f"{tags} tags of {several} elements")
            width = 1 + tags + self._width(section, number)
            gathered.setdefault((number, tags), []).append(
                section.ints(several * width).reshape(-1, width)[:, 1:])
            read += several
        if read != count:
            raise section.fail(f"{count} elements were announced, {read} are here")
        return {key: np.concatenate(parts) for key, parts in gathered.items()}

    def _text_22(self, section: _Section, count: int) -> dict[tuple[int, int], IntArray]:
        """(type, number of tags) -> tags and nodes of each element, a row each. An element: label,
        type, number of tags, tags, nodes. starts: position of the elements of each key among the
        numbers."""
        first = section.at
        values = section.ints(len(section.words) - first)
        numbers, at, starts = values.tolist(), 0, dict[tuple[int, int], list[int]]()
        for _ in range(count):
            if at + 3 > len(numbers):
                section.at = len(section.words)
                raise section.fail(f"ends before the {count} elements that were announced")
            number, tags = numbers[at + 1 : at + 3]
            section.at = first + at + 2
            if not 0 <= tags < 1000:
                raise section.fail(f"{tags} tags of an element")
            starts.setdefault((number, tags), []).append(at)
            at += 3 + tags + self._width(section, number)
        section.at = first + at
        if at > len(numbers):
            raise section.fail(f"ends before the {count} elements that were announced")
        return {(number, tags): values[np.array(rows)[:, None] + np.arange(
                    3, 3 + tags + TYPES[number][1])] for (number, tags), rows in starts.items()}

    def _elements_22(self, section: _Section) -> None:
        """$Elements (2.2): elements of all types, each with tags; the first is its group."""
        count = self._count(section)
        found = (self._binary_22 if section.binary else self._text_22)(section, count)
        section.done()
        for (number, tags), rows in found.items():
            groups = np.abs(rows[:, 0]) if tags else np.zeros(len(rows), np.int64)
            for tag in np.unique(groups):
                self._add(number, rows[groups == tag][:, tags:], (tag,) if tag else ())




def _once(
    nodes: IntArray, tags: list[tuple[int, IntArray]]
) -> tuple[IntArray, list[tuple[int, IntArray]]]:
    """Elements (n, q) of one type, node numbers, without those that are written again, and the rows
    of each tag among the others: format 2.2 writes an element once for each of its groups."""
    _, first, of = np.unique(
        np.sort(nodes, axis=1), axis=0, return_index=True, return_inverse=True)
    if len(first) == len(nodes):
        return nodes, tags
    kept = np.sort(first)
    new = np.searchsorted(kept, first)[of.ravel()]
    return nodes[kept], [(tag, np.unique(new[rows])) for tag, rows in tags]
