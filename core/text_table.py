"""A table in plain text."""

from collections.abc import Sequence

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


def marked(value: float | None, form: str, limit: float) -> str:
    """A number in a table, with the mark where it is above the limit; "-" for None."""
    if value is None:
        return "-"
    return format(value, form) + (MARK if value > limit else "")


def _spaced(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    columns = [list(column) for column in zip(*rows, strict=True)]
    for column in columns:
        if any(text.endswith(MARK) and _numeric(text) for text in column[1:]):
            column[1:] = [t if t.endswith(MARK) else f"{t} " for t in column[1:]]
    return [list(row) for row in zip(*columns, strict=True)]


def _numeric(text: str) -> bool:
    return text[:1].isdigit() or text.strip() in ("-", CONSTANT)
