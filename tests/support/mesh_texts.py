"""One bar of two metals as text of each mesh format, its lines in any order and form."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.mesh import Mesh

T = TypeVar("T")
ENDS = ("HOT", "COLD")


@dataclass(frozen=True)
class Bar:
    """Bar 0.2 x 0.02 m (x 0.02 m): points, cells, number of the metal (1, 2) of each cell, facets
    of the ends."""

    points: FloatArray
    cells: IntArray
    metal: IntArray
    ends: dict[str, IntArray]

    @property
    def d(self) -> int:
        return int(self.cells.shape[1]) - 1


def bar(d: int = 2, x: Sequence[float] = (), second: tuple[float, float] = (0.1, 0.2)) -> Bar:
    """Quads or boxes along x, ten by default, one element over the height; metal 2 is between the
    two ends `second`."""
    along = np.array(x) if x else np.linspace(0.0, 0.2, 11)
    shape = (len(along), 2, 2)[:d]
    grid = np.indices(shape).reshape(d, -1).T * 0.02
    grid[:, 0] = along[np.indices(shape)[0].ravel()]
    number = np.arange(np.prod(shape)).reshape(shape)
    cells = []
    for i in range(len(along) - 1):
        if d == 2:
            a, b, c, e = number[i, 0], number[i + 1, 0], number[i + 1, 1], number[i, 1]
            cells += [[a, b, c], [a, c, e]]
        else:  # Kuhn's six tetrahedra: paths along the axes from the first to the last corner
            for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
                at = np.array([i, 0, 0])
                path = [number[tuple(at)]]
                for axis in order:
                    at[axis] += 1
                    path.append(number[tuple(at)])
                cells.append(path)
    table = np.array(cells)
    X = np.pad(grid, ((0, 0), (0, 3 - d)))
    size = np.linalg.det(X[table[:, 1:], :d] - X[table[:, :1], :d])
    table[size < 0] = table[size < 0][:, [*range(d - 1), d, d - 1]]
    middle = X[table, 0].mean(axis=1)
    metal = np.where((middle > second[0]) & (middle < second[1]), 2, 1)
    ends = {}
    for name, at in zip(ENDS, along[[0, -1]], strict=True):
        on = X[:, 0] == at
        ends[name] = np.array([row[on[row]] for row in table if on[row].sum() == d])
    return Bar(X, table, metal, ends)


def canonical(mesh: Mesh) -> dict[str, object]:
    """A mesh without its numbering: positions in order, cells and members of all sets by them."""
    points = np.round(mesh.points, 6) + 0.0
    order = np.lexsort(points.T)
    new = np.empty(len(order), dtype=np.int64)
    new[order] = np.arange(len(order))

    def rows(numbers: IntArray) -> list[tuple[int, ...]]:
        return sorted(tuple(sorted(row)) for row in new[numbers].tolist())

    return {"points": points[order].tolist(), "cells": rows(mesh.cells),
            "point_sets": {n: sorted(new[m].tolist()) for n, m in mesh.point_sets.items()},
            "facet_sets": {n: rows(f) for n, f in mesh.facet_sets.items()},
            "cell_sets": {n: rows(mesh.cells[c]) for n, c in mesh.cell_sets.items()}}


# ------------------------------------------------------------------------------ Abaqus

def abaqus(shape: Bar, rng: np.random.Generator | None = None) -> str:
    """Input file: node labels 10 n + 5, sets by list, by range or of the elements, and a surface;
    with rng in a random form."""
    form = _Form(rng)
    labels = 10 * form.order(len(shape.points)) + 5
    kind = {2: form.pick("CPS3", "CPE3", "DC2D3", "cps3", "CPE3T"),
            3: form.pick("C3D4", "DC3D4", "C3D4T", "c3d4")}[shape.d]
    lines = [f"*HEADING{form.comment()}", "a bar, of two metals"]
    nodes = [f"{labels[n]}, " + ", ".join(repr(float(v)) for v in shape.points[n])
             for n in form.order(len(labels))]
    half = len(nodes) // 2 if rng is not None else len(nodes)
    for part in (nodes[:half], nodes[half:]):
        lines += [form.keyword("*NODE"), *part] if part else []
    elements = form.order(len(shape.cells)) + 1
    parts = form.shuffled([[m, cells] for m in (1, 2)
                           for cells in np.array_split(np.flatnonzero(shape.metal == m),
                                                       1 if rng is None else 2)])
    for metal, cells in parts:
        lines.append(form.keyword(f"*ELEMENT, TYPE={kind}, ELSET=METAL{metal}"))
        for c in form.shuffled(list(cells)):
            row = [elements[c], *labels[shape.cells[c]]]
            lines += form.broken([str(v) for v in row], comma=True)
    for name, facets in shape.ends.items():
        own = np.unique(facets)
        lines += [form.keyword(f"*NSET, NSET={name}"), *form.broken(
            [str(v) for v in labels[own]], comma=False)]
    lines.append(form.keyword("*SURFACE, NAME=FACE, TYPE=ELEMENT"))
    sides = {2: ((0, 1), (1, 2), (2, 0)), 3: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))}[shape.d]
    for c, row in enumerate(shape.cells):
        for s, side in enumerate(sides, 1):
            if any(set(row[list(side)]) == set(f) for f in shape.ends["HOT"]):
                lines.append(f"{elements[c]}, S{s}")
    lines += [form.keyword("*MATERIAL, NAME=STEEL"), "*ELASTIC", "2.1e11, 0.3"]
    return form.text(lines, "**")


# -------------------------------------------------------------------------------- Gmsh

GMSH = {"line": 1, "triangle": 2, "tetra": 4}


def gmsh(shape: Bar, version: str = "4.1", binary: bool = False,
         rng: np.random.Generator | None = None, negative: bool = False) -> bytes:
    """Gmsh file: groups HOT, COLD of edges or faces (tags 1, 2), METAL1, METAL2 of cells (3, 4)."""
    form, d = _Form(rng), shape.d
    labels = form.order(len(shape.points)) + 7
    low, high = ("line", "triangle") if d == 2 else ("triangle", "tetra")
    groups = [(d - 1, 1, low, shape.ends["HOT"]), (d - 1, 2, low, shape.ends["COLD"]),
              (d, 3, high, shape.cells[shape.metal == 1]),
              (d, 4, high, shape.cells[shape.metal == 2])]
    groups = form.shuffled(groups)
    out = _Writer(binary)
    out.text(f"$MeshFormat\n{version} {int(binary)} 8\n")
    if binary:
        out.row([1], "<i4")
        out.text("\n")
    out.text("$EndMeshFormat\n$PhysicalNames\n4\n" + "".join(
        f'{k} {tag} "{name}"\n' for k, tag, name in form.shuffled(
            [(d - 1, 1, "HOT"), (d - 1, 2, "COLD"), (d, 3, "METAL1"), (d, 4, "METAL2")]))
        + "$EndPhysicalNames\n")
    sign = -1 if negative else 1
    if version == "4.1":
        out.text("$Entities\n")
        out.row([0, 2 * (d == 2), 2, 2 * (d == 3)], "<u8")
        for _, tag, _, _ in sorted(groups, key=lambda g: g[:2]):
            out.row([tag], "<i4", " ")
            out.row([0.0, 0, 0, 1, 1, 1], "<f8", " ")
            out.row([1], "<u8", " ")
            out.row([sign * tag], "<i4", " ")
            out.row([0], "<u8")
        out.text("\n$EndEntities\n$Nodes\n")
        n = len(labels)
        out.row([2, n, 7, n + 6], "<u8")
        order = form.order(n)
        for part, (k, parametric) in ((order[: n // 3], (1, 1)), (order[n // 3:], (2, 0))):
            out.row([k, 1, parametric], "<i4", " ")
            out.row([len(part)], "<u8")
            for i in part:
                out.row([labels[i]], "<u8")
            for i in part:
                out.row([*shape.points[i], *([0.25] * k * parametric)], "<f8")
        out.text("\n$EndNodes\n$Elements\n")
        total = sum(len(c) for *_, c in groups)
        out.row([4, total, 1, total], "<u8")
        element = 1
        for k, tag, kind, cells in groups:
            out.row([k, tag, GMSH[kind]], "<i4", " ")
            out.row([len(cells)], "<u8")
            for row in form.shuffled(list(cells)):
                out.row([element, *labels[row]], "<u8")
                element += 1
        out.text("\n$EndElements\n")
        return out.data
    out.text(f"$Nodes\n{len(labels)}\n")
    for i in form.order(len(labels)):
        out.row([labels[i]], "<i4", " ")
        out.row(shape.points[i], "<f8")
    out.text(f"\n$EndNodes\n$Elements\n{sum(len(c) for *_, c in groups)}\n")
    element = 1
    for _, tag, kind, cells in groups:
        if binary:
            out.row([GMSH[kind], len(cells), 2], "<i4")
        for row in form.shuffled(list(cells)):
            head = [element] if binary else [element, GMSH[kind], 2]
            out.row([*head, sign * tag, tag, *labels[row]], "<i4")
            element += 1
    out.text("\n$EndElements\n")
    return out.data


class _Writer:
    """Numbers as text or as bytes."""

    def __init__(self, binary: bool) -> None:
        self.binary, self.data = binary, b""

    def text(self, text: str) -> None:
        self.data += text.encode()

    def row(self, values: object, kind: str, end: str = "\n") -> None:
        row = np.asarray(values, dtype=kind)
        if self.binary:
            self.data += row.tobytes()
        else:
            self.text(" ".join(
                repr(float(v)) if kind == "<f8" else str(int(v)) for v in row) + end)


# ----------------------------------------------------------------------------- Nastran

def nastran(shape: Bar, rng: np.random.Generator | None = None, head: bool = True,
            system: int = 0, cards: str = "", coordinates: FloatArray | None = None) -> str:
    """Bulk data: METAL1, METAL2 as properties 1, 2, end faces of a solid as properties 3, 4."""
    form = _Form(rng)
    labels = form.order(len(shape.points)) + 3
    X = shape.points if coordinates is None else coordinates
    name, low = ("CTRIA3", "") if shape.d == 2 else ("CTETRA", "CTRIA3")
    rows = [["GRID", str(labels[i]), str(system) if system else "",
             *(_real(v, form) for v in X[i])] for i in range(len(labels))]
    number = 1
    for metal, cells in ((m, shape.cells[shape.metal == m]) for m in (1, 2)):
        for row in cells:
            rows.append([name, str(number), str(metal), *(str(v) for v in labels[row])])
            number += 1
    if low:
        for tag, facets in zip((3, 4), shape.ends.values(), strict=True):
            for row in facets:
                rows.append([low, str(number), str(tag), *(str(v) for v in labels[row])])
                number += 1
    lines = [line for row in form.shuffled(rows) for line in form.card(row)]
    text = form.text([*lines, *([cards] if cards else []), "MAT1    1       2.1+11          .3"],
                     "$")
    return f"SOL 101\nCEND\nBEGIN BULK\n{text}ENDDATA\n" if head else text


def _real(value: float, form: "_Form") -> str:
    """At most 8 letters, as Nastran's."""
    if value == 0.0:
        return form.pick("0.", ".0", "0.0", "0.+0")
    if rounded(value) == value:
        text = f"{value:.6g}"
        mantissa = f"{value * 1e3:.6g}"
        return form.pick(text, f"{mantissa}.-3" if "." not in mantissa else f"{mantissa}-3",
                         text.removeprefix("0") if text.startswith("0.") else text)
    return f"{value:.8g}"


