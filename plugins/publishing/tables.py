"""Formatting of tables: aligned text for the terminal, and CSV."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

MARK = "!"
"""Mark behind a number that exceeds its limit."""
CONSTANT = "constant"
"""Text for the error of a constant quantity, whose change, the reference of relative errors, is
round-off."""


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Text table with aligned columns, two blanks apart; the first row is the header.

    Numbers are right-aligned; in columns that contain marked numbers, the others get a trailing
    blank.
    """
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
    """CSV text of rows: numbers with all digits, None as an empty cell."""
    text = io.StringIO()
    plain = csv.writer(text, lineterminator="\n")
    # a lone carriage return ends a line for readers, and the module does not quote it for that
    quoted = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL)
    for row in rows:
        torn = any(isinstance(cell, str) and "\r" in cell for cell in row)
        (quoted if torn else plain).writerow(["" if cell is None else cell for cell in row])
    return text.getvalue()


def with_head(rows: Sequence[Mapping[str, object]]) -> list[list[object]]:
    """Table with header: names of all columns in the order of their first occurrence, then one row
    per mapping."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    return [[*names], *([row.get(name) for name in names] for row in rows)]


def number(value: float | None, form: str, missing: str = "-") -> str:
    """Formatted number (`form`: Python format specification); `missing` for None."""
    return missing if value is None else format(value, form)


def marked(value: float | None, form: str, limit: float) -> str:
    """Formatted number, followed by the mark if it exceeds `limit`; "-" for None."""
    return number(value, form) + (MARK if value is not None and value > limit else "")


def _spaced(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    columns = [list(column) for column in zip(*rows, strict=True)]
    for column in columns:
        if any(text.endswith(MARK) and _numeric(text) for text in column[1:]):
            column[1:] = [t if t.endswith(MARK) else f"{t} " for t in column[1:]]
    return [list(row) for row in zip(*columns, strict=True)]


def _numeric(text: str) -> bool:
    return text[:1].isdigit() or text.strip() in ("-", CONSTANT)
