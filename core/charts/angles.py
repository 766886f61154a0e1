"""Angles of the bodies over time, all runs in one picture (as Fig. 4 of the paper)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.charts.style import (
    COLUMN,
    REFERENCE_COLOUR,
    label_of,
    legend_above,
    new_figure,
    style_of,
    tidy,
)
from sparsemor.core.charts.units import unit
from sparsemor.core.placement import BY_ANGLE
from sparsemor.core.results import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def turning_bodies(run: RunResult) -> list[str]:
    """Owners of rigid blocks that turn by an angle, their last coordinate."""
    return [b.owner for b in run.layout if b.field == "rigid" and b.size in BY_ANGLE]


def angles_figure(
    reference: RunResult, runs: Mapping[str, RunResult], name: str
) -> "Figure | None":
    """One panel a body that turns by an angle, degrees over time; None when nothing turns.

    name: what the reference is called, if there are runs beside it. A cross marks where a run
    stopped early.
    """
    bodies = turning_bodies(reference)
    if not bodies or len(reference.times) < 2:
        return None
    clock = unit(float(reference.times[-1]), "s")
    figure = new_figure(COLUMN, 0.55 + 1.45 * len(bodies))
    panels = figure.subplots(len(bodies), 1, sharex=True, squeeze=False)[:, 0]
    for body, axes in zip(bodies, panels, strict=True):
        last = axes is panels[-1]
        tidy(axes, f"time ({clock.name})" if last else "", "angle (°)", body)
        axes.plot(clock.factor * reference.times, _degrees(reference, body), color=REFERENCE_COLOUR,
                  linewidth=3.2, label=f"{name} (reference)" if runs else name)
        low, high = axes.get_ylim()
        for number, (name, run) in enumerate(runs.items()):
            style = style_of(number)
            axes.plot(clock.factor * run.times, _degrees(run, body), color=style.colour,
                      linestyle=style.dash, linewidth=1.1, label=label_of(name, run.status))
            if not run.status.ok and len(run.times):
                axes.plot(clock.factor * run.times[-1], np.clip(_degrees(run, body)[-1], low, high),
                          marker="x", color=style.colour, markersize=5, clip_on=False)
        reach = 0.15 * (high - low)  # a run that left the reference must not squash the others
        axes.set_ylim(max(axes.get_ylim()[0], low - reach), min(axes.get_ylim()[1], high + reach))
        axes.set_xlim(clock.factor * reference.times[0], clock.factor * reference.times[-1])
    legend_above(figure, panels[0].get_legend_handles_labels()[0])
    return figure


def _degrees(run: RunResult, body: str) -> FloatArray:
    return np.asarray(np.degrees(run.block(f"{body}.rigid")[:, -1]))
