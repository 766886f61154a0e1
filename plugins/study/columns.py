"""Columns of a study's table, and the columns that may differ between two executions."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from sparsemor.core.protocols.layout import FieldKind
from sparsemor.core.results.error_norms import measure_names

OUTCOME = ("reducer", "status", "message", "reference_status", "above_limit")
ERROR = "error_"
"""Prefix of the columns of maximum errors over the run."""
LATE = "late_"
"""Prefix of the columns of maximum errors from `errors_from` on."""
SERIES = "error_over_time"
"""Column of errors over time, reduced to the maxima in intervals of growing length."""
COUNTS = ("steps", "t_end", "iterations", "atoms_all", "atoms_active", "rows_sampled",
          "factorizations", "support_changes", "elements_touched", "stable", "notes", "facts",
          "constant")
OF_CHARTS = ("atoms_all", "atoms_active", "rows_sampled")
"""Counts that may vary along a line of the chart."""
TIMES = ("ms_per_step", "reference_ms_per_step", "speed_up", "offline_s", "offline_total_s",
         "offline_cache", "online_s", "pays_after", "ms_per_step_solver", "repeats", "workers")
"""Columns of computing times and of the machine: the only ones that may differ between two
executions of a study."""

OF_REFERENCE = frozenset({"reference_status", "above_limit", "constant", "reference_ms_per_step",
                          "speed_up", "pays_after"})
"""Columns that runs without a reference do not have."""
RESULT = "result"
"""Column of the folder with a run's result."""

RESERVED = frozenset({"run", *OUTCOME[1:], SERIES, RESULT, *COUNTS, *TIMES})
"""Reserved column names, which no axis may have, nor the name of an error column. An axis may be
named `reducer` or `seed`; it then replaces that column."""


def error_columns(fields: Iterable[FieldKind], late: bool = True) -> tuple[str, ...]:
    """Names of the error columns of these fields: maximum over the run, from a given time on (with
    `late`), during the first 2 % of the time span, and after it."""
    prefixes = (ERROR, *((LATE,) if late else ()), "start_up_", "steady_")
    measures = measure_names(fields)
    return tuple(f"{prefix}{m}" for prefix in prefixes for m in measures)


def columns_of(
    settings: Sequence[str], fields: Iterable[FieldKind], late: bool, over_time: bool = False,
    quantities: Iterable[str] = (), compared: bool = True, keep: bool = False,
) -> list[str]:
    """Names of all columns in the order of the table; settings: columns of the changed options;
    compared: False for runs without references."""
    first = ["run", *settings]
    own = [*OUTCOME, *((RESULT,) if keep else ()), "seed", *quantities,
           *(error_columns(fields, late) if compared else ()),
           *((SERIES,) if over_time and compared else ()), *COUNTS, *TIMES]
    return [*first, *(name for name in own if name not in first and (
        compared or name not in OF_REFERENCE))]


def label(value: object) -> str:
    """Text of a value in a chart: numbers with up to six digits."""
    number = isinstance(value, float) and not isinstance(value, bool)
    return format(value, ".6g") if number else cell(value)


def cell(value: object) -> str:
    """CSV text of a value: empty for None, JSON for values other than numbers and text."""
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def fact_columns(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Column names `fact.NAME` of all numbers that the step solvers report per block."""
    names = {name for row in rows for facts in (row.get("facts") or {}).values()
             for name, value in facts.items() if _is_number(value)}
    return [f"fact.{name}" for name in sorted(names)]


def with_facts(row: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Row with an additional column for each `fact.NAME`: the maximum over the blocks."""
    blocks = (row.get("facts") or {}).values()
    added: dict[str, Any] = {}
    for name in names:
        values = [f[name[5:]] for f in blocks if _is_number(f.get(name[5:]))]
        added[name] = max(values, default=None)
    return {**row, **added}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
