"""Output folder of a study: rows, appended as runs end, and the final table."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sparsemor.core.errors import InputError
from sparsemor.core.results.files.written_files import Written
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.plugins.publishing.listed_files import (
    add_to_listing,
    append_listed,
    drop_cut_line,
    publishing,
    write_listed,
)
from sparsemor.plugins.publishing.tables import csv_table
from sparsemor.plugins.study.plan import Drawing, StudyPlan
from sparsemor.plugins.study.table_columns import TIMES, cell, fact_columns, with_facts

STUDY = "study"
"""Kind of the list of a study."""
CHARTS = ("work_precision.png", "work_precision.svg", "error_over_time.png", "error_over_time.svg")
WRITES = ("study.json", "table.csv", "table.jsonl", "runs.parquet", *CHARTS)
"""Files besides the rows, which are checked when they are read."""
ABOUT, LINES, CSV = "study.json", "runs.jsonl", "runs.csv"


@dataclass(frozen=True, slots=True, eq=False)
class Journal:
    """Rows of a study on disk. `runs.jsonl` is authoritative; `runs.csv` is a copy for other
    programs, rewritten when the study is continued."""

    folder: Path
    columns: tuple[str, ...]
    _written: dict[str, Written] = field(default_factory=dict)
    """Size and CRC-32 of the files that grow."""

    @classmethod
    def open(cls, folder: Path, plan: StudyPlan, force: bool = False) -> "Journal":
        """Journal in a new folder, or in the folder of the same study. Raises InputError if the
        folder contains other data; not with `force`: an earlier study has then been set aside, and
        what is left are a user's own files, which stay."""
        about = folder / ABOUT
        if about.is_file():
            try:
                kept = json.loads(about.read_text(encoding="utf-8"))
            except ValueError:
                kept = {}
            if kept.get("digest") != plan.digest:
                raise InputError(
                    f"{folder} contains another study, or this one before its file, its scene or "
                    "the program changed: choose another --out, replace it with --force, or draw "
                    f"its table again by `sparsemor study {folder}`", "out")
        else:
            if not force and OutputDirectory(folder).occupied():
                raise InputError(f"{folder} is not empty and contains no study: choose another "
                                 "--out", "out")
            OutputDirectory(folder).make()
            add_to_listing(folder, (), STUDY)
        _replace(folder, ABOUT, json.dumps(
            {"format": 1, "study": plan.study.name, "digest": plan.digest,
             "runs": len(plan.runs), "columns": plan.columns, "settings": plan.settings,
             "drawing": plan.drawing.plain()}, indent=2) + "\n")
        return cls(folder, plan.columns)

    def rows(self, drop: Sequence[str] = ()) -> list[dict[str, Any]]:
        """Committed rows, without an incomplete last line and without rows whose status is in
        `drop`.

        Rewrites `runs.jsonl` and `runs.csv` with these rows. _written: file -> its length and
        checksum as listed, which `add` continues.
        """
        lines = self.folder / LINES
        drop_cut_line(self.folder, LINES)
        found = list(_whole_lines(lines)) if lines.exists() else []
        kept = [row for row in found if row["status"] not in drop]
        self._written[LINES] = _replace(self.folder, LINES, "".join(_line(r) for r in kept))
        self._written[CSV] = _replace(
            self.folder, CSV, csv_table([self.columns, *_cells(self.columns, kept)]))
        return kept

    def add(self, row: Mapping[str, Any]) -> None:
        """Commits one row: it is on disk when the method returns."""
        full = {name: row.get(name) for name in self.columns}
        for name, text in ((LINES, _line(full)),
                           (CSV, csv_table(_cells(self.columns, [full])))):
            self._written[name] = append_listed(
                self.folder, name, text.encode(), self._written.get(name, (0, 0)))

    def write_table(self, rows: Sequence[Mapping[str, Any]], times: bool) -> list[Path]:
        """Writes table.csv, table.jsonl and, with pyarrow, runs.parquet, sorted by run, with a
        column for every number that the step solvers report; returns their paths. Without `times`,
        two executions give identical files."""
        facts = fact_columns(rows)
        names = [n for n in (*self.columns, *facts) if times or n not in TIMES]
        ordered = sorted(rows, key=lambda row: int(row["run"]))
        table = [{n: r[n] for n in names} for r in (with_facts(row, facts) for row in ordered)]
        _replace(self.folder, "table.csv", csv_table([names, *_cells(names, table)]))
        _replace(self.folder, "table.jsonl", "".join(_line(row) for row in table))
        parquet = _write_parquet(self.folder, "runs.parquet", names, table)
        return [self.folder / "table.csv", self.folder / "table.jsonl", *parquet]


def is_study(folder: Path) -> bool:
    """True if a directory contains an earlier study."""
    return (folder / ABOUT).is_file()


def stored(folder: Path) -> tuple[Drawing, list[dict[str, Any]]]:
    """Drawing and rows of the study in a folder, by run. Raises InputError where they cannot be
    read."""
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        drawing = Drawing.of_plain(about["drawing"])
    except (ValueError, KeyError, TypeError, OSError):
        raise InputError(f"{folder / ABOUT} is damaged, or of an earlier version of this program: "
                         "run the study again with --force") from None
    lines = folder / LINES
    rows = {row["run"]: row for row in (_whole_lines(lines) if lines.exists() else ())}
    return drawing, [rows[number] for number in sorted(rows)]


def _whole_lines(path: Path) -> Iterator[dict[str, Any]]:
    for line in path.read_bytes().splitlines(keepends=True):
        if not line.endswith(b"\n"):
            return
        try:
            row = json.loads(line)
        except ValueError:
            return  # a disk that lost power may hold anything behind the last whole row
        yield row


def _line(row: Mapping[str, Any]) -> str:
    return json.dumps(row, separators=(",", ":"), allow_nan=False) + "\n"


def _cells(names: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    return [[cell(row.get(n)) for n in names] for row in rows]


def _replace(folder: Path, name: str, text: str) -> Written:
    return write_listed(folder, name, text.encode(), synced=True)


def _write_parquet(
    folder: Path, name: str, names: Sequence[str], rows: Sequence[Mapping[str, Any]]
) -> list[Path]:
    """Writes a Parquet file; columns of mixed types become text. Returns [] without pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return []
    columns = {n: _of_one_type([row[n] for row in rows]) for n in names}
    table = pyarrow.table({n: pyarrow.array(values) for n, values in columns.items()})
    with publishing(folder) as fresh:
        parquet.write_table(table, fresh / name)
    return [folder / name]


def _of_one_type(values: list[Any]) -> list[Any]:
    kinds = {type(v) for v in values if v is not None}
    if kinds == {int, float}:
        return [None if v is None else float(v) for v in values]
    if len(kinds) <= 1 and not kinds & {dict, list}:
        return values
    return [None if v is None else cell(v) for v in values]
