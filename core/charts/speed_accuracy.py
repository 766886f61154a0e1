"""What a run costs against what it gets wrong, one point a run."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.charts.error_over_time import PANELS
from sparsemor.core.charts.labels import place_labels
from sparsemor.core.charts.style import (
    COLUMN,
    REFERENCE_COLOUR,
    SMALL,
    label_of,
    new_figure,
    style_of,
    tidy,
)
from sparsemor.core.error_measures import Errors
from sparsemor.core.run_facts import RunFacts

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def speed_accuracy_figure(
    measured: Mapping[str, Errors], facts: Mapping[str, RunFacts], reference: str
) -> "Figure | None":
    """One panel a measure: largest error against ms a step, both logarithmic.

    Runs that did not reach the end stand at the upper edge, hollow, and are named so. The
    reference's time is a vertical line. None when no run has a time and an error.
    """
    timed = [run for run in measured if facts[run].ms_per_step]
    names = [m for m in PANELS if any(measured[r].worst.get(m, 0.0) > 0.0 for r in timed)]
    if not names:
        return None
    rows = -(-len(names) // 2)
    columns = 2 if len(names) > 1 else 1
    figure = new_figure(COLUMN * columns, 0.2 + 2.3 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(names):]:
        axes.set_visible(False)
    jobs = []
    for measure, axes in zip(names, panels, strict=False):
        axes.set_xscale("log")
        axes.set_yscale("log")
        tidy(axes, "computing time (ms/step)", "largest relative error", PANELS[measure])
        texts = _points(axes, measure, timed, measured, facts)
        base = facts[reference].ms_per_step if reference in facts else None
        if base:
            axes.axvline(base, color=REFERENCE_COLOUR, linewidth=1.2, zorder=0)
        _frame(axes, [facts[r].ms_per_step or 1.0 for r in timed], base)
        if base:
            axes.text(base, 0.02, f"{reference} ", rotation=90, ha="right", va="bottom",
                      color="#606060", fontsize=SMALL, transform=axes.get_xaxis_transform())
        jobs.append((axes, texts))
    figure.draw_without_rendering()  # the layout must stand before labels are placed
    for axes, texts in jobs:
        place_labels(axes, texts)
    return figure


def _points(
    axes: Any, measure: str, timed: list[str], measured: Mapping[str, Errors],
    facts: Mapping[str, RunFacts],
) -> list[tuple[float, float, str, str]]:
    ended = [measured[r].worst.get(measure, 0.0) for r in timed if facts[r].status.ok]
    known = [e for e in ended if e > 0.0] or [1e-3]
    low, high = min(known), max(known)
    edge = max(high * 30.0, 1.0)
    texts = []
    for number, run in enumerate(measured):
        ms, error = facts[run].ms_per_step, measured[run].worst.get(measure)
        if not ms or error is None:
            continue
        style, ok = style_of(number), facts[run].status.ok
        y = max(error, low / 10.0) if ok else edge
        axes.plot(ms, y, linestyle="none", marker=style.marker, markersize=5.5,
                  color=style.colour, markerfacecolor=style.colour if ok else "white",
                  clip_on=False)
        texts.append((ms, y, label_of(run, facts[run].status), style.colour))
    stopped = any(not facts[r].status.ok for r in timed)
    bottom, top = np.floor(np.log10(low / 2.0)), np.ceil(np.log10(high * 2.0))
    axes.set_ylim(10.0**bottom, edge if stopped else 10.0**top)  # decades: two ticks at least
    return texts


def _frame(axes: Any, times: list[float], base: float | None) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    all_times = [*times, base] if base else times
    low, high = np.log10(min(all_times)), np.log10(max(all_times))
    margin = 0.18 * max(high - low, 0.5)
    axes.set_xlim(10.0 ** (low - margin), 10.0 ** (high + margin))
    span = high - low
    subs = (1.0, 2.0, 3.0, 5.0, 7.0) if span < 0.9 else (1.0, 2.0, 5.0) if span < 2.5 else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_minor_locator(NullLocator())
