"""Nastran bulk data (also of OptiStruct): grids, elements, coordinate systems, properties.

MSC Nastran Quick Reference Guide. Small, large and free fields; a line whose first field is empty
or a mark continues the card before it. The elements of a property 7 are the set `pid_7`.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.mesh.formats.file_content import (
    COMPLETE,
    INTEGER,
    BadLine,
    CellBlock,
    Content,
    MeshGroup,
    Numbering,
    decoded,
)
from sparsemor.core import FloatArray, IntArray, information

ELEMENTS = {
    "CTRIA3": (("triangle", 3),), "CTRIAR": (("triangle", 3),), "CTRIA6": (("triangle6", 6),),
    "CQUAD4": (("quad", 4),), "CQUADR": (("quad", 4),), "CQUAD8": (("quad8", 8),),
    "CTETRA": (("tetra", 4), ("tetra10", 10)), "CPYRAM": (("pyramid", 5), ("pyramid13", 13)),
    "CPENTA": (("wedge", 6), ("wedge15", 15)), "CHEXA": (("hexahedron", 8), ("hexahedron20", 20)),
    "CBAR": (("line", 2),), "CBEAM": (("line", 2),), "CROD": (("line", 2),),
    "CTUBE": (("line", 2),), "CONROD": (("line", 2),), "PLOTEL": (("line", 2),)}
"""Card -> types of cells that it can describe, and their numbers of nodes."""
_ORDER = {"wedge15": [*range(9), 12, 13, 14, 9, 10, 11],
          "hexahedron20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]}
"""Nodes in the order of `CellKind.edges`, where that is another: Nastran has those of the edges
between both ends before those of the second one."""
_CORNERS_ONLY = {"CTRIA3", "CTRIAR", "CQUAD4", "CQUADR", "CBAR", "CBEAM", "CROD", "CTUBE",
                 "CONROD", "PLOTEL"}
"""Cards with other fields after their nodes."""
_WITHOUT_PROPERTY = {"CONROD", "PLOTEL"}
REFUSED = {
    "INCLUDE": "paste the content of that file here",
    "CTRIAX": "axisymmetric bodies are not supported", "CTRIAX6": "axisymmetric bodies are not "
    "supported", "CQUADX": "axisymmetric bodies are not supported",
    "CTRAX3": "axisymmetric bodies are not supported", "CTRAX6": "axisymmetric bodies are not "
    "supported", "CQUADX4": "axisymmetric bodies are not supported",
    "CSHEAR": "this type of elements is not supported",
    "CORD3G": "this coordinate system is not supported",
    "GRIDG": "grids on geometry are not supported", "EGRID": "this type of grids is not supported",
    "SEELT": "superelements are not supported"}
_SHAPED = re.compile(r"C(TRI|QUAD|TET|PEN|HEX|PYR|IHEX)")
"""Names of cards of solid and plane elements, known or not: no other cards are passed over."""
_NAME = re.compile(r"[A-Z][A-Z0-9_]*")
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]\d+)|[ED](\d+))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Card:
    """Card of the bulk data: name, line and data fields (those of all its lines); `at`: index of a
    field, 0 for that after the name, which is number 2 in messages."""

    name: str
    line: int
    fields: list[str]

    def fail(self, message: str) -> BadLine:
        return BadLine(self.line, self.name, message)

    def text(self, at: int) -> str:
        """Field with index `at` after the name, "" where there is none."""
        return self.fields[at] if at < len(self.fields) else ""

    def integer(self, at: int, default: int | None = None) -> int:
        word = self.text(at)
        if not word and default is not None:
            return default
        if not INTEGER.fullmatch(word):
            raise self.fail(f"field {at + 2} is {word[:40]!r}, and no whole number")
        return int(word)

    def real(self, at: int) -> float:
        word = self.text(at).upper().replace(" ", "")
        if not word:
            return 0.0
        found = _NUMBER.fullmatch(word)
        if found is None:
            raise self.fail(f"field {at + 2} is {self.text(at)[:40]!r}, and no number")
        # an exponent may have no letter: 1.5-3 is 1.5E-3
        return float(f"{found.group(1)}E{found.group(2) or found.group(3) or 0}")

    def reals(self, at: int, count: int) -> FloatArray:
        return np.array([self.real(i) for i in range(at, at + count)])


def read(data: bytes, name: str) -> Content:
    """Content of a bulk data file; InputError with the line and the card that cannot be read."""
    return _NastranReader(name).read(decoded(data))


def grids(data: bytes, name: str) -> tuple[IntArray, FloatArray]:
    """Numbers (n,) and positions (n, 3) of the grids of a bulk data file; InputError for grids
    whose displacements have other axes."""
    reader = _NastranReader(name)
    points = reader.read(decoded(data)).points
    for card in reader.grids.values():
        system = card.integer(5, reader.default_axes)
        if system != 0:
            raise card.fail(f"displacements in the coordinate system {system}: not supported")
    return np.array(list(reader.grids), dtype=np.int64), points


class _NastranReader:
    """Reader of one file: cards one after the other, coordinate systems at the end."""

    def __init__(self, name: str) -> None:
        """name: of the file, for messages.

        grids: label -> card; default_system, default_axes: coordinate systems of grids that name
        none (GRDSET), of positions and of displacements; seen: label of an element -> its card and
        line; ignored: name of a card -> number of them; frames: coordinate systems that are
        evaluated, as `_frame` returns them; active: those that are being evaluated.
        """
        self.name = name
        self.grids: dict[int, Card] = {}
        self.systems: dict[int, tuple[Card, int]] = {}
        """Number -> card and index of the first of its fields."""
        self.default_system = self.default_axes = 0
        self.cells: dict[tuple[str, str], list[tuple[Card, int, list[int]]]] = {}
        """Type of cells and card -> card, property (0: none), node labels."""
        self.seen: dict[int, str] = {}
        self.ignored: dict[str, int] = {}
        self.frames: dict[int, tuple[FloatArray, FloatArray, str]] = {}
        self.active: set[int] = set()

    def read(self, lines: Sequence[str]) -> Content:
        """Points, cells and groups by property numbers, of all cards."""
        for card in cards(lines):
            self._card(card)
        labels = np.array(list(self.grids), dtype=np.int64)
        # fields of a GRID after its name: label, coordinate system, three coordinates
        plain = [c.reals(2, 3) if not self._system(c) else self._position(c)
                 for c in self.grids.values()]
        points = np.array(plain, dtype=np.float64).reshape(-1, 3)
        numbering = Numbering(labels)
        blocks, groups = [], dict[str, MeshGroup]()
        for (kind, card_name), found in self.cells.items():
            given = np.array([nodes for _, _, nodes in found], dtype=np.int64)
            rows = numbering.rows(given)
            bad = np.argwhere(rows < 0)
            if bad.size:
                raise found[bad[0][0]][0].fail(f"there is no grid {given[tuple(bad[0])]}")
            rows = rows[:, _ORDER[kind]] if kind in _ORDER else rows
            blocks.append(CellBlock(kind, rows, f":{found[0][0].line}: {card_name}"))
            properties = np.array([p for _, p, _ in found], dtype=np.int64)
            for number in np.unique(properties[properties != 0]):
                groups.setdefault(f"pid_{number}", MeshGroup()).cells.append(
                    (len(blocks) - 1, np.flatnonzero(properties == number)))
        notes = () if not self.ignored else (information(
            f"{self.name}: only the mesh is read, not " + ", ".join(
                c if n == 1 else f"{c} ({n})" for c, n in self.ignored.items())[:300],
            "mesh_file"),)
        return Content(points, tuple(blocks), groups, notes)

    def _card(self, card: Card) -> None:
        """Reads a card that defines the mesh; counts others (ignored), and refuses those that would
        change it. Fields of GRID after its name: label, coordinate system, position (3), axes of
        displacements; GRDSET has defaults of both systems."""
        name = card.name
        if name in REFUSED:
            raise card.fail(REFUSED[name])
        if name == "GRID":
            label = card.integer(0)
            before = self.grids.setdefault(label, card)
            if before.fields[1:5] != card.fields[1:5]:
                raise card.fail(f"there is a grid {label} already, elsewhere (line {before.line})")
        elif name == "GRDSET":
            self.default_system, self.default_axes = card.integer(1, 0), card.integer(5, 0)
        elif name.startswith("CORD"):
            self._coordinate_system(card)
        elif name in ELEMENTS:
            self._element(card)
        elif _SHAPED.match(name):
            raise card.fail("this type of elements is not supported"
                            + COMPLETE * (name == "CQUAD9"))
        else:
            self.ignored[name] = self.ignored.get(name, 0) + 1

    def _coordinate_system(self, card: Card) -> None:
        """CORD1, CORD2: adds the coordinate systems of a card, two on a long CORD1."""
        if card.name[4:] not in ("1R", "1C", "1S", "2R", "2C", "2S"):
            raise card.fail("this coordinate system is not supported")
        starts = (0,) if card.name[4] == "2" or not card.text(4) else (0, 4)
        for at in starts:
            number = card.integer(at)
            if number < 1 or number in self.systems:
                raise card.fail(f"{number}: numbers of coordinate systems are positive and occur "
                                "once")
            self.systems[number] = card, at

    def _element(self, card: Card) -> None:
        """Adds an element, whose kind follows from the number of its grids. Fields: label, property
        (but for cards of `_WITHOUT_PROPERTY`; the label when not given), grids, and of some cards
        others. cells: kind and card -> cards, property and grids."""
        label = card.integer(0)
        if label in self.seen:
            raise card.fail(f"there is an element {label} already ({self.seen[label]})")
        self.seen[label] = f"{card.name}, line {card.line}"
        first = 1 if card.name in _WITHOUT_PROPERTY else 2
        number = 0 if first == 1 else card.integer(1, label)
        kinds = ELEMENTS[card.name]
        least = kinds[0][1]
        given = card.fields[first:]
        if card.name in _CORNERS_ONLY:
            given = given[:least]
        elif card.name in ("CTRIA6", "CQUAD8"):
            given = given[: kinds[-1][1]]
        while given and not given[-1]:
            given = given[:-1]
        kind = next((k for k, count in kinds if count == len(given)), None)
        if kind is None or not all(given):
            raise card.fail(f"element {label} has {sum(map(bool, given))} grids, and takes "
                            + " or ".join(str(n) for _, n in kinds)
                            + COMPLETE * (len(given) > kinds[-1][1]))
        nodes = [card.integer(i) for i in range(first, first + len(given))]
        self.cells.setdefault((kind, card.name), []).append((card, number, nodes))

    # coordinate systems

    def _system(self, grid: Card) -> int:
        return grid.integer(1, self.default_system)

    def _position(self, grid: Card) -> FloatArray:
        """(3,) position of a grid in the basic system, in the unit of the file."""
        return self._basic(grid.reals(2, 3), self._system(grid), grid)

    def _basic(self, x: FloatArray, system: int, card: Card) -> FloatArray:
        """Coordinates (3,) of a system as a position in the basic one."""
        if system == 0:
            return x
        origin, axes, kind = self._frame(system, card)
        return origin + _rectangular(x, kind) @ axes

    def _frame(self, number: int, card: Card) -> tuple[FloatArray, FloatArray, str]:
        """Origin (3,), axes (3, 3), a row each, and type R, C or S (rectangular, cylindrical,
        spherical) of a system: by its origin A, a point B on z and C in the x-z plane, as
        coordinates in another system (CORD2) or as grids (CORD1). systems: number -> card and index
        of its first field; active: those being evaluated. card: the one that names it, for
        errors."""
        if number in self.frames:
            return self.frames[number]
        if number not in self.systems:
            raise card.fail(f"there is no coordinate system {number}")
        own, at = self.systems[number]
        if number in self.active:
            raise own.fail(f"the coordinate system {number} refers to itself")
        self.active.add(number)
        if own.name[4] == "2":
            other = own.integer(1, 0)
            A, B, C = (self._basic(own.reals(i, 3), other, own) for i in (2, 5, 8))
        else:
            A, B, C = (self._grid(own.integer(at + i), own) for i in (1, 2, 3))
        self.active.remove(number)
        z = B - A
        y = np.cross(z, C - A)
        if not np.linalg.norm(y) > 1e-12 * np.linalg.norm(z) * np.linalg.norm(C - A):
            raise own.fail("its three points lie on one line")
        axes = np.array([np.cross(y, z), y, z])
        self.frames[number] = A, axes / np.linalg.norm(axes, axis=1)[:, None], own.name[5]
        return self.frames[number]

    def _grid(self, label: int, card: Card) -> FloatArray:
        """(3,) position of the grid that a card names."""
        if label not in self.grids:
            raise card.fail(f"there is no grid {label}")
        return self._position(self.grids[label])


def _rectangular(x: FloatArray, kind: str) -> FloatArray:
    """(x, y, z) of r, theta, z (C) or r, theta from z, phi (S), degrees."""
    if kind == "R":
        return x
    first = np.radians(x[1])
    if kind == "C":
        return np.array([x[0] * np.cos(first), x[0] * np.sin(first), x[2]])
    second = np.radians(x[2])
    return np.asarray(x[0] * np.array([
        np.sin(first) * np.cos(second), np.sin(first) * np.sin(second), np.cos(first)]))


def cards(lines: Sequence[str]) -> Iterator[Card]:
    """Cards between BEGIN BULK and ENDDATA; of all the file where there is no BEGIN BULK. A line
    without a name continues the card before; if both have a mark (ahead, behind), it is the
    same."""
    card: Card | None = None
    mark = ""
    for line, text in _bulk(lines):
        name, fields, ahead, behind = _fields(line, text)
        if name:
            if card is not None:
                yield card
            card, mark = Card(name, line, fields), behind
            continue
        if card is None:
            raise BadLine(line, text[:8].strip() or "+", "continues a card that is not there")
        if ahead and mark and ahead != mark:
            raise BadLine(line, card.name, f"continuation {ahead!r} does not follow its card, "
                          f"which ends with {mark!r}")
        card.fields.extend(fields)
        mark = behind
    if card is not None:
        yield card


def _bulk(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Lines of the bulk data with their numbers, without comments ($ to the end of a line) and
    blank lines: after BEGIN BULK, or where there is none after CEND or from the first line, to
    ENDDATA."""
    begins = [n for n, t in enumerate(lines, 1) if t.lstrip()[:6].upper().rstrip() == "BEGIN"]
    if len(begins) > 1:
        raise BadLine(begins[1], "BEGIN", "a second part of bulk data is not supported")
    first = begins[0] if begins else 0
    if not begins:
        cend = [n for n, t in enumerate(lines, 1) if re.match(r"\s*CEND\b", t, re.IGNORECASE)]
        first = cend[-1] if cend else 0
    for number, raw in enumerate(lines, 1):
        text = raw.split("$", 1)[0].rstrip()
        if number <= first or not text.strip():
            continue
        if text.lstrip()[:7].upper() == "ENDDATA":
            return
        yield number, text.expandtabs(8)


