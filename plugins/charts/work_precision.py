"""Work-precision chart: error against time per step, one line for each method."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.protocols.layout import FieldKind, Quantity
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.status import Status
from sparsemor.plugins.charts.style import (
    COLUMN,
    LIMIT_COLOUR,
    LINE,
    NORMAL,
    REFERENCE_COLOUR,
    SMALL,
    LineStyle,
    legend_above,
    new_figure,
    plain,
    style_of,
    tidy,
)
from sparsemor.plugins.comparison.error_norms import measure_titles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMED = 6
"""Maximum number of runs that stopped early and are named below the chart."""


@dataclass(frozen=True, slots=True, eq=False)
class WorkPoint:
    """One run in the work-precision chart.

    method: name of the line; budget: value that varies along the line ("30/20 atoms"), or "";
    ms_per_step: computing time, None if no step was taken; errors: measure (`angle_rad`, a field,
    `combined`) -> maximum over time; offline_seconds: time before the first step, s; stable: False
    if the stability check predicts that errors grow.
    """

    method: str
    budget: str
    ms_per_step: float | None
    errors: Mapping[str, float]
    status: Status
    offline_seconds: float | None = None
    stable: bool = True

    @property
    def name(self) -> str:
        return f"{self.method} {self.budget}".strip()


def work_precision_figure(
    points: Sequence[WorkPoint], reference: WorkPoint | None, kinds: Sequence[FieldKind],
    limit: float = LIMIT, notes: Sequence[str] = (), unit: str = "ms/step",
) -> "Figure | None":
    """Work-precision chart: error against computing time, both logarithmic, one panel per error
    measure; None if no run has both a time and an error.

    The upper axis shows the speed-up over the reference, whose time is a vertical line; the legend
    the offline time of each method. Points of a method are joined in the order of the numbers in
    their budgets, of which the first and the last stand next to their points; budgets that are no
    numbers are not joined. Runs that stopped early are hollow points at the upper edge, named below
    the chart; a cross marks errors above `limit`, a ring runs that are predicted to be unstable.
    kinds: kinds of the runs' fields; rigid coordinates have a panel of their own only if there is
    no error of angles. notes: further lines below the chart; unit: of the computing time.
    """
    points = [_drawn(p) for p in points]
    reference = None if reference is None else _drawn(reference)
    timed = [p for p in points if p.ms_per_step]
    titles = measure_titles(kinds)
    first, last = ({n: titles.pop(n)} for n in ("angle_rad", "combined"))
    titles = first | titles | last
    measures = [m for m in titles if any(p.errors.get(m, 0.0) > 0.0 for p in timed)]
    if "angle_rad" in measures:
        poses = {k.name for k in kinds if k.quantity is Quantity.POSE}
        measures = [m for m in measures if m not in poses]
    if not measures:
        return None
    methods = list(dict.fromkeys(p.method for p in points))
    stopped = [p for p in points if not p.status.ok]
    handles = _handles(methods, points)
    longest = max(len(h.get_label()) for h in handles)
    columns = 2 if len(measures) > 1 else 1
    rows, across = -(-len(measures) // columns), max(1, min(4, 2 * columns, 62 * columns // (
        longest + 12)))
    below = [_stopped_note(stopped, columns)] if stopped else []
    if any(e > limit for p in timed for m, e in p.errors.items() if m in measures and p.status.ok):
        below.append(f"crossed out: error above {limit:g}")
    if any(not p.stable for p in timed):
        below.append("ringed: beyond the stability limit, errors are predicted to grow")
    below += [fill(plain(note), 62 * columns) for note in notes]
    lines = -(-len(methods) // across) + sum(text.count("\n") + 1 for text in below)
    figure = new_figure(1.1 * COLUMN * columns, 0.1 + LINE * lines + 2.75 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(measures):]:
        axes.set_visible(False)
    for measure, axes in zip(measures, panels, strict=False):
        radians = " (rad)" if measure == "angle_rad" else ""
        relative = "" if radians else "relative "
        tidy(axes, f"computing time ({unit})", f"largest {relative}error{radians}")
        _time_axis(axes, timed, reference)
        axes.set_title(titles[measure], fontsize=NORMAL, loc="left", fontweight="bold")
        shown = [p for p in timed if measure in p.errors or not p.status.ok]
        _lines(axes, measure, shown, methods, limit)
    legend_above(figure, handles, columns=across)
    if below:
        figure.supxlabel("\n".join(below), fontsize=SMALL, x=0.01, ha="left")
    return figure


def _drawn(point: WorkPoint) -> WorkPoint:
    return replace(point, method=plain(point.method), budget=plain(point.budget))


def _lines(
    axes: Any, measure: str, points: Sequence[WorkPoint], methods: Sequence[str], limit: float
) -> None:
    """Draws points and lines of one panel, with the first and the last budget of each line, and
    those of runs that stopped early, next to their points."""
    from matplotlib.ticker import LogLocator, NullLocator

    bottom, top = _limits(measure, points)
    axes.set_yscale("log")
    axes.set_ylim(bottom, top)
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_minor_locator(NullLocator())
    for number, method in enumerate(methods):
        style = style_of(number)
        own = sorted((p for p in points if p.method == method), key=_budget_order)
        ended = [p for p in own if p.status.ok]
        # an error of 0 has no place on a logarithmic axis: it stands at the lower edge
        placed = [(p, max(p.errors.get(measure, 0.0), bottom)) for p in ended]
        placed += [(p, top) for p in own if not p.status.ok]
        joined = all(_numbers(p.budget) for p in ended)
        axes.plot([p.ms_per_step for p in ended], [y for _, y in placed[:len(ended)]],
                  color=style.colour, linestyle=style.dash if joined else "none", linewidth=1.1)
        for p, y in placed:
            _marker(axes, p.ms_per_step, y, style, p.status.ok)
            if p.status.ok and p.errors.get(measure, 0.0) > limit:
                axes.plot([p.ms_per_step], [y], linestyle="none", marker="x", markersize=6,
                          color=LIMIT_COLOUR, clip_on=False, zorder=4)
            if not p.stable:
                axes.plot([p.ms_per_step], [y], linestyle="none", marker="o", markersize=10,
                          color=LIMIT_COLOUR, markerfacecolor="none", clip_on=False, zorder=4)
            if p.budget and (not p.status.ok or p is ended[0] or p is ended[-1]):
                axes.annotate(
                    p.budget, (p.ms_per_step, y), (5, 4), textcoords="offset points",
                    fontsize=SMALL, color=style.colour, annotation_clip=False)


def _marker(axes: Any, x: float | None, y: float, style: LineStyle, ok: bool) -> None:
    axes.plot([x], [y], linestyle="none", marker=style.marker, markersize=5.5, color=style.colour,
              markerfacecolor=style.colour if ok else "white", clip_on=False, zorder=3)


def _limits(measure: str, points: Sequence[WorkPoint]) -> tuple[float, float]:
    """Vertical limits of one panel, errors at whole decades; runs that stopped early stand at the
    upper one."""
    errors = [p.errors.get(measure, 0.0) for p in points if p.status.ok]
    positive = [e for e in errors if e > 0.0] or [1e-3]
    bottom = 10.0 ** np.floor(np.log10(min(positive) / 2.0))
    top = max(10.0 ** np.ceil(np.log10(max(positive) * 2.0)), 10.0 * bottom)
    if any(not p.status.ok for p in points):
        top *= 100.0
    return float(bottom), float(top)


def _budget_order(p: WorkPoint) -> tuple[list[float], float]:
    return _numbers(p.budget), p.ms_per_step or 0.0


def _numbers(budget: str) -> list[float]:
    return [float(n) for n in re.findall(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?", budget)]


def _time_axis(
    axes: Any, points: Sequence[WorkPoint], reference: WorkPoint | None
) -> None:
    """Logarithmic axis of the computing time and, where the reference has a time, an upper axis for
    the speed-up and a vertical line at the reference."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set_xscale("log")
    base = reference.ms_per_step if reference is not None else None
    times = [p.ms_per_step for p in points if p.ms_per_step] + ([base] if base else [])
    low, high = np.log10(min(times)), np.log10(max(times))
    margin = 0.12 * max(high - low, 0.5)
    axes.set_xlim(10.0 ** (low - margin), 10.0 ** (high + margin))
    span = high - low + 2 * margin
    subs = (1.0, 2.0, 3.0, 5.0, 7.0) if span < 0.9 else (1.0, 2.0, 5.0) if span < 2.6 else (1.0,)
    scales = [axes.xaxis]
    if base and reference is not None:
        axes.axvline(base, color=REFERENCE_COLOUR, linewidth=1.2, zorder=0)
        axes.text(base, 0.02, f"{reference.method} ", rotation=90, ha="right", va="bottom",
                  color="#606060", fontsize=SMALL, transform=axes.get_xaxis_transform())
        above = axes.secondary_xaxis("top", functions=(_ratio_to(base), _ratio_to(base)))
        above.set_xlabel(f"speed-up over {reference.method}", fontsize=SMALL)
        above.tick_params(labelsize=SMALL, width=0.6, length=3)
        above.spines["top"].set_linewidth(0.6)
        scales.append(above.xaxis)
    for scale in scales:
        scale.set_major_locator(LogLocator(subs=subs, numticks=12))
        scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        scale.set_minor_locator(NullLocator())


