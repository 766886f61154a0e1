"""Plain count of the cells in the lines of a mesh file, for comparison with what was read.

It shares no code with the readers: it only looks for the lines and words that every cell has.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable

_VTK = {1: "vertex", 3: "line", 21: "line3", 5: "triangle", 22: "triangle6", 10: "tetra",
        24: "tetra10", 9: "quad", 23: "quad8", 28: "quad9", 13: "wedge", 26: "wedge15",
        32: "wedge18", 12: "hexahedron", 25: "hexahedron20", 29: "hexahedron27"}
_GMSH = {15: ("vertex", 1), 1: ("line", 2), 8: ("line3", 3), 2: ("triangle", 3),
         9: ("triangle6", 6), 4: ("tetra", 4), 11: ("tetra10", 10), 3: ("quad", 4),
         16: ("quad8", 8), 10: ("quad9", 9), 6: ("wedge", 6), 18: ("wedge15", 15),
         13: ("wedge18", 18), 5: ("hexahedron", 8), 17: ("hexahedron20", 20),
         12: ("hexahedron27", 27)}
_MEDIT = {"Vertices": "", "Edges": "line", "Triangles": "triangle", "Tetrahedra": "tetra",
          "Quadrilaterals": "quad", "Hexahedra": "hexahedron", "Prisms": "wedge"}
_ABAQUS = re.compile(
    r"(?:CP[SE]|CPEG|[DA]C2D|D?S|STRI|M3D|R3D|SFM3D)([34689])5?[A-Z]*5?|"
    r"(?:[DA]?C3D|SC|CSS|DCC3D)(4|6|8|10|15|20|27)[A-Z]*")
_PLANE = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_SOLID = {4: "tetra", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15",
          20: "hexahedron20", 27: "hexahedron27"}
_NASTRAN = {"CTRIA3": "triangle", "CTRIAR": "triangle", "CTRIA6": "triangle6", "CTETRA": "tetra",
            "CQUAD4": "quad", "CQUADR": "quad", "CQUAD8": "quad8", "CPENTA": "wedge",
            "CHEXA": "hexahedron"}
_MORE = {"tetra10": "tetra", "wedge15": "wedge", "hexahedron20": "hexahedron"}
"""Types that Nastran's cards do not tell apart."""
COUNTED = {"line", "line3", *_PLANE.values(), *_SOLID.values(), "wedge18"}
"""Types of cells that are compared where the count knows them."""


def difference(kind: str, data: bytes, read: dict[str, int]) -> str:
    """Sentence about a type or a set whose number of cells is another in the lines of a text file
    than among those that were read; "" where there is none, and for binary files.

    read: `triangle` or `triangle in 'copper'` -> number of cells; plain: the same by the lines,
    None where these do not tell; kind: of the file. Sets that the count does not know are not
    compared. _MORE: types that a card of Nastran does not tell apart, counted as one; COUNTED:
    types that the count knows.
    """
    try:
        plain = _COUNTS[kind](data) if kind in _COUNTS else None
    except (ValueError, IndexError):  # lines in an unusual form
        plain = None
    if plain is None:
        return ""
    if kind == "nastran":
        whole: Counter[str] = Counter()
        for key, number in read.items():
            what, _, name = key.partition(" in ")
            whole[_MORE.get(what, what) + (f" in {name}" if name else "")] += number
        read = dict(whole)
    for key in sorted({*plain, *read}):
        what = key.split(" in ")[0]
        if what not in COUNTED or (key not in plain and " in " in key) or (
                kind in ("abaqus", "nastran") and what.startswith("line")):
            continue  # sets that list their members are checked member by member
        if plain.get(key, 0) != read.get(key, 0):
            return (f"{read.get(key, 0)} cells of type {key} were read, and a plain count of its "
                    f"lines finds {plain.get(key, 0)}")
    return ""