def rounded(value: float) -> float:
    return float(f"{value:.4g}")


# -------------------------------------------------------------------------------- form

class _Form:
    """Random form of a text file; without a generator the plain one."""

    def __init__(self, rng: np.random.Generator | None) -> None:
        self.rng = rng

    def pick(self, *choices: str) -> str:
        return choices[0] if self.rng is None else choices[int(self.rng.integers(len(choices)))]

    def order(self, count: int) -> IntArray:
        return np.arange(count) if self.rng is None else self.rng.permutation(count)

    def shuffled(self, values: list[T]) -> list[T]:
        if self.rng is None:
            return values
        return [values[i] for i in self.rng.permutation(len(values))]

    def comment(self) -> str:
        return self.pick("", "\n** METAL1, METAL2", "\n\n**")

    def keyword(self, text: str) -> str:
        text = self.pick(text, text.lower(), text.title(), text.replace(",", " , "))
        return self.pick(text, text.replace("=", " = "), text.replace(", ", ",\n ", 1)
                         if ", " in text else text)

    def broken(self, words: list[str], comma: bool) -> list[str]:
        """A row in one line or in two, the first with a comma at its end."""
        text = self.pick(", ", ",", " , ").join(words)
        if self.rng is None or len(words) < 2 or self.rng.random() < 0.7:
            return [text + self.pick("", ",")] if not comma else [text]
        at = int(self.rng.integers(1, len(words)))
        return [", ".join(words[:at]) + ",", ", ".join(words[at:])]

    def card(self, words: list[str]) -> list[str]:
        """Bulk data card in small, large or free fields."""
        wide = any(len(w) > 8 for w in words[1:])
        form = self.pick("large" if wide else "small", "large", "free")
        data = [*words[1:], *[""] * (-(len(words) - 1) % 4)]
        if form == "free":
            return [self.pick(",", ", ").join(words)]
        if form == "small":
            line = words[0].ljust(8) + "".join(w.rjust(8) for w in words[1:])
            return [self.pick(line, line.lower() if "." not in line else line)]
        parts = [data[i : i + 4] for i in range(0, len(data), 4)]
        start, mark = self.pick(("*", "*A") [0], "*A"), ""
        lines = []
        for i, part in enumerate(parts):
            first = (words[0] + "*").ljust(8) if i == 0 else mark.ljust(8)
            last = i == len(parts) - 1
            mark = start
            lines.append(first + "".join(w.ljust(16) for w in part) + ("" if last else mark))
        return lines

    def text(self, lines: list[str], comment: str) -> str:
        """Lines with comments and, where the format allows it, blank lines between them."""
        if self.rng is None:
            return "\n".join(lines) + "\n"
        found = []
        for line in lines:
            if self.rng.random() < 0.1:
                found.append(self.pick(f"{comment} 1, 2, 3", comment, "", "   "))
            found.append(line + self.pick("", " "))
        return self.pick("\n", "\r\n").join([*found, ""])
