"""Columns of a study's table, and which of them two executions may differ in."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sparsemor.core.protocols.layout import FieldKind
from sparsemor.core.results.error_norms import measure_names

OUTCOME = ("reducer", "status", "message", "reference_status", "above_limit")
ERROR = "error_"
"""Prefix of the columns of errors over the run."""
SERIES = "error_over_time"
"""Largest errors of the time span by spans of growing length."""
COUNTS = ("steps", "t_end", "iterations", "atoms_all", "atoms_active", "rows_sampled",
          "factorizations", "support_changes", "elements_touched", "notes", "facts", "constant")
TIMES = ("ms_per_step", "reference_ms_per_step", "speed_up", "offline_s", "offline_total_s",
         "offline_cache", "online_s", "pays_after", "ms_per_step_solver", "repeats", "workers")
"""The only columns that may differ between two executions of a study."""

RESERVED = frozenset({"run", *OUTCOME[1:], SERIES, *COUNTS, *TIMES})
"""No axis may have such a name, nor that of an error. `reducer` and `seed` may be one: it then
replaces the column."""


def error_columns(fields: Iterable[FieldKind], late: bool = True) -> tuple[str, ...]:
    """Names of errors of these fields: over the run, from a time on (late), and in the first 2 % of
    the time span and the rest."""
    prefixes = (ERROR, *(("late_",) if late else ()), "start_up_", "steady_")
    measures = measure_names(fields)
    return tuple(f"{prefix}{m}" for prefix in prefixes for m in measures)


def columns_of(
    settings: Sequence[str], fields: Iterable[FieldKind], late: bool, over_time: bool = False
) -> list[str]:
    """Names in the order of the table."""
    first = ["run", *settings]
    own = [*OUTCOME, "seed", *error_columns(fields, late),
           *((SERIES,) if over_time else ()), *COUNTS, *TIMES]
    return [*first, *(name for name in own if name not in first)]


def cell(value: object) -> str:
    """A value in CSV: nothing for None, JSON for what is not a number or text."""
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def fact_columns(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """`fact.NAME` for every number that some block of some run reports."""
    names = {name for row in rows for facts in (row.get("facts") or {}).values()
             for name, value in facts.items() if _is_number(value)}
    return [f"fact.{name}" for name in sorted(names)]


def with_facts(row: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """The row with the largest value over its blocks in each `fact.NAME`."""
    blocks = (row.get("facts") or {}).values()
    added: dict[str, Any] = {}
    for name in names:
        values = [f[name[5:]] for f in blocks if _is_number(f.get(name[5:]))]
        added[name] = max(values, default=None)
    return {**row, **added}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
