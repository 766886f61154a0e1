"""Report of a study: text table and work-precision chart."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.scene.html import html_text
from sparsemor.core.status import Status
from sparsemor.plugins.comparison.error_norms import measure_names
from sparsemor.plugins.publishing.tables import CONSTANT, MARK, marked, text_table
from sparsemor.plugins.study.axes import LABEL
from sparsemor.plugins.study.plan import Drawing, StudyPlan
from sparsemor.plugins.study.table_columns import ERROR, LATE, OF_CHARTS, SERIES, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.plugins.charts.work_precision import WorkPoint
    from sparsemor.plugins.comparison.error_norms import Errors

SHOWN = 60
"""Maximum number of rows of the text table; the files contain all rows."""
NAMED = 6
"""Maximum number of runs without a step that are named below the chart."""
CHART = "work_precision"
_DECIMAL = {"ms_per_step": ".3g", "speed_up": ".3g"}


def in_words(plan: StudyPlan, rows: Sequence[Mapping[str, Any]]) -> str:
    """Text table of the most important columns, and numbers of runs by status."""
    errors = _errors(plan.drawing)  # column -> error measure
    own = plan.study.file.quantities
    axes = [n for n in plan.axes if LABEL not in plan.axes or not any(
        isinstance(row.get(n), dict) for row in rows)]  # mappings are named by the label
    # the column along the lines of the chart, where it is a count of atoms or rows, not an axis
    counts = [n for n in (plan.study.file.budget,) if n in OF_CHARTS]
    names = ["run", *axes, *counts, "status", "ms_per_step",
             *(["speed_up"] if plan.study.file.compared else []), *own,
             # the first one, of all unknowns together, is in the files alone
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
    above = Counter(str(row["status"]) for row in rows if _above(plan.drawing, row))
    words = [f"{n} {status}" + (
        f" ({above[status]} with an error above {LIMIT:g}, marked {MARK})" if above[status] else "")
        for status, n in by_status.most_common()]
    missing = len(plan.runs) - len(rows)
    return f"{len(plan.runs)} runs: " + ", ".join(
        words + ([f"{missing} not run yet"] if missing else []))


def _above(drawing: Drawing, row: Mapping[str, Any]) -> bool:
    """True if an error of a run that is shown is above the limit."""
    constant = str(row.get("constant") or "").split()
    return any((row.get(n) or 0.0) > LIMIT for n, m in _errors(drawing).items()
               if m not in constant) if drawing.errors_from > 0.0 else bool(row.get("above_limit"))


def work_points(drawing: Drawing, rows: Sequence[Mapping[str, Any]]) -> "list[WorkPoint]":
    """Points of the work-precision chart; the study's `method` columns distinguish the lines.

    Runs that differ only in the seed are combined into one point with median times and maximum
    errors; those of them that stopped early form a separate point with the status of the first.
    """
    statuses = {s.value for s in Status}
    groups: dict[tuple[str, str, bool], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["ms_per_step"] is not None and row["status"] in statuses:
            key = (_method(drawing, row), label(row.get(drawing.budget)),
                   Status(row["status"]).ok)
            groups.setdefault(key, []).append(row)
    return [_point(method, budget, group, drawing)
            for (method, budget, _), group in groups.items()]


def _method(drawing: Drawing, row: Mapping[str, Any]) -> str:
    """Name of the line of a run."""
    return ", ".join(label(row[n]) for n in drawing.lines
                     if row.get(n) is not None) or drawing.name


def _errors(drawing: Drawing) -> dict[str, str]:
    """Column name -> error measure, for the errors from `errors_from` on, or over whole runs."""
    prefix = LATE if drawing.errors_from > 0.0 else ERROR
    return {f"{prefix}{m}": m for m in measure_names(drawing.fields)}


def _step(row: Mapping[str, Any]) -> float | None:
    """Time step of a run, s, if it is an axis of the study."""
    return row.get("time.step") or row.get("set.time.step")


def _point(
    method: str, budget: str, rows: Sequence[Mapping[str, Any]], drawing: Drawing
) -> "WorkPoint":
    """Point of the work-precision chart: medians of the time over seeds, largest errors. Times are
    ms per step or, where the time step is an axis of the study, s per simulated second."""
    from sparsemor.plugins.charts.work_precision import WorkPoint

    def middle(name: str) -> float | None:
        values = [row[name] for row in rows if row.get(name) is not None]
        return median(values) if values else None

    errors = {m: max(row[n] for row in rows if row.get(n) is not None)
              for n, m in _errors(drawing).items() if any(row.get(n) is not None for row in rows)}
    ms, step = middle("ms_per_step"), _step(rows[0])
    return WorkPoint(method, budget, ms if ms is None or step is None else 1e-3 * ms / step, errors,
                     Status(rows[0]["status"]), middle("offline_total_s"),
                     all(row.get("stable") is not False for row in rows))


class StudyTable(list[dict[str, Any]]):
    """Table of a study, a row for each run, with its charts; notebooks show its main columns."""

    def __init__(self, plan: StudyPlan, rows: Sequence[Mapping[str, Any]]) -> None:
        super().__init__(map(dict, rows))
        self.plan = plan

    def __reduce__(self) -> tuple[Any, ...]:
        return list, (list(self),)  # pickled as a plain list, without the plan

    def __str__(self) -> str:
        return in_words(self.plan, self)

    def _repr_html_(self) -> str:
        return html_text(str(self))

    def plot(self, chart: str = CHART) -> "Figure":
        """Chart of the study, work_precision or, if it asks for it, error_over_time. InputError for
        another one, and without data."""
        from sparsemor.plugins.charts import drawn

        return drawn(figures_of(self.plan.drawing, self), chart)


def draw(drawing: Drawing, rows: Sequence[Mapping[str, Any]], folder: Path) -> list[Path]:
    """Writes the charts work_precision and, if the study requests it, error_over_time as PNG and
    SVG to the study's folder; returns their paths."""
    from sparsemor.plugins.charts import FORMATS
    from sparsemor.plugins.charts.style import saved

    return [path for name, make in figures_of(drawing, rows).items() if (figure := make())
            for path in saved(figure, folder, name, FORMATS)]


