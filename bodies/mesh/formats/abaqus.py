"""Abaqus input files (also of CalculiX): nodes, elements, sets, surfaces, parts and instances.

Syntax of the Abaqus Keywords Guide. Keywords, element types and names are read in any case;
keywords that have nothing to do with the mesh are listed in a note, and those that would change
the mesh in a way that is not supported are refused with their line.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from sparsemor.bodies.mesh.formats.abaqus_sets import (
    MODEL,
    AbaqusSets,
    Placed,
    Scope,
    SetDefinition,
)
from sparsemor.bodies.mesh.formats.abaqus_statements import (
    data_words,
    integer,
    key_of,
    needed,
    real,
    shown,
    statements,
)
from sparsemor.bodies.mesh.formats.file_content import (
    COMPLETE,
    BadLine,
    CellBlock,
    Content,
    Numbering,
    decoded,
    dimension_of,
)
from sparsemor.core import FloatArray, IntArray, Note, information

REFUSED = {
    "INCLUDE": "paste the content of that file here",
    "NGEN": "generated nodes are not supported: write them out",
    "NFILL": "generated nodes are not supported: write them out",
    "NCOPY": "copied nodes are not supported: write them out",
    "NMAP": "mapped nodes are not supported: write them out",
    "ELGEN": "generated elements are not supported: write them out",
    "ELCOPY": "copied elements are not supported: write them out",
    "SYSTEM": "coordinate systems of nodes are not supported: write global coordinates",
    "SUBSTRUCTUREGENERATE": "substructures are not supported",
    "IMPORT": "imports of other results are not supported",
    "MANIFEST": "files of files are not supported",
}
"""Keywords that would change the mesh."""
_FAMILIES = (
    ("vertex", r"(MASS|ROTARYI|SPRING1|DASHPOT1|HEATCAP)"),
    ("line", r"(T2D2|T3D2|B21|B23|B31|B33|PIPE21|PIPE31|DC1D2|R2D2|RB2D2|RB3D2|CONN2D2|CONN3D2|"
             r"FRAME2D|FRAME3D|SPRINGA|SPRING2|DASHPOTA|DASHPOT2)[A-Z]*"),
    ("line3", r"(T2D3|T3D3|B22|B32|PIPE22|PIPE32|DC1D3)[A-Z]*"),
    ("triangle", r"(CPS3|CPE3|CPEG3|DC2D3|AC2D3|S3|DS3|STRI3|M3D3|R3D3|SFM3D3)[A-Z]*"),
    ("triangle6", r"(CPS6|CPE6|CPEG6|DC2D6|AC2D6|S6|DS6|STRI65|M3D6|SFM3D6)[A-Z]*"),
    ("quad", r"(CPS4|CPE4|CPEG4|DC2D4|AC2D4|S4|DS4|M3D4|R3D4|SFM3D4)[A-Z]*5?"),
    ("quad8", r"(CPS8|CPE8|CPEG8|DC2D8|AC2D8|S8|DS8|M3D8|SFM3D8)[A-Z]*5?"),
    ("tetra", r"(C3D4|DC3D4|AC3D4)[A-Z]*"),
    ("tetra10", r"(C3D10|DC3D10|AC3D10)[A-Z]*"),
    ("pyramid", r"(C3D5|DC3D5|AC3D5)[A-Z]*"),
    ("wedge", r"(C3D6|DC3D6|AC3D6)[A-Z]*"),
    ("wedge15", r"(C3D15|DC3D15|AC3D15)[A-Z]*"),
    ("hexahedron", r"(C3D8|DC3D8|DCC3D8|AC3D8|SC8|CSS8)[A-Z]*"),
    ("hexahedron20", r"(C3D20|DC3D20|AC3D20)[A-Z]*"),
    ("quad9", r"(S9|M3D9)[A-Z]*5?"),
    ("hexahedron27", r"C3D27[A-Z]*"),
)
"""Type of cells, and the element types of that shape: stress, heat, coupled, acoustic."""
_CELLS = tuple((kind, re.compile(pattern)) for kind, pattern in _FAMILIES)
_NODES = {"vertex": 1, "line": 2, "line3": 3, "triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8,
          "tetra": 4, "tetra10": 10, "pyramid": 5, "wedge": 6, "wedge15": 15, "hexahedron": 8,
          "hexahedron20": 20, "quad9": 9, "hexahedron27": 27}
def read(data: bytes, name: str) -> Content:
    """Content of an input file; InputError with the line and the keyword of what cannot be read."""
    return _AbaqusReader(name).read(decoded(data))


def nodes(lines: Sequence[str]) -> tuple[IntArray, FloatArray, dict[str, IntArray]]:
    """Labels (n,) and positions (n, 3), in the unit of the file, of the nodes of an input file
    without parts, and the rows of each set of nodes; all but *NODE and *NSET is passed over.
    BadLine for what would change these nodes."""
    reader = _AbaqusReader("")
    for line, keyword, options, body in statements(lines):
        word = f"*{keyword}"
        if keyword == "SYSTEM" and body or (
                keyword == "NODE" and options.get("SYSTEM", "R").upper() != "R"):
            raise BadLine(line, word, "coordinate systems of nodes are not supported: write global "
                          "rectangular coordinates")
        if keyword in ("INSTANCE", "INCLUDE", "NGEN"):
            raise BadLine(line, word, "not supported: write all nodes and sets into one file, "
                          "without parts and instances")
        if keyword == "NODE" or keyword == "NSET" and "ELSET" not in options:
            reader.statement(line, keyword, options, body)
    labels, X = _once(reader.model)
    none = np.zeros(0, np.int64)
    # the one mesh, from its first point and element on, without elements
    whole = Placed(reader.model, 0, 0, np.zeros(1, np.int64), Numbering(labels), Numbering(none))
    sets = AbaqusSets({MODEL: whole}, reader.spelled, ()).groups()
    return labels, X, {name: np.unique(np.concatenate([none, *group.points]))
                       for name, group in sets.items()}


class _AbaqusReader:
    """Reader of one file: statements one after the other, sets at the end."""

    def __init__(self, name: str) -> None:
        """name: of the file, for messages.

        model, here: mesh outside of parts, and that to which data belong now; parts: name -> mesh;
        ignored: keyword -> number of its statements that are not read; placed: name -> instance in
        the numbering of the model.
        """
        self.name = name
        self.model = Scope(MODEL, 1)
        self.parts: dict[str, Scope] = {}
        self.instances: dict[str, tuple[Scope, FloatArray, FloatArray]] = {}
        """Name -> its mesh, rotation (3, 3) and translation (3,)."""
        self.spelled: dict[str, dict[str, None]] = {}
        """Spellings of each name in the file."""
        self.here = self.model
        self.placement: list[tuple[int, list[str]]] | None = None
        """Data lines of the *INSTANCE that is open."""
        self.lines: dict[str, tuple[int, str]] = {}
        """Line and keyword of each instance."""
        self.ignored: dict[str, int] = {}
        self.placed: dict[str, Placed] = {}

    def read(self, lines: Sequence[str]) -> Content:
        for line, keyword, options, body in statements(lines):
            self.statement(line, keyword, options, body)
        if self.placement is not None:
            raise BadLine(len(lines), "*INSTANCE", "has no *END INSTANCE")
        return self._content()

    def statement(
        self, line: int, keyword: str, options: dict[str, str], body: list[tuple[int, str]]
    ) -> None:
        """Reads a statement that defines the mesh; counts others (ignored), and refuses those that
        would change it. keyword: in capitals without blanks and without *; body: numbers and texts
        of its data lines."""
        word = "*" + keyword
        if keyword in REFUSED and (body or keyword != "SYSTEM"):
            raise BadLine(line, word, REFUSED[keyword])
        handlers: dict[str, Callable[..., None]] = {
            "NODE": self._nodes, "ELEMENT": self._elements, "NSET": partial(self._set, "NSET"),
            "ELSET": partial(self._set, "ELSET"), "SURFACE": self._surface, "PART": self._part,
            "ENDPART": self._outside, "ASSEMBLY": self._outside, "INSTANCE": self._instance,
            "ENDINSTANCE": self._end_instance, "ENDASSEMBLY": self._outside}
        handler = handlers.get(keyword)
        if handler is None:
            if keyword not in ("HEADING", "SYSTEM"):
                self.ignored[word] = self.ignored.get(word, 0) + 1
            return
        if "INPUT" in options:
            raise BadLine(line, word, "INPUT: paste the content of that file here")
        handler(line, word, options, body)

    # structure

    def _part(self, line: int, word: str, options: dict[str, str], body: list[tuple[int, str]]
              ) -> None:
        """*PART: opens a part, to which data belong until *END PART."""
        name = key_of(needed(options, "NAME", line, word))
        if name in self.parts:
            raise BadLine(line, word, f"there is a part {name!r} already")
        self.here = self.parts[name] = Scope(name, line)

    def _outside(self, line: int, word: str, *_: object) -> None:
        self.here = self.model

    def _instance(self, line: int, word: str, options: dict[str, str],
                  body: list[tuple[int, str]]) -> None:
        """*INSTANCE: opens an instance of a part, or one with its own nodes and elements, at its
        placement, a rotation and translation by its data lines. spelled: name -> its spellings;
        here: mesh to which the data that follow belong."""
        name = key_of(needed(options, "NAME", line, word))
        if name in self.instances or self.placement is not None:
            raise BadLine(line, word, f"{name!r} is there already, or the one before has no "
                          "*END INSTANCE")
        if set(options) - {"NAME", "PART"}:
            other = ", ".join(sorted(set(options) - {"NAME", "PART"}))
            raise BadLine(line, word, f"{other}: not supported")
        part = self.parts.get(key_of(options.get("PART", "")))
        if part is None and "PART" in options:
            raise BadLine(line, word, f"there is no part {shown(options['PART'])!r} before it")
        self.spelled.setdefault(name, {})[shown(options["NAME"])] = None
        scope = part if part is not None else Scope(name, line)
        self.placement = [(at, data_words(text)[0]) for at, text in body]
        rotation, move = _placement(self.placement, word)
        self.instances[name] = (scope, rotation, move)
        self.lines[name] = line, word
        # a node or an element inside an instance of a part would change the part
        self.here = scope if part is None else Scope(name, line)

    def _end_instance(self, line: int, word: str, *_: object) -> None:
        """*END INSTANCE: closes the last one; data in an instance of a part, whose mesh (scope) is
        not the open one (here), are refused."""
        if self.placement is None:
            raise BadLine(line, word, "no *INSTANCE is open")
        name, (scope, rotation, move) = list(self.instances.items())[-1]
        own = self.here
        if own is not scope and (own.labels or own.blocks or own.nsets or own.elsets
                                 or own.surfaces):
            raise BadLine(own.line, "*INSTANCE", f"{name}: data inside an instance of a part is "
                          "not supported: move them to the part")
        self.placement = None
        self.here = self.model

    # data

    def _nodes(self, line: int, word: str, options: dict[str, str],
               body: list[tuple[int, str]]) -> None:
        """*NODE: labels and coordinates, rectangular or cylindrical (r, angle in degrees, z), added
        to the open mesh (here); starts: number of nodes before each *NODE, and its line."""
        system = options.get("SYSTEM", "R").upper()
        if system not in ("R", "C"):
            raise BadLine(line, word, f"SYSTEM={system} is not supported: write rectangular "
                          "coordinates")
        first = len(self.here.labels)
        self.here.starts.append((first, line))
        for at, text in body:
            words, _ = data_words(text)
            if not words:
                continue
            if len(words) > 7:
                raise BadLine(at, word, f"{len(words)} numbers, a node has at most 7")
            x, y, z = (real(w, at, word) for w in [*words[1:], "", "", ""][:3])
            if system == "C":
                x, y = x * np.cos(np.radians(y)), x * np.sin(np.radians(y))
            self.here.labels.append(integer(words[0], at, word))
            self.here.coordinates.append((x, y, z))
        if "NSET" in options:
            self._add(self.here.nsets, options["NSET"], SetDefinition(
                word, "list", [(line, [str(n)]) for n in self.here.labels[first:]]))

    def _elements(self, line: int, word: str, options: dict[str, str],
                  body: list[tuple[int, str]]) -> None:
        """*ELEMENT: labels and nodes of elements of one type, which may go on over several lines: a
        line that ends with a comma, while nodes are missing (more). Adds a block to the open mesh
        (here), and, with ELSET, its number to an element set."""
        name = needed(options, "TYPE", line, word).upper()
        kind = next((k for k, pattern in _CELLS if pattern.fullmatch(name)), None)
        if kind is None or set(options) - {"TYPE", "ELSET", "OFFSET", "SOLIDELEMENTNUMBERING"}:
            what = "axisymmetric bodies are not supported" if "AX" in name else (
                "this type of elements is not supported")
            other = ", ".join(sorted(set(options) - {"TYPE", "ELSET"}))
            raise BadLine(line, word, f"TYPE={name[:40]}: {what}" if kind is None else
                          f"{other[:80]}: not supported")
        count = _NODES[kind]
        labels: list[int] = []
        nodes: list[list[int]] = []
        row: list[int] = []
        more = False
        for at, text in body:
            words, open_end = data_words(text)
            if not words:
                continue
            numbers = [integer(w, at, word) for w in words]
            row = row + numbers if more else numbers  # label, then nodes
            more = open_end and len(row) < count + 1
            if more:
                continue
            if len(row) != count + 1:
                raise BadLine(at, word, f"element {row[0]} has {len(row) - 1} nodes, and {name} "
                              f"takes {count}{COMPLETE * (len(row) > max(count, 9) + 1)}")
            labels.append(row[0])
            nodes.append(row[1:])
        if more:
            raise BadLine(at, word, f"element {row[0]} has {len(row) - 1} nodes, and {name} takes "
                          f"{count}")
        if labels:
            self.here.blocks.append((kind, labels, nodes, f":{line}: {word} TYPE={name}"))
        if "ELSET" in options:
            self._add(self.here.elsets, options["ELSET"], SetDefinition(
                word, "block", [(line, [str(len(self.here.blocks) - 1)])] if labels else []))

    def _set(self, kind: str, line: int, word: str, options: dict[str, str],
             body: list[tuple[int, str]]) -> None:
        """*NSET or *ELSET (kind): a list of labels and names of sets, or ranges (GENERATE); of
        *NSET also, with ELSET, the nodes of an element set. Stored as it is written, and evaluated
        at the end of the file."""
        name = needed(options, kind, line, word)
        sets = self.here.nsets if kind == "NSET" else self.here.elsets
        known = {kind, "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED", *(
            ("ELSET",) if kind == "NSET" else ())}
        if set(options) - known:
            raise BadLine(line, word, f"{', '.join(sorted(set(options) - known))[:80]}: not "
                          "supported")
        instance = key_of(options.get("INSTANCE", ""))
        if kind == "NSET" and "ELSET" in options:
            self._add(sets, name, SetDefinition(
                word, "elements", [(line, [options["ELSET"]])], instance))
        how = "range" if "GENERATE" in options else "list"
        lines = [(at, words) for at, text in body if (words := data_words(text)[0])]
        self._add(sets, name, SetDefinition(word, how, lines, instance))

    def _surface(self, line: int, word: str, options: dict[str, str],
                 body: list[tuple[int, str]]) -> None:
        """*SURFACE: faces of elements, or nodes; stored as it is written, and evaluated at the end
        of the file."""
        name = needed(options, "NAME", line, word)
        how = options.get("TYPE", "ELEMENT").upper()
        if how not in ("ELEMENT", "NODE") or set(options) - {
                "NAME", "TYPE", "INTERNAL", "INSTANCE", "DEFINITION"}:
            raise BadLine(line, word, f"only TYPE=ELEMENT and TYPE=NODE without further options "
                          f"are supported ({', '.join(options)})"[:200])
        lines = [(at, words) for at, text in body if (words := data_words(text)[0])]
        self._add(self.here.surfaces, name, SetDefinition(
            word, how, lines, key_of(options.get("INSTANCE", ""))))

    def _add(self, sets: dict[str, list[SetDefinition]], name: str, entry: SetDefinition) -> None:
        """Adds a definition to those of a set; a name may have several, as the set grows."""
        self.spelled.setdefault(key_of(name), {})[shown(name)] = None
        sets.setdefault(key_of(name), []).append(entry)

    # mesh

    def _content(self) -> Content:
        """Points, cells and groups of all instances, each placed, x -> rotation x + move, in one
        numbering. BadLine for an element or node that is twice there, or a node that is missing."""
        points: list[FloatArray] = [np.zeros((0, 3))]
        blocks: list[CellBlock] = []
        total, count = 0, 0
        for name, scope, rotation, move in self._scopes():
            labels, X = _once(scope)
            nodes = Numbering(labels)
            elements = Numbering(np.array(
                [n for _, labels, _, _ in scope.blocks for n in labels], dtype=np.int64))
            twice = elements.repeated()
            if twice is not None:
                place = next(p for _, own, _, p in reversed(scope.blocks) if twice in own)
                raise BadLine(_line(place), "*ELEMENT", f"there is an element {twice} already")
            # total, count: points and elements of the instances before; starts: of its blocks
            starts = np.cumsum([count, *(len(own) for _, own, _, _ in scope.blocks)])
            self.placed[name] = Placed(scope, total, count, starts, nodes, elements)
            for kind, _, given, place in scope.blocks:
                rows = _rows(nodes, given, place)
                if kind == "line3":  # its midpoint is the second of three
                    rows = rows[:, [0, 2, 1]]
                blocks.append(CellBlock(kind, total + rows, place))
            points.append(X @ rotation.T + move)
            total, count = total + len(X), int(starts[-1])
        self._check_one_piece()
        sets = AbaqusSets(self.placed, self.spelled, blocks)
        groups = sets.groups()
        return Content(np.concatenate(points), tuple(blocks), groups,
                       tuple(self._notes(sets.missing)))

    def _check_one_piece(self) -> None:
        """BadLine where two instances have cells: they share no nodes."""
        top = {name: max((dimension_of(k) for k, *_ in p.scope.blocks), default=0)
               for name, p in self.placed.items()}
        several = [n for n in top if top[n] > 1 and top[n] == max(top.values())]
        if len(several) > 1:
            line, word = self.lines.get(several[1], (self.placed[several[1]].scope.line, "*PART"))
            raise BadLine(line, word, f"{several[1]} shares no nodes with {several[0] or 'others'},"
                          " and a body is one piece: write each of them into a file of its own")

    def _scopes(self) -> list[tuple[str, Scope, FloatArray, FloatArray]]:
        """Name, mesh, rotation and translation of everything that is in the model."""
        here = np.eye(3), np.zeros(3)
        found = [(MODEL, self.model, *here)]
        if self.instances:
            return found + [(n, s, r, m) for n, (s, r, m) in self.instances.items()]
        return found + [(n, s, *here) for n, s in self.parts.items()]

    def _notes(self, missing: Sequence[str]) -> list[Note]:
        """Notes on statements that are not read (ignored: keyword -> number), parts without an
        instance, and members of sets that do not exist (missing: texts with their lines).
        instances: name -> mesh, rotation and translation."""
        notes = []
        if self.ignored:
            words = ", ".join(w if n == 1 else f"{w} ({n})" for w, n in self.ignored.items())
            notes.append(information(
                f"{self.name}: only the mesh is read, not {words[:300]}", "mesh_file"))
        unused = [n for n, s in self.parts.items() if self.instances and all(
            s is not other for other, _, _ in self.instances.values())]
        if unused:
            notes.append(information(
                f"{self.name}: the parts {', '.join(unused)[:200]} are in no instance and were "
                "left out, as Abaqus does", "mesh_file"))
        return notes + [information(f"{self.name}{text}", "mesh_file") for text in missing]


def _placement(
    lines: Sequence[tuple[int, list[str]]], word: str
) -> tuple[FloatArray, FloatArray]:
    """Rotation R (3, 3) and translation u (3,) of an instance: x -> R x + u.

    Data lines: translation v; then two points a, b on an axis and an angle, which rotates what was
    translated: x -> a + Q (x + v - a).
    """
    R, u = np.eye(3), np.zeros(3)
    if len(lines) > 2:
        raise BadLine(lines[2][0], word, "an instance has at most two data lines")
    if lines:
        u = np.array([real(w, lines[0][0], word) for w in [*lines[0][1], "", "", ""][:3]])
    if len(lines) == 2:
        line, words = lines[1]
        if len(words) != 7:
            raise BadLine(line, word, f"{len(words)} numbers: a rotation takes two points and an "
                          "angle, 7 numbers")
        *ends, angle = (real(w, line, word) for w in words)
        a, axis = np.array(ends[:3]), np.array(ends[3:]) - np.array(ends[:3])
        length = float(np.linalg.norm(axis))
        if not length > 0:
            raise BadLine(line, word, "the two points of the axis coincide")
        x, y, z = axis / length
        W = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.radians(angle)
        R = np.eye(3) + np.sin(turn) * W + (1 - np.cos(turn)) * (W @ W)  # Rodrigues
        u = a + R @ (u - a)
    return R, u


def _once(scope: Scope) -> tuple[IntArray, FloatArray]:
    """Labels (n,) and positions (n, 3), in the unit of the file, of the nodes; one that is given
    twice at one position, once. BadLine for one at two positions; starts: number of nodes before
    each *NODE, and its line."""
    labels = np.array(scope.labels, dtype=np.int64)
    X = np.array(scope.coordinates, dtype=np.float64).reshape(-1, 3)
    numbering = Numbering(labels)
    if numbering.repeated() is None:
        return labels, X
    _, first, of = np.unique(labels, return_index=True, return_inverse=True)
    moved = np.flatnonzero((X != X[first][of]).any(axis=1))
    if moved.size:
        line = [at for start, at in scope.starts if start <= moved[0]][-1]
        raise BadLine(line, "*NODE", f"there is a node {labels[moved[0]]} already, elsewhere")
    kept = np.sort(first)
    return labels[kept], X[kept]


def _rows(nodes: Numbering, given: list[list[int]], place: str) -> IntArray:
    """Rows (n, q) of the nodes with these labels. Raises BadLine for a node that is not there;
    place: line and keyword, as in `CellBlock`."""
    found = np.array(given, dtype=np.int64)
    rows = nodes.rows(found)
    bad = np.argwhere(rows < 0)
    if bad.size:
        raise BadLine(_line(place), "*ELEMENT", f"there is no node {found[tuple(bad[0])]}")
    return rows


def _line(place: str) -> int:
    """Line number of a place `:line: keyword`."""
    return int(place.split(":")[1])
