"""Errors of the runs over time, combined and per field (as Figs. 7 and 8 of the paper)."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import FieldKind
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.status import Status
from sparsemor.plugins.charts.style import (
    LIMIT_COLOUR,
    LINE,
    REFERENCE_COLOUR,
    SMALL,
    draw_line,
    handles_of,
    label_of,
    legend_above,
    style_of,
    time_panels,
)
from sparsemor.plugins.comparison.error_norms import Errors, measure_titles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOWEST, _HIGHEST = 1e-16, 1e4  # a diverged run leaves the picture, the others stay legible
_MOST_POINTS = 2000
BAND = 0.1, 2.0
"""Factors of the largest estimated error so far between which the largest error so far is expected
(docs/validation/estimates.md)."""


def error_over_time_figure(
    measured: Mapping[str, Errors], statuses: Mapping[str, Status], kinds: Sequence[FieldKind],
    limit: float = LIMIT, trained_to: float = 0.0,
) -> "Figure | None":
    """Errors over time on a logarithmic axis, one panel per error measure; None if there is no
    error above 0.

    A dotted line of the same colour is the largest error so far that a run estimated for itself, in
    a band of a tenth to twice its size: the largest error so far is found in it. A line marks
    `limit` where an error exceeds it. Fields that are constant in all runs have no panel.
    measured: run -> errors; kinds: kinds of the runs' fields, in the order of the panels;
    trained_to: end of training, s, which is marked, 0 for none.
    """
    titles = {m: title for m, title in measure_titles(kinds).items() if m != "angle_rad"}
    names = [m for m in titles if any(_positive(e, m) for e in measured.values())
             and not all(e.still(m) for e in measured.values())]
    end = max((errors.until for errors in measured.values()), default=0.0)
    if not names or end <= 0.0:
        return None
    entries = len(measured) + sum(bool(errors.estimated) for errors in measured.values())
    figure, panels, clock = time_panels(
        [("relative error", titles[m]) for m in names], end, 1.4, 0.2 + LINE * -(-entries // 2))
    for measure, axes in zip(names, panels, strict=True):
        top, bottom = 0.0, np.inf
        for number, (run, errors) in enumerate(measured.items()):
            if measure in errors.series:
                every = max(1, len(errors.times) // _MOST_POINTS)
                line = errors.series[measure][::every]
                shown = np.where(line > 0.0, line, np.nan)  # a log axis has no place for 0
                draw_line(axes, clock.factor * errors.times[::every], shown, number,
                          label_of(run, statuses[run]))
                if measure in errors.estimated:
                    colour = style_of(number).colour
                    guess, at = estimates(errors.times, errors.estimated[measure])
                    axes.plot(clock.factor * at, guess, color=colour, linestyle=":", linewidth=1.4,
                              label=f"{run}, estimated")
                    least, most = BAND
                    axes.fill_between(clock.factor * at, least * guess, most * guess, color=colour,
                                      alpha=0.15, linewidth=0.0)
                if (line > 0.0).any():
                    top = max(top, float(line.max()))
                    bottom = min(bottom, float(np.quantile(line[line > 0.0], 0.02)))
        late = trained_to > 0.5 * end  # texts stand on opposite sides
        if top > limit:
            axes.axhline(limit, color=LIMIT_COLOUR, linewidth=0.8, linestyle=":", zorder=0)
            axes.text(0.01 if late else 0.99, limit, f"limit {limit:g}", fontsize=SMALL,
                      color=LIMIT_COLOUR, ha="left" if late else "right", va="bottom",
                      transform=axes.get_yaxis_transform())
        if trained_to > 0.0:
            axes.axvline(clock.factor * trained_to, color=REFERENCE_COLOUR, linewidth=0.8, zorder=0)
            axes.text(clock.factor * trained_to, 0.98, " end of training ", fontsize=SMALL,
                      va="top", ha="right" if late else "left", color="#606060",
                      transform=axes.get_xaxis_transform())
        axes.set_yscale("log")
        axes.yaxis.set_minor_formatter("")  # within one decade they would run into each other
        upper = 3.0 * min(top, _HIGHEST)
        axes.set_ylim(min(max(bottom / 3.0, _LOWEST), 0.1 * upper), upper)
        axes.set_xlim(0.0, clock.factor * end)
    labels = dict.fromkeys(text for axes in panels
                           for text in axes.get_legend_handles_labels()[1])
    legend_above(figure, handles_of(panels, labels), columns=2)
    return figure


def estimates(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The largest estimate up to each of those among stored `values` (j,), between which the last
    one counts, and to the last stored time, with their times; not a number where they are 0."""
    at = np.append(np.flatnonzero(np.diff(values)) + 1, len(values) - 1)
    at, values = at[:: max(1, len(at) // _MOST_POINTS)], np.maximum.accumulate(values)
    return np.where(values[at] > 0.0, values[at], np.nan), times[at]


def _positive(errors: Errors, measure: str) -> bool:
    return measure in errors.series and bool((errors.series[measure] > 0.0).any())
