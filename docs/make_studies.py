"""Writes the tables of the pages from those of studies.

    sparsemor study brake_untf --out runs/brake_untf
    python docs/make_studies.py runs/brake_untf/table.csv   # copies it to docs/measured/studies
    python docs/make_studies.py                             # writes all tables again

A table stands between `<!-- study NAME: MEASURE by COLUMN, .. -->` and `<!-- end -->`: one line a
value of the first columns, one column a value of the last; of several measures, one line a value of
all columns and one column a measure. `where COLUMN=VALUE|VALUE` after the columns leaves the other
runs out. Over seeds it shows the median and the worst, and how many runs did not end well.
"""

import csv
import re
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
PAGES = tuple(HERE / "validation" / f"{name}.md" for name in (
    "ablations", "slider-plate", "brake-disk"))
TABLES = HERE / "measured" / "studies"
MARK = re.compile(
    r"(<!-- study (\w+): (\w+(?:, \w+)*) by ([^>]+?)(?: where ([^=>]+)=([^>]+?))? -->\n).*?"
    r"(<!-- end -->)", re.DOTALL)
Row = Mapping[str, str]


def rows_of(study: str, folder: Path = TABLES) -> list[Row]:
    with (folder / f"{study}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def table(rows: Sequence[Row], measure: str, columns: Sequence[str]) -> str:
    """Markdown: lines by all columns but the last, which runs across."""
    *down, across = columns
    lines = list(dict.fromkeys(tuple(r[c] for c in down) for r in rows))
    heads = list(dict.fromkeys(r[across] for r in rows))
    over = [f"{short(across)} {heads[0]}", *heads[1:]]
    out = ["| " + " | ".join([*map(short, down), *over]) + " |",
           "|" + "---|" * (len(down) + len(heads))]
    for line in lines:
        here = [r for r in rows if tuple(r[c] for c in down) == line]
        cells = [cell([r for r in here if r[across] == h], measure) for h in heads]
        out.append("| " + " | ".join([*map(name, line), *cells]) + " |")
    return "\n".join(out) + "\n"


def beside(rows: Sequence[Row], measures: Sequence[str], columns: Sequence[str]) -> str:
    """Markdown: lines by all columns, measures side by side, and how each ended."""
    lines = list(dict.fromkeys(tuple(r[c] for c in columns) for r in rows))
    heads = [m.replace("start_up", "start-up").replace("_", " ") for m in measures]
    out = ["| " + " | ".join([*map(short, columns), *heads]) + " |",
           "|" + "---|" * (len(columns) + len(heads))]
    for line in lines:
        here = [r for r in rows if tuple(r[c] for c in columns) == line]
        out.append("| " + " | ".join([*map(name, line), *(cell(here, m) for m in measures)]) + " |")
    return "\n".join(out) + "\n"


def cell(rows: Iterable[Row], measure: str) -> str:
    """Median and worst over the runs that ended well, and how many did not, with their status."""
    runs = list(rows)
    if not runs:
        return ""
    good = [float(r[measure]) for r in runs if r["status"] == "done" and r[measure]]
    bad: dict[str, int] = {}
    for r in runs:
        if r["status"] != "done":
            bad[r["status"]] = bad.get(r["status"], 0) + 1
    parts = []
    if good:
        text = f"{median(good):.2g}"
        parts.append(text if len(good) == 1 or f"{max(good):.2g}" == text
                     else f"{text}, worst {max(good):.2g}")
    parts += [status if len(runs) == 1 else f"{n} of {len(runs)} {status}"
              for status, n in bad.items()]
    return "; ".join(parts)


def short(column: str) -> str:
    """The last word of a dotted key; `*.elastic` counts as one."""
    parts = column.replace('"', "").replace("*.", "").split(".")
    return " ".join(parts[-2:]) if parts[-1] in ("atoms", "rows") and len(parts) > 1 else parts[-1]


def name(value: str) -> str:
    found = re.fullmatch(r'\{"use":"(\w+)".*\}', value)
    return found.group(1) if found else value


def page(text: str, folder: Path = TABLES) -> str:
    """The page with every table made again."""
    def made(match: re.Match[str]) -> str:
        head, study, measure, columns, only, values, end = match.groups()
        names, measures = ([c.strip() for c in text.split(",")] for text in (columns, measure))
        rows = [r for r in rows_of(study, folder) if not only or r[only] in values.split("|")]
        if len(measures) > 1:
            return head + beside(rows, measures, names) + end
        return head + table(rows, measure, names) + end

    return MARK.sub(made, text)


def main(given: Sequence[str]) -> None:
    TABLES.mkdir(parents=True, exist_ok=True)
    for file in map(Path, given):
        shutil.copyfile(file, TABLES / f"{file.parent.name}.csv")
    for file in PAGES:
        file.write_text(page(file.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
