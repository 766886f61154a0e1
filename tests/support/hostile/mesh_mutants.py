"""Damaged mesh files: small meshes in each supported format, changed at random from a seed."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.4, 0]], dtype=np.float64)
QUARTERS = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=np.float64)
TETRAHEDRA = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])

WRITERS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "gmsh 2.2": ("msh", "gmsh22", {"binary": False}),
    "gmsh 2.2, binary": ("msh", "gmsh22", {"binary": True}),
    "gmsh 4.1": ("msh", "gmsh", {"binary": False}),
    "gmsh 4.1, binary": ("msh", "gmsh", {"binary": True}),
    "abaqus": ("inp", "abaqus", {}),
    "vtk 4.2": ("vtk", "vtk42", {"binary": False}),
    "vtk 4.2, binary": ("vtk", "vtk42", {"binary": True}),
    "vtk 5.1": ("vtk", "vtk", {"binary": False}),
    "vtk 5.1, binary": ("vtk", "vtk", {"binary": True}),
    "vtu": ("vtu", "vtu", {"binary": False}),
    "vtu, compressed": ("vtu", "vtu", {"binary": True, "compression": "zlib"}),
    "nastran": ("bdf", "nastran", {}),
    "medit": ("mesh", "medit", {}),
}
"""Name -> ending, meshio's name, and options of the writer."""


@cache
def originals() -> dict[str, bytes]:
    """`name, 2-D` and `name, 3-D` -> the bytes of a sound file."""
    made: dict[str, bytes] = {}
    with TemporaryDirectory() as folder:
        for name, (ending, kind, options) in WRITERS.items():
            for d in (2, 3):
                file = Path(folder) / f"mesh.{ending}"
                _mesh(d, kind).write(file, file_format=kind, **options)
                made[f"{name}, {d}-D"] = file.read_bytes()
    return made


def _mesh(d: int, kind: str) -> meshio.Mesh:
    points = SQUARE if d == 2 else CORNERS
    simplices = ("triangle", QUARTERS) if d == 2 else ("tetra", TETRAHEDRA)
    sides = ("line", np.array([[0, 1], [1, 2]])) if d == 2 else ("triangle", np.array([[0, 1, 2]]))
    if kind == "gmsh":  # meshio's writer wants to know the entities of several kinds of cells
        tags = [np.full(len(simplices[1]), 1)]
        return meshio.Mesh(points, [simplices], cell_data={"gmsh:physical": tags})
    tags = [np.full(len(sides[1]), 3), np.full(len(simplices[1]), 1)]
    named = {"cell_data": {"gmsh:physical": tags, "gmsh:geometrical": tags}} if (
        kind == "gmsh22") else {}
    sets = {"point_sets": {"ends": np.array([0, 1])}} if kind == "abaqus" else {}
    return meshio.Mesh(points, [sides, simplices], **named, **sets)


def mutants(seed: int, count: int) -> Iterator[tuple[str, str, bytes]]:
    """(what was done, ending, bytes) of `count` damaged files, the formats in turn."""
    known = list(originals().items())
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        name, data = known[number % len(known)]
        done = []
        for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
            change = CHANGES[int(rng.integers(len(CHANGES)))]
            done.append(change.__name__.strip("_"))
            data = change(data, rng)
        yield f"[{seed}, {number}] {name}: {', '.join(done)}", WRITERS[name[:-5]][0], data


def _bytes(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for at in rng.integers(len(data), size=int(rng.integers(1, 9))) if data else ():
        changed[at] = rng.integers(256)
    return bytes(changed)


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _hole(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = sorted(rng.integers(len(data) + 1, size=2))
    return data[:a] + data[b:]


def _twice(data: bytes, rng: np.random.Generator) -> bytes:
    a, b = sorted(rng.integers(len(data) + 1, size=2))
    return data[:b] + data[a:]


def _line_gone(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.splitlines(keepends=True)
    if lines:
        del lines[int(rng.integers(len(lines)))]
    return b"".join(lines)


def _lines_swapped(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.splitlines(keepends=True)
    if lines:
        i, j = rng.integers(len(lines), size=2)
        lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def _line_repeated(data: bytes, rng: np.random.Generator) -> bytes:
    lines = data.splitlines(keepends=True)
    if lines:
        i = int(rng.integers(len(lines)))
        lines[i:i] = lines[i:i + 1] * int(rng.integers(1, 2000))
    return b"".join(lines)


NUMBERS = (b"0", b"-1", b"1", b"7", b"99999", b"1000000000000", b"9223372036854775808", b"nan",
           b"inf", b"1e308", b"1e-320", b"x", b"", b"0.5", b"3 4", b"-0")


def _number(data: bytes, rng: np.random.Generator) -> bytes:
    words = data.split(b" ")
    numbers = [i for i, w in enumerate(words) if w.strip()[:1].isdigit()]
    if numbers:
        at = numbers[int(rng.integers(len(numbers)))]
        tail = b"\n" if words[at].endswith(b"\n") else b""
        words[at] = NUMBERS[int(rng.integers(len(NUMBERS)))] + tail
    return b" ".join(words)


def _count(data: bytes, rng: np.random.Generator) -> bytes:
    """A line that is one number, such as a count, says another."""
    lines = data.splitlines(keepends=True)
    alone = [i for i, w in enumerate(lines) if w.strip().isdigit()]
    if alone:
        at = alone[int(rng.integers(len(alone)))]
        lines[at] = NUMBERS[int(rng.integers(len(NUMBERS)))] + b"\n"
    return b"".join(lines)


def _integer(data: bytes, rng: np.random.Generator) -> bytes:
    """Four or eight bytes of a binary part become an integer out of range."""
    size = int(rng.choice([4, 8]))
    if len(data) < size:
        return data
    at = int(rng.integers(len(data) - size + 1))
    value = int(rng.choice([0, -1, 5, 2**20, 2**31 - 1]))
    return data[:at] + value.to_bytes(size, "little", signed=True) + data[at + size:]


def _empty(data: bytes, rng: np.random.Generator) -> bytes:
    return b"" if rng.integers(10) == 0 else data


CHANGES: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    _bytes, _cut, _hole, _twice, _line_gone, _lines_swapped, _line_repeated, _number, _number,
    _count, _count, _integer, _empty)
ENDINGS = {f".{ending}" for ending, _, _ in WRITERS.values()}
