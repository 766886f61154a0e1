"""Three tasks by this product, pyMOR, Exudyn and romtools: the table of docs/validation/peers.md.

    python tests/benchmarks/peers/side_by_side.py [--quick] [--out peers.json] [--page PAGE]

`--page` writes the tables between the markers of the page, and docs/measured/peers.json. Needs
`pip install pymor exudyn romtools`; codes that are not installed are left out and named.
"""

import argparse
import inspect
import json
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.append(str(Path(__file__).parents[1]))
import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
import heat
import numpy as np
import rod
from modules import report

BEGIN, END = "<!-- table of peers -->", "<!-- end -->"
NAMES = {"sparsemor": "sparsemor", "pymor": "pyMOR", "exudyn": "Exudyn", "romtools": "romtools"}
STORED = Path(__file__).parents[3] / "docs" / "measured" / "peers.json"


def lines(*functions: Callable[..., Any]) -> int:
    """Lines of code of functions without their docstrings."""
    texts = [inspect.getsource(f) for f in functions]
    for i, f in enumerate(functions):
        texts[i] = texts[i].replace(f'"""{f.__doc__}"""', "") if f.__doc__ else texts[i]
    return sum(1 for text in texts for line in text.splitlines() if line.strip())


def add(table: report.Table, code: str, size: int, error: float, step: float, whole: float,
        full: float, written: int) -> None:
    table.add(code=code, size=size, error=error, ms_per_step=1e3 * step, full_order=full / step,
              whole_s=whole, lines=written)


def apart(got: Any, want: Any) -> float:
    return float(np.abs(np.asarray(got) - want).max() / np.abs(want).max())


def compiled_crank(body: rod.Rod, size: int) -> Any:
    return rod.sparsemor_crank(body, size, "on")


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.process_time()
    found = call()
    return found, time.process_time() - begun


def fill(out: report.Report, given: argparse.Namespace) -> None:
    missing = [name for name in NAMES if find_spec(name) is None]
    out.settings["left out, not installed"] = ", ".join(missing) or "none"
    quick = given.quick
    if "pymor" not in missing:
        from pymor.core.logger import set_log_levels
        set_log_levels({"pymor": "ERROR"})
    formats = {"error": ".1e", "ms_per_step": ".2g", "full_order": ".2g", "whole_s": ".1f"}
    with TemporaryDirectory() as name:
        if quick:
            rod.END = rod.TURN = 0.002
            heat.END = 10.0
        body = rod.Rod(Path(name), (4, 1, 1) if quick else (24, 2, 2))
        want, seconds = timed(lambda: rod.reference(body))
        full = seconds / len(want)
        table = out.table(f"Rod, {body.X.size} unknowns", **formats)
        for size in (8,) if quick else (8, 16):
            for code, run, more in (
                    ("sparsemor", rod.sparsemor_rod, ()), ("pymor", rod.pymor_rod, (rod.newmark,)),
                    ("exudyn", rod.exudyn_rod, (rod.exudyn_modes, rod.exudyn_solve))):
                if code in missing:
                    continue
                report.progress(f"rod, {code}, {size}")
                (y, step), whole = timed(lambda run=run, size=size: run(body, size))
                y = np.asarray(y)
                add(table, NAMES[code], size, apart(y if y.ndim == 1 else y[:, 2], want), step,
                    whole, full, lines(run, *more))
        table = out.table("Slider-crank with that rod", difference=".1e", ms_per_step=".2g",
                          whole_s=".1f")
        first: Any = None
        for size in (6,):
            for code, label, run, code_of in (
                    ("sparsemor", "sparsemor", rod.sparsemor_crank, (rod.sparsemor_crank,)),
                    *([] if quick else [("sparsemor", "sparsemor, compiled", compiled_crank,
                                         (rod.sparsemor_crank,))]),
                    ("exudyn", "Exudyn", rod.exudyn_crank,
                     (rod.exudyn_crank, rod.exudyn_modes, rod.exudyn_solve))):
                if code in missing:
                    continue
                report.progress(f"crank, {label}, {size}")
                if run is compiled_crank:  # the first run of a kind compiles
                    run(body, size)
                (y, step), whole = timed(lambda run=run, size=size: run(body, size))
                first = y if label == "sparsemor" else first
                table.add(code=label, modes=size, difference=float(np.abs(y - first).max()),
                          ms_per_step=1e3 * step, whole_s=whole, lines=lines(*code_of))
        plate = heat.Plate(8 if quick else 60)
        X, seconds = timed(lambda: heat.reference(plate))
        full = seconds / len(X)
        table = out.table(f"Heat with k(T), {len(plate.free)} unknowns", **formats)
        folder = Path(name)
        for size in (4,) if quick else (6, 12):
            runs: Sequence[tuple[str, str, Callable[[], Any], Sequence[Any]]] = (
                *(("sparsemor", f"sparsemor, {use}", lambda use=use, size=size: heat.sparsemor_heat(
                    plate, X, size, folder, use), (heat.sparsemor_heat,))
                  for use in ("sparse", "deim", "ecsw")),
                ("pymor", "pyMOR, DEIM", lambda size=size: heat.pymor_heat(plate, X, size),
                 (heat.pymor_heat, heat.projected, heat.euler)),
                ("romtools", "romtools, DEIM", lambda size=size: heat.romtools_heat(
                    plate, X, size), (heat.romtools_heat, heat.projected, heat.euler)))
            for code, label, call, code_of in runs:
                if code in missing:
                    continue
                report.progress(f"heat, {label}, {size}")
                (y, step), whole = timed(call)
                add(table, label, size, apart(y, X), step, whole, full, lines(*code_of))


def page_tables(tables: Sequence[dict[str, Any]]) -> str:
    """The stored tables as they stand in the page."""
    parts = []
    for table in tables:
        head = list(table["rows"][0])
        rows = [[_text(c, row.get(c)) for c in head] for row in table["rows"]]
        parts.append("\n".join([
            f"**{table['title']}**\n", "| " + " | ".join(c.replace("_", " ") for c in head) + " |",
            "|" + "---|" * len(head), *("| " + " | ".join(r) + " |" for r in rows)]))
    return "\n\n".join(parts)


def _text(column: str, value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        form = {"error": ".1e", "difference": ".1e", "whole_s": ".1f"}.get(column, ".2g")
        return format(float(format(value, form)), "g") if form == ".2g" else format(value, form)
    return str(value)


def written(page: str, tables: Sequence[dict[str, Any]]) -> str:
    """The page with the tables between its markers."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n{page_tables(tables)}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    parser = report.options("side_by_side", __doc__)
    parser.add_argument("--page", type=Path, help="write the tables into this page")
    arguments = parser.parse_args()
    if arguments.page is not None:
        arguments.out = STORED
    code = report.run_plan("side_by_side", fill, arguments)
    if arguments.page is not None and code == 0:
        tables = json.loads(STORED.read_text(encoding="utf-8"))["tables"]
        arguments.page.write_text(written(arguments.page.read_text(encoding="utf-8"), tables),
                                  encoding="utf-8")
    sys.exit(code)