def _text(data: bytes) -> str:
    """Text of a file with lines that end in a line feed."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _lines(data: bytes) -> list[str]:
    return _text(data).split("\n")


def _abaqus(data: bytes) -> dict[str, int] | None:
    """Words in the data lines of each *ELEMENT by type and, outside of parts, by its ELSET; those
    of a part once for each of its instances."""
    by_part: dict[str, Counter[str]] = {}
    named: Counter[tuple[str, str]] = Counter()
    copies: Counter[str] = Counter()
    part, kind, name, words, width, head = "", "", "", 0, 1, ""

    def close() -> None:
        if kind:
            by_part.setdefault(part, Counter())[kind] += words // width
            if name and not part:
                named[kind, name] += words // width

    for line in _lines(data):
        text = line.strip()
        if not text or text.startswith("**"):
            continue
        if head and text[0] != "*":
            text, head = head + text, ""
        if text[0] == "*" and text[-1] == ",":  # goes on in the next line
            head = text
        if text[0] != "*":
            words += len([w for w in text.split(",") if w.strip()])
            continue
        close()
        kind, words, name = "", 0, ""
        keyword = re.sub(r"\s", "", text.split(",")[0]).upper()
        option = {k.upper(): v.strip().upper() for k, v in re.findall(
            r",\s*([A-Za-z]+)\s*=([^,]*)", text)}
        match = _ABAQUS.fullmatch(option.get("TYPE", ""))
        if keyword == "*ELEMENT" and match:
            nodes = int(match[1] or match[2])
            kind = _PLANE[nodes] if match[1] else _SOLID[nodes]
            width, name = nodes + 1, option.get("ELSET", "")
        elif keyword == "*PART":
            part = option.get("NAME", "").strip('"')
        elif keyword == "*ENDPART":
            part = ""
        elif keyword == "*INSTANCE":
            copies[option.get("PART", "").strip('"')] += 1
    close()
    found: Counter[str] = Counter()
    for which, counts in by_part.items():
        for key, number in counts.items():
            found[key] += number * (copies[which] if which and copies else 1)
    # an *ELSET of the same name adds elements of other statements, and quoted names keep their case
    more = " ".join(t.upper() for t in _lines(data) if re.match(r"\s*\*\s*ELSET\b", t, re.I))
    for (key, own), number in named.items():
        if '"' not in own and own not in more:
            found[f"{key} in {own!r}"] = number
    return found


def _gmsh(data: bytes) -> dict[str, int] | None:
    """Lines of $Elements by type and by physical group; None where a line has not one element.

    Format 4.1: blocks of a line `dimension entity type count` and `count` lines of elements, whose
    groups are those of the entity. Format 2.2: lines `number type count tags.. nodes..` with the
    count of tags, the first of which is the group; an element of several groups has several lines.
    """
    lines = [t.strip() for t in _lines(data)]

    def section(name: str) -> list[list[str]]:
        if f"${name}" not in lines:
            return []
        return [t.split() for t in lines[lines.index(f"${name}") + 1 : lines.index(f"$End{name}")]
                if t]

    head = section("MeshFormat")
    if not head or head[0][1] != "0":
        return None
    names = {(int(d), abs(int(tag))): name for d, tag, name in re.findall(
        r'(?m)^\s*([0-3])\s+(-?\d+)\s+"(.*)"\s*$', _text(data))}
    found: Counter[str] = Counter()
    body = section("Elements")
    if head[0][0] == "4.1":
        tags = _entities(section("Entities"))
        at = 1
        while at < len(body):
            dimension, entity, number, count = map(int, body[at])
            kind = _GMSH.get(number, ("", 0))[0]
            for key in (kind, *_grouped(names, kind, dimension,
                                        tags.get((dimension, entity), set()))):
                found[key] += count
            at += 1 + count
        return found if at == len(body) else None
    if len(body) != 1 + int(body[0][0]):
        return None
    rows: dict[str, set[tuple[str, ...]]] = {}
    for words in body[1:]:
        kind, count = _GMSH.get(int(words[1]), ("", 0))
        tag = abs(int(words[3])) if int(words[2]) else 0
        d = 3 if kind.startswith("tetra") else {"t": 2, "q": 2, "l": 1, "w": 3, "h": 3}.get(
            kind[:1], 0)
        for key in (kind, *_grouped(names, kind, d, {tag} - {0})):
            rows.setdefault(key, set()).add(tuple(sorted(words[-count:])))
    return {key: len(different) for key, different in rows.items()}


def _grouped(names: dict[tuple[int, int], str], kind: str, dimension: int, tags: Iterable[int]
             ) -> set[str]:
    """Keys of the groups with these tags."""
    word = ("point", "curve", "surface", "volume")[dimension]
    return {f"{kind} in {names.get((dimension, tag), f'{word}_{tag}')!r}" for tag in tags}


def _entities(lines: list[list[str]]) -> dict[tuple[int, int], set[int]]:
    """Dimension and number of an entity -> its physical tags without their signs, from the lines of
    $Entities: numbers of entities of each dimension; then of each its number, 3 coordinates
    (points) or 6 of its box, count of tags, tags, .."""
    tags: dict[tuple[int, int], set[int]] = {}
    at = 1
    for dimension, count in enumerate(map(int, lines[0] if lines else ())):
        for words in lines[at : at + count]:
            first = 4 if dimension == 0 else 7
            several = int(words[first])
            tags[dimension, int(words[0])] = {
                abs(int(w)) for w in words[first + 1 : first + 1 + several]}
        at += count
    return tags


def _nastran(data: bytes) -> dict[str, int]:
    """Number of lines that start with the name of a card, by type of cells, and by the property in
    their second field, between commas or in columns of 8 or, with *, 16 letters; from BEGIN BULK,
    if there is one, to ENDDATA."""
    found: Counter[str] = Counter()
    begun = not re.search(rb"(?im)^\s*BEGIN\b", data)
    for text in _lines(data):
        word = re.split(r"[\s,*$]", text.strip(), maxsplit=1)[0].upper()
        begun |= word == "BEGIN"
        if word == "ENDDATA":
            break
        if begun and word in _NASTRAN:
            found[_NASTRAN[word]] += 1
            line = text.expandtabs(8)
            number = line.split(",")[2] if "," in line else (
                line[24:40] if "*" in line[:8] else line[16:24])
            if number.strip():
                found[f"{_NASTRAN[word]} in 'pid_{int(number)}'"] += 1
    return found


def _medit(data: bytes) -> dict[str, int] | None:
    if b"\0" in data[:64] or not data.lstrip().startswith((b"MeshVersionFormatted", b"#")):
        return None
    text = re.sub(r"#[^\n]*", "", _text(data))
    return {kind: int(n) for word, kind in _MEDIT.items() if kind
            for n in re.findall(rf"(?m)^\s*{word}\s+(\d+)", text)[:1] if int(n)}


def _vtk(data: bytes) -> dict[str, int] | None:
    if not re.match(rb"# vtk[^\n]*\n[^\n]*\n\s*ASCII", data):
        return None
    match = re.search(rb"CELL_TYPES\s+(\d+)\s+([\d\s]*)", data)
    return None if match is None else _types(match[2].split()[: int(match[1])])


def _vtu(data: bytes) -> dict[str, int] | None:
    found = re.findall(rb"<DataArray([^>]*)>([^<]*)<", data)
    for options, numbers in found:
        if b'"types"' in options and b'"ascii"' in options:
            return _types(numbers.split())
    return None


def _types(words: Iterable[bytes]) -> dict[str, int]:
    return dict(Counter(_VTK.get(int(w), "") for w in words))


_COUNTS: dict[str, Callable[[bytes], dict[str, int] | None]] = {
    "abaqus": _abaqus, "gmsh": _gmsh, "nastran": _nastran, "medit": _medit, "vtk": _vtk,
    "vtu": _vtu}
