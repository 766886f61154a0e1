"""Writes the table of docs/validation/reproduce.md from the verdicts of `sparsemor reproduce`.

    python docs/make_reproduction.py runs/reproduce-quick     # copies its tables to docs/measured
    python docs/make_reproduction.py                          # writes the table again

The table stands between `<!-- verdicts -->` and `<!-- end -->`.
"""

import csv
import json
import re
import shutil
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap

from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.liang2026.item_functions import Value
from sparsemor.plugins.liang2026.page import text_of
from sparsemor.plugins.liang2026.paper import GRADES, MISSED, PaperFile, PaperItem

HERE = Path(__file__).parent
PAGE = HERE / "validation" / "reproduce.md"
TABLES = HERE / "measured" / "reproduction"
QUICK, WHOLE = "quick", "whole"
MARK = re.compile(r"(<!-- verdicts -->\n).*?(<!-- end -->)", re.DOTALL)
Values = Mapping[str, Value]


def stored(kind: str) -> dict[str, tuple[str, Values]]:
    """Item -> verdict and values of a stored reproduction; empty if it was not run."""
    if not (TABLES / f"{kind}-verdicts.csv").is_file():
        return {}
    values: dict[str, dict[str, Value]] = {}
    for row in read(TABLES / f"{kind}-numbers.csv"):
        known = values.setdefault(row["item"], {})
        known |= {row["name"]: value(row["here"]), f"paper_{row['name']}": value(row["published"])}
    return {row["item"]: (row["verdict"], values[row["item"]])
            for row in read(TABLES / f"{kind}-verdicts.csv")}


def read(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def value(cell: str) -> Value:
    try:
        return float(cell) if cell else None
    except ValueError:
        return cell


def table(file: PaperFile) -> str:
    """Markdown: how many verdicts of each kind, which items are `reproduced`, a line for each other
    one, and why items that are neither `better` nor `reproduced` are not."""
    quick, whole = stored(QUICK), stored(WHOLE)
    out = [f"* `sparsemor reproduce{option}`: "
           f"{counted([g for g, _ in found.values()]) or 'not run for this table'}."
           for option, found in ((" --quick", quick), ("", whole))]
    lines, same, reasons = [], [], []
    for item in file.items:
        verdict, latest = (whole if item.id in whole else quick)[item.id]
        short = quick[item.id][0]
        if verdict == short == GRADES[1]:
            same.append(item.name)
            continue
        shown = verdict if verdict == short else f"{verdict}, quick: {short}"
        lines.append(f"| {item.name} | {item.title} | {compared(item, latest)} | {shown} |")
        if verdict not in GRADES[:2]:
            reasons += wrap(f"* {item.name}, {verdict}: {' '.join(item.shortfall.split())}", 100,
                            subsequent_indent="  ")
    out += wrap(f"* `{GRADES[1]}` in both: {', '.join(same)}.", 100, subsequent_indent="  ")
    return "\n".join([*out, "", "| item | content | published → computed | verdict |",
                      "|---|---|---|---|", *lines, "", *reasons]) + "\n"


def counted(grades: Sequence[str]) -> str:
    counts = Counter(grades)
    return ", ".join(f"{counts[g]} `{g}`" for g in sorted(counts, key=[*GRADES, MISSED].index))


def compared(item: PaperItem, values: Values) -> str:
    """The first published number that is no datum of the scene, with ours."""
    shown = [n for n, v in item.values.items() if v.paper is not None][:1]
    return ", ".join(f"{text_of(values[f'paper_{n}'])} → {text_of(values[n])}"
                     f"{item.values[n].unit and ' ' + item.values[n].unit}" for n in shown) or "–"


def keep(folder: Path) -> None:
    about = json.loads((folder / "reproduction.json").read_text(encoding="utf-8"))
    TABLES.mkdir(exist_ok=True)
    for name in ("verdicts", "numbers"):
        shutil.copy(folder / f"{name}.csv",
                    TABLES / f"{QUICK if about['quick'] else WHOLE}-{name}.csv")


def main(folders: Sequence[str]) -> None:
    for folder in folders:
        keep(Path(folder))
    text = PAGE.read_text(encoding="utf-8")
    file = PaperFile.read("liang_2026", Registry())
    PAGE.write_text(MARK.sub(lambda m: m[1] + table(file) + m[2], text), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