def figures_of(
    drawing: Drawing, rows: Sequence[Mapping[str, Any]]
) -> "dict[str, Callable[[], Figure | None]]":
    """Name of a chart -> function that draws it, None without data."""
    from sparsemor.plugins.charts import error_over_time_figure, work_precision_figure

    by_step = any(_step(row) is not None for row in rows)  # the time step is an axis
    found: dict[str, Callable[[], Figure | None]] = {CHART: lambda: work_precision_figure(
        work_points(drawing, rows), _reference(drawing, rows, by_step), drawing.fields,
        notes=chart_notes(drawing, rows), unit="s per simulated s" if by_step else "ms/step")}
    if drawing.over_time:
        found[SERIES] = lambda: error_over_time_figure(
            *over_time(drawing, rows), drawing.fields, trained_to=drawing.trained_to)
    return found


def chart_notes(drawing: Drawing, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines below the work-precision chart: time span of the errors, and runs that are no
    points."""
    start, end = drawing.errors_from, drawing.trained_to
    trained = f", the end of training at {end:.4g} s" if end > 0.0 else ""
    found = []
    if start > 0.0:
        found.append(f"errors after {start:.4g} s" + (
            ", the end of training" if abs(start - end) <= 1e-9 * start else trained))
    elif end > 0.0 or drawing.elsewhere:
        found.append("errors over the whole run" + (
            "; training had other loads" if drawing.elsewhere else trained))
    missing: dict[str, list[str]] = {}  # status -> names of runs that took no step
    for row in rows:
        if row["ms_per_step"] is None:
            missing.setdefault(str(row["status"]), []).append(
                f"{_method(drawing, row)} {label(row.get(drawing.budget))}".strip())
    for status, names in missing.items():
        named = list(dict.fromkeys(names))
        more = f", and {len(named) - NAMED} more" if len(named) > NAMED else ""
        found.append(f"without a step ({status}): {', '.join(named[:NAMED])}{more}")
    return found


def over_time(
    drawing: Drawing, rows: Sequence[Mapping[str, Any]]
) -> "tuple[dict[str, Errors], dict[str, Status]]":
    """Method -> errors over time, and method -> status.

    Of runs that differ only in the seed: the first that stopped early, otherwise the one with the
    largest combined error.
    """
    from sparsemor.plugins.comparison.error_norms import Errors

    chosen: dict[str, Mapping[str, Any]] = {}
    for row in rows:
        if not row.get(SERIES):
            continue
        name = _method(drawing, row)
        kept = chosen.get(name)
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


def _reference(
    drawing: Drawing, rows: Sequence[Mapping[str, Any]], by_step: bool
) -> "WorkPoint | None":
    """Point of the reference in the work-precision chart; None if the runs have several
    references. by_step: computing times are those of a simulated second."""
    from sparsemor.plugins.charts.work_precision import WorkPoint

    found = {(row["reference_ms_per_step"], row["reference_status"]) for row in rows
             if row.get("reference_ms_per_step")}
    if len(found) != 1:
        return None
    ms, status = found.pop()
    if by_step:
        if drawing.reference_step <= 0.0:
            return None
        ms *= 1e-3 / drawing.reference_step
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

