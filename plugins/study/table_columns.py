"""Columns of a study's table: their names, those that may differ between two executions, and their
values for one run: errors, cost and counts."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import FieldKind
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.comparison.cost import RunFacts, pays_after, run_facts
from sparsemor.plugins.comparison.error_norms import Errors, measure_errors, measure_names
from sparsemor.plugins.study.quantities import QuantityOfInterest

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

SPANS = 120
"""Number of intervals of the errors over time."""
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
    late: with errors from a given time on; over_time: with errors over time; compared: False for
    runs without references; keep: with the folder of each result."""
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


NONE: Mapping[str, QuantityOfInterest] = {}


def measured(
    run: RunResult, reference: RunResult | None, errors_from: float, failure: str,
    quantities: Mapping[str, QuantityOfInterest] = NONE, prepared: float | None = None,
) -> dict[str, Any]:
    """Columns of the table for `run`, compared with `reference` unless that is None.

    errors_from: time from which late errors are evaluated, s; failure: reason why the run stopped
    early, "" if it did not; quantities: column -> quantity of interest; prepared: time of the
    preparation of a model that it shares, s, None if it has its own.
    """
    facts, summary = run_facts(run), run.summary
    if prepared is not None:
        facts = replace(facts, offline_whole_seconds=prepared)
    numbers, texts = _numbers(run, quantities)
    found = {} if reference is None else _compared(run, reference, errors_from)
    return {
        "status": facts.status.value,
        **found,
        "message": "; ".join(text for text in (failure, found.get("message"), *texts) if text),
        **numbers,
        "steps": facts.steps,
        "t_end": summary.get("t_end"),
        "iterations": facts.iterations,
        "atoms_all": facts.atoms,
        "atoms_active": facts.active_atoms,
        "rows_sampled": facts.rows,
        "factorizations": summary.get("factorizations"),
        "support_changes": summary.get("support_changes"),
        "elements_touched": sum(summary.get("elements_touched", {}).values()),
        "stable": summary.get("stability", {}).get("stable"),
        "notes": "; ".join(summary.get("notes", ())),
        "facts": summary.get("facts", {}),
        **_cost(run, facts, None if reference is None else run_facts(reference)),
        **({} if prepared is None else {"offline_cache": "shared model"}),
    }


def _numbers(
    run: RunResult, quantities: Mapping[str, QuantityOfInterest]
) -> tuple[dict[str, float | None], list[str]]:
    """Values of the quantities of interest, None where the run has none, and the reasons."""
    found: dict[str, float | None] = {}
    missing = []
    for name, quantity in quantities.items():
        try:
            found[name] = quantity.of(run)
        except InputError as error:
            found[name] = None
            missing.append(f"{name}: {error}")
    return found, missing


def _compared(run: RunResult, reference: RunResult, errors_from: float) -> dict[str, Any]:
    """Columns of a run that compare it with its reference. above_limit, constant: names of errors
    above the limit, and of those of fields that do not change in the reference."""
    errors, note, series = _errors(reference, run, errors_from)
    measures = measure_names(reference.layout.kinds)
    constant = [] if series is None else [m for m in measures if m in series.constant]
    return {
        "message": note,
        "reference_status": reference.status.value,
        "above_limit": "" if series is None else " ".join(series.above()),
        **errors,
        SERIES: None if series is None else thinned(series, measures),
        "constant": " ".join(constant),
    }


def _errors(
    reference: RunResult, run: RunResult, errors_from: float
) -> tuple[dict[str, float | None], str, Errors | None]:
    """Errors of a run by column, the reason why there are none, and the norms themselves."""
    try:
        errors = measure_errors(reference, run, errors_from)
    except InputError as error:
        return {}, f"not measured: {error}", None
    if errors.until <= float(reference.times[0]):
        return {}, "", None  # it stopped in its first step: at the start all runs are right
    measures = measure_names(reference.layout.kinds)
    found = {f"error_{m}": errors.worst.get(m) for m in measures}
    if errors_from > 0.0:
        found |= {f"late_{m}": errors.worst_late.get(m) for m in measures}
    for when, worst in (("start_up", errors.start_up), ("steady", errors.steady)):
        found |= {f"{when}_{m}": worst.get(m) for m in measures}
    return found, "", errors


def thinned(errors: Errors, measures: Iterable[str]) -> dict[str, list[float]]:
    """Errors over time reduced to at most 120 points: the maximum in each of intervals of growing
    length, which start as single steps. `time` (s): end of each interval."""
    count = len(errors.times)
    ends = np.unique(np.geomspace(1, max(count - 1, 1), SPANS).round().astype(np.int64))
    ends = ends[ends < count]
    found = {"time": errors.times[ends]}
    for m in measures:
        if m in errors.series:
            spans = np.maximum.reduceat(errors.series[m], np.append(1, ends[:-1] + 1))
            found[m] = spans
    return {name: [float(f"{v:.4g}") for v in values] for name, values in found.items()}


def _cost(run: RunResult, facts: RunFacts, base: RunFacts | None) -> dict[str, Any]:
    """Cost columns of a run with the counts and times `facts`; base: those of its reference, None
    if it has none. offline_s: offline time of this run; offline_total_s: with an empty cache;
    pays_after: number of online runs after which the latter is recovered."""
    ms, used = facts.ms_per_step, run.summary.get("cache", {})
    base_ms = None if base is None else base.ms_per_step
    return {
        "ms_per_step": ms,
        "reference_ms_per_step": base_ms,
        "speed_up": base_ms / ms if ms and base_ms else None,
        "offline_s": facts.offline_seconds,
        "offline_total_s": facts.offline_whole_seconds,
        "offline_cache": ", ".join(f"{k} {how}" for k, how in used.items()),
        "online_s": facts.online_seconds,
        "pays_after": None if base is None else pays_after(base, facts),
        "ms_per_step_solver": facts.ms_per_step_solver,
    }