def _ratio_to(base: float) -> Any:
    # matplotlib also asks for 0 and below, while it lays out the axis
    return lambda value: base / np.maximum(value, 1e-300)


def _handles(methods: Sequence[str], points: Sequence[WorkPoint]) -> list[Any]:
    """Entries of the legend, one for each method; hollow markers where no run reached its end."""
    from matplotlib.lines import Line2D

    handles = []
    for number, method in enumerate(methods):
        style = style_of(number)
        own = [p for p in points if p.method == method]
        ok = any(p.status.ok for p in own)
        handles.append(Line2D([], [], color=style.colour, linestyle=style.dash, linewidth=1.1,
                              marker=style.marker, markersize=5.0, label=method + _offline(own),
                              markerfacecolor=style.colour if ok else "white"))
    return handles


def _offline(points: Sequence[WorkPoint]) -> str:
    """Offline time of the runs of a method, least to most, for the legend."""
    found = sorted({f"{p.offline_seconds:.2g}": p.offline_seconds for p in points
                    if p.offline_seconds}.items(), key=lambda item: item[1])
    ends = dict.fromkeys([found[0][0], found[-1][0]]) if found else ()
    return f", offline {' to '.join(ends)} s" if found else ""


def _stopped_note(stopped: Sequence[WorkPoint], columns: int) -> str:
    named = [f"{p.name} ({p.status.value.replace('_', ' ')})" for p in stopped[:_NAMED]]
    more = f", and {len(stopped) - _NAMED} more" if len(stopped) > _NAMED else ""
    return fill(f"hollow, stopped early: {', '.join(named)}{more}", 62 * columns)


__all__ = ["WorkPoint", "work_precision_figure"]
