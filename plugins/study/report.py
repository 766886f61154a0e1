"""Report of a study: text table and work-precision chart."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.results.error_norms import LIMIT, measure_names
from sparsemor.core.results.tables import CONSTANT, MARK, marked, text_table
from sparsemor.core.status import Status
from sparsemor.plugins.study.columns import ERROR, SERIES, label
from sparsemor.plugins.study.plan import StudyPlan
from sparsemor.plugins.study.run import StudyOutcome

if TYPE_CHECKING:
    from sparsemor.core.results.error_norms import Errors
    from sparsemor.plugins.charts.work_precision import WorkPoint

SHOWN = 60
"""Maximum number of rows of the text table; the files contain all rows."""
CHART = "work_precision"
_DECIMAL = {"ms_per_step": ".3g", "speed_up": ".3g"}


def in_words(plan: StudyPlan, rows: Sequence[Mapping[str, Any]]) -> str:
    """Text table of the most important columns, and numbers of runs by status."""
    errors = _errors(plan)
    own = plan.study.file.quantities
    names = ["run", *plan.axes, "status", "ms_per_step",
             *(["speed_up"] if plan.study.file.compared else []), *own,
             *(n for n in [*errors][1:] if any(row.get(n) is not None for row in rows))]
    head = [errors.get(n, n).replace("_", " ") for n in names]
    shown = [[_text(n, row, errors.get(n), ".6g" if n in own else "") for n in names]
             for row in rows[:SHOWN]]
    more = [f"and {len(rows) - SHOWN} more"] if len(rows) > SHOWN else []
    return "\n".join([*([text_table([head, *shown])] if shown else []), *more, "",
                      counted(plan, rows), *_reasons(rows)])


def counted(plan: StudyPlan, rows: Sequence[Mapping[str, Any]]) -> str:
    """Numbers of runs by status, such as `24 runs: 20 done (2 with an error above 0.1), 3 diverged,
    1 refused`."""
    by_status = Counter(str(row["status"]) for row in rows)
    above = Counter(str(row["status"]) for row in rows if row.get("above_limit"))
    words = [f"{n} {status}" + (
        f" ({above[status]} with an error above {LIMIT:g}, marked {MARK})" if above[status] else "")
        for status, n in by_status.most_common()]
    missing = len(plan.runs) - len(rows)
    return f"{len(plan.runs)} runs: " + ", ".join(
        words + ([f"{missing} not run yet"] if missing else []))


def work_points(plan: StudyPlan, rows: Sequence[Mapping[str, Any]]) -> "list[WorkPoint]":
    """Points of the work-precision chart; the study's `method` columns distinguish the lines.

    Runs that differ only in the seed are combined into one point with median times and maximum
    errors; those of them that stopped early form a separate point with the status of the first.
    """
    statuses = {s.value for s in Status}
    groups: dict[tuple[str, str, bool], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["ms_per_step"] is not None and row["status"] in statuses:
            method = ", ".join(label(row[n]) for n in plan.lines if row.get(n) is not None)
            budget = label(row.get(plan.study.file.budget))
            key = method or plan.study.name, budget, Status(row["status"]).ok
            groups.setdefault(key, []).append(row)
    errors = _errors(plan)
    return [_point(method, budget, group, errors)
            for (method, budget, _), group in groups.items()]


def _errors(plan: StudyPlan) -> dict[str, str]:
    """Column name -> error measure, for the errors over whole runs."""
    return {f"{ERROR}{m}": m for m in measure_names(plan.fields)}


def _point(
    method: str, budget: str, rows: Sequence[Mapping[str, Any]], measures: Mapping[str, str]
) -> "WorkPoint":
    from sparsemor.plugins.charts.work_precision import WorkPoint

    def middle(name: str) -> float | None:
        values = [row[name] for row in rows if row.get(name) is not None]
        return median(values) if values else None

    errors = {m: max(row[n] for row in rows if row.get(n) is not None)
              for n, m in measures.items() if any(row.get(n) is not None for row in rows)}
    return WorkPoint(method, budget, middle("ms_per_step"), errors,
                     Status(rows[0]["status"]), middle("offline_total_s"))


def draw(done: StudyOutcome) -> list[Path]:
    """Writes the charts work_precision and, if the study requests it, error_over_time as PNG and
    SVG to the study's folder; returns their paths."""
    from sparsemor.plugins.charts import FORMATS, error_over_time_figure
    from sparsemor.plugins.charts.style import saved
    from sparsemor.plugins.charts.work_precision import work_precision_figure

    figures = {CHART: work_precision_figure(
        work_points(done.plan, done.rows), _reference(done.rows), done.plan.fields)}
    if done.plan.study.file.over_time:
        figures[SERIES] = error_over_time_figure(
            *over_time(done.plan, done.rows), done.plan.fields)
    return [path for name, figure in figures.items() if figure is not None
            for path in saved(figure, done.folder, name, FORMATS)]


def over_time(
    plan: StudyPlan, rows: Sequence[Mapping[str, Any]]
) -> "tuple[dict[str, Errors], dict[str, Status]]":
    """Method -> errors over time, and method -> status.

    Of runs that differ only in the seed: the first that stopped early, otherwise the one with the
    largest combined error.
    """
    from sparsemor.core.results.error_norms import Errors

    chosen: dict[str, Mapping[str, Any]] = {}
    for row in rows:
        if not row.get(SERIES):
            continue
        name = ", ".join(label(row[n]) for n in plan.lines if row.get(n) is not None)
        name, kept = name or plan.study.name, chosen.get(name or plan.study.name)
        if kept is None or _rank(row) > _rank(kept):
            chosen[name] = row
    made = {}
    for name, row in chosen.items():
        series = {m: np.array(v) for m, v in row[SERIES].items()}
        times = series.pop("time")
        made[name] = Errors(times, series)
    return made, {name: Status(row["status"]) for name, row in chosen.items()}


def _rank(row: Mapping[str, Any]) -> tuple[bool, float]:
    return row["status"] != Status.DONE.value, float(row["error_combined"] or 0.0)


def _reference(rows: Sequence[Mapping[str, Any]]) -> "WorkPoint | None":
    """Point of the reference in the work-precision chart; None if the runs have several
    references."""
    from sparsemor.plugins.charts.work_precision import WorkPoint

    found = {(row["reference_ms_per_step"], row["reference_status"]) for row in rows
             if row.get("reference_ms_per_step")}
    if len(found) != 1:
        return None
    ms, status = found.pop()
    return WorkPoint("reference", "", ms, {}, Status(status))


def _reasons(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines with each distinct message and the first run that returned it."""
    first: dict[str, Any] = {}
    for row in rows:
        if row["message"]:
            first.setdefault(str(row["message"]), row)
    lines = [f"run {row['run']}: {row['status']}: {text}" if row["status"] not in text
             else f"run {row['run']}: {text}" for text, row in first.items()]
    return lines[:8] + ([f"and {len(lines) - 8} other messages"] if len(lines) > 8 else [])


def _text(name: str, row: Mapping[str, Any], measure: str | None, form: str) -> str:
    """Text of a table cell; measure: error measure of the column, None if it is not an error; form:
    format of a quantity of interest, "" for another column."""
    value = row.get(name)
    if value is None:
        return "-"
    if measure is not None:
        still = measure in str(row.get("constant") or "").split() and value <= 1e-9
        return CONSTANT if still else marked(value, ".2e", LIMIT)
    form = form or _DECIMAL.get(name, "")
    return format(value, form) if form else label(value)