def _fields(line: int, text: str) -> tuple[str, list[str], str, str]:
    """Name (capitals, "" on a continuation), data fields, and the marks ahead and behind, by which
    a continuation belongs to its card. Free form: fields between commas; else columns of 8 letters,
    or with * after the name four of 16 (wide)."""
    if "," in text[:10] or text.count(",") >= 2:
        words = [w.strip() for w in text.split(",")]
        head, data = words[0], words[1:]
        wide = head.endswith("*")
        count = 4 if wide else 8
        behind = data[count] if len(data) > count else ""
        if len(data) > count + 1 and any(data[count + 1:]):
            raise BadLine(line, head or "+", f"{len(data)} fields: a line has at most {count}")
        data = (data[:count] + [""] * count)[:count]
    else:
        head = text[:8].strip()
        wide = "*" in head
        size, count = (16, 4) if wide else (8, 8)
        data = [text[8 + i * size : 8 + (i + 1) * size].strip() for i in range(count)]
        behind = text[72:80].strip()
    ahead = ""
    if not head or head[0] in "+*":
        ahead, head = head[1:].strip(), ""
    name = head.rstrip("*").strip().upper()
    if text.lstrip()[:7].upper() == "INCLUDE":
        name = "INCLUDE"
    if name and not _NAME.fullmatch(name):
        raise BadLine(line, name, "is no card of the bulk data")
    return name, data, ahead, behind[1:].strip() if behind[:1] in ("+", "*") else behind
