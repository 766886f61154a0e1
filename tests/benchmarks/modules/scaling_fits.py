"""What is made of the rows of `scaling.py`: runs put together, exponents."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from modules import report

LIMIT = 0.05
"""Of the exponents of reduced steps, 0 if nothing of the mesh's size is touched."""


def join(files: Sequence[Path], tables: Mapping[str, report.Table]) -> None:
    """The rows of several runs, from coarse to fine; of what was run twice the last."""
    for file in files:
        found = {t["title"]: t["rows"] for t in json.loads(file.read_text())["tables"]}
        for name, table in tables.items():
            if name != "fits":
                table.rows += found.get(table.title, [])
    for table in tables.values():
        keys = ("fields", "unknowns", "method", "block", "tried", "steps", "atoms")
        last = {tuple(row.get(k) for k in keys): row for row in table.rows}
        table.rows[:] = sorted(last.values(), key=lambda r: (
            r["fields"], r.get("tetrahedra", r.get("triangles"))))


def fits(out: report.Report, tables: Mapping[str, report.Table]) -> None:
    """Exponents of time and memory over the unknowns, and what is wanted of the reduced ones."""
    for (name, method), rows in _series(
            [*tables["steps"].rows, *tables["nonlinear"].rows]).items():
        n = np.log([r["unknowns"] for r in rows])
        slope = float(np.polyfit(n, np.log([r["least"] for r in rows]), 1)[0])
        memory = None
        if all("peak" in r for r in rows):
            memory = float(np.polyfit(n, np.log([r["peak"] - r["base"] for r in rows]), 1)[0])
        tables["fits"].add(fields=name, method=method, meshes=len(rows), exponent=slope,
                           memory=memory)
        if not method.startswith("full"):
            out.at_most(f"|online exponent| of {method}, {name}", abs(slope), LIMIT)


def _series(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], list[Mapping[str, Any]]]:
    """Rows that were timed, by fields and method; those with at least two meshes."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for r in rows:
        if r["ms"] is not None:
            found.setdefault((r["fields"], r["method"]), []).append(r)
    return {key: rows for key, rows in found.items() if len(rows) > 1}
