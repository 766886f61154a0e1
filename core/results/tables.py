"""Tables as text: aligned columns for people, CSV for programs."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

MARK = "!"
"""Behind a number above a limit."""
CONSTANT = "constant"
"""Instead of an error relative to a change that is round-off."""


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Columns aligned with two blanks between; the first row is the head, numbers to the right, and
    a blank behind those without a mark in a column that has one."""
    rows = _spaced(rows)
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    right = [all(_numeric(row[i]) for row in rows[1:]) for i in range(len(rows[0]))]

    def line(row: Sequence[str]) -> str:
        cells = [text.rjust(w) if r else text.ljust(w)
                 for text, w, r in zip(row, widths, right, strict=True)]
        return "  ".join(cells).rstrip()

    rule = "  ".join("-" * w for w in widths)
    return "\n".join([line(rows[0]), rule, *(line(row) for row in rows[1:])])


def csv_table(rows: Iterable[Sequence[object]]) -> str:
    """Rows as CSV: numbers in full, None as an empty cell."""
    text = io.StringIO()
    plain = csv.writer(text, lineterminator="\n")
    # a lone carriage return ends a line for readers, and the module does not quote it for that
    quoted = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL)
    for row in rows:
        torn = any(isinstance(cell, str) and "\r" in cell for cell in row)
        (quoted if torn else plain).writerow(["" if cell is None else cell for cell in row])
    return text.getvalue()


def with_head(rows: Sequence[Mapping[str, object]]) -> list[list[object]]:
    """The names of all columns in the order in which rows bring them, then the rows."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return [[*names], *([row.get(name) for name in names] for row in rows)]


def number(value: float | None, form: str, missing: str = "-") -> str:
    """A number in a table; `missing` for None."""
    return missing if value is None else format(value, form)


def marked(value: float | None, form: str, limit: float) -> str:
    """The same, with the mark where it is above the limit."""
    return number(value, form) + (MARK if value is not None and value > limit else "")


def _spaced(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    columns = [list(column) for column in zip(*rows, strict=True)]
    for column in columns:
        if any(text.endswith(MARK) and _numeric(text) for text in column[1:]):
            column[1:] = [t if t.endswith(MARK) else f"{t} " for t in column[1:]]
    return [list(row) for row in zip(*columns, strict=True)]


def _numeric(text: str) -> bool:
    return text[:1].isdigit() or text.strip() in ("-", CONSTANT)
