"""What every benchmark prints and writes: settings, tables, targets. Ctrl-C keeps what there is."""

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sparsemor.plugins.publishing.tables import text_table


@dataclass
class Table:
    """Rows as they come. formats: how numbers of a column are printed (the JSON has all digits)."""

    title: str
    formats: Mapping[str, str] = field(default_factory=dict)
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, **row: Any) -> None:
        self.rows.append(row)

    def __str__(self) -> str:
        if not self.rows:
            return f"{self.title}\n(nothing)"
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        body = [[self._text(name, row.get(name)) for name in columns] for row in self.rows]
        return f"{self.title}\n" + text_table([[c.replace("_", " ") for c in columns], *body])

    def _text(self, column: str, value: Any) -> str:
        if value is None:
            return "-"
        if isinstance(value, float):
            return format(value, self.formats.get(column, ".3g"))
        return str(value)


@dataclass
class Report:
    """Settings, tables and targets of one benchmark, in the order in which they were made."""

    name: str
    settings: dict[str, Any] = field(default_factory=dict)
    tables: list[Table] = field(default_factory=list)
    targets: list[dict[str, Any]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    interrupted: bool = False

    def table(self, title: str, **formats: str) -> Table:
        made = Table(title, formats)
        self.tables.append(made)
        return made

    def at_most(self, what: str, value: float, limit: float) -> None:
        self._target(what, value, "<=", limit, value <= limit)

    def at_least(self, what: str, value: float, limit: float) -> None:
        self._target(what, value, ">=", limit, value >= limit)

    def _target(self, what: str, value: float, sign: str, limit: float, met: bool) -> None:
        self.targets.append({
            "target": what, "measured": float(value), "wanted": f"{sign} {limit:g}",
            "verdict": "met" if met else "MISSED"})

    def __str__(self) -> str:
        lines = [f"{self.name}: " + ("INTERRUPTED, what there was" if self.interrupted else "done")]
        width = max((len(k) for k in self.settings), default=0)
        lines += [f"  {k:<{width}}  {v}" for k, v in self.settings.items()]
        parts = ["\n".join(lines), *map(str, self.tables)]
        if self.targets:
            parts.append(str(Table("Targets", {}, self.targets)))
        if self.remarks:
            parts.append("\n".join(self.remarks))
        return "\n\n".join(parts)

    def to_json(self) -> str:
        tables = [{"title": t.title, "rows": t.rows} for t in self.tables]
        everything = {
            "name": self.name, "interrupted": self.interrupted, "settings": self.settings,
            "tables": tables, "targets": self.targets, "remarks": self.remarks}
        return json.dumps(everything, indent=1, allow_nan=False)


def options(name: str, text: str | None) -> argparse.ArgumentParser:
    """The options that every benchmark has."""
    parser = argparse.ArgumentParser(prog=name, description=text)
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it still work?")
    parser.add_argument("--out", type=Path, help="write everything as JSON to this file")
    return parser


def run_plan(
    name: str, fill: Callable[[Report, argparse.Namespace], None], arguments: argparse.Namespace,
) -> int:
    """Fill a report, print it to standard output and write it; Ctrl-C keeps what there is."""
    report = Report(name)
    report.settings |= {"versions": _versions(), "processor": _processor(),
                        "threads": "1 (OPENBLAS_NUM_THREADS, OMP_NUM_THREADS, MKL_NUM_THREADS)"}
    begun = time.perf_counter()
    try:
        fill(report, arguments)
    except KeyboardInterrupt:
        report.interrupted = True
    report.settings["took"] = f"{time.perf_counter() - begun:.0f} s"
    print(report)
    if arguments.out is not None:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(report.to_json() + "\n", encoding="utf-8")
    return 130 if report.interrupted else 0


def progress(text: str) -> None:
    """One line on standard error."""
    print(f"[{time.strftime('%H:%M:%S')}] {text}", file=sys.stderr, flush=True)


def quantiles(values: Sequence[float]) -> dict[str, float]:
    """Smallest, median and largest."""
    ordered = sorted(values)
    middle = len(ordered) // 2
    even = len(ordered) % 2 == 0
    median = (ordered[middle - 1] + ordered[middle]) / 2 if even else ordered[middle]
    return {"least": ordered[0], "median": median, "most": ordered[-1]}


def _versions() -> str:
    names = ("sparsemor", "numpy", "scipy")
    return ", ".join([f"python {platform.python_version()}",
                      *(f"{name} {version(name)}" for name in names)])


def _processor() -> str:
    facts = Path("/proc/cpuinfo")
    if facts.exists():
        for line in facts.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
