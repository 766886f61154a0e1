"""Temperature and displacement of the probes over time (as Figs. 18 and 20 of the paper)."""

from typing import TYPE_CHECKING

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.charts.style import COLUMN, legend_above, new_figure, style_of, tidy
from sparsemor.core.charts.units import unit
from sparsemor.core.results import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TALL = 2.3


def probe_temperature_figure(run: RunResult) -> "Figure | None":
    """All probes that have a temperature, in one panel; None where there is none."""
    shown = {name: run.probe(name)[:, -1] for name in run.probes
             if run.probe_columns(name)[-1] == "temperature"}
    return _figure(run, shown, 1.0, "temperature (K)")


def probe_displacement_figure(run: RunResult) -> "Figure | None":
    """|u| of all probes on elastic bodies, against the body's frame, in one panel."""
    shown = {}
    for name in run.probes:
        columns = [k for k, c in enumerate(run.probe_columns(name)) if c.startswith("u_")]
        if columns:
            shown[name] = np.linalg.norm(run.probe(name)[:, columns], axis=1)
    largest = max((float(v.max(initial=0.0)) for v in shown.values()), default=0.0)
    scale = unit(largest, "m")
    return _figure(run, shown, scale.factor, f"displacement |u| ({scale.name})")


def _figure(
    run: RunResult, shown: dict[str, FloatArray], factor: float, label: str
) -> "Figure | None":
    if not shown or len(run.times) < 2:
        return None
    clock = unit(float(run.times[-1]), "s")
    legend = -(-len(shown) // 3)
    figure = new_figure(COLUMN, _TALL + 0.17 * legend)
    axes = figure.subplots()
    for number, (name, values) in enumerate(shown.items()):
        style = style_of(number)
        axes.plot(clock.factor * run.times, factor * values, color=style.colour,
                  linestyle=style.dash, linewidth=1.1, label=name)
    tidy(axes, f"time ({clock.name})", label)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_xlim(clock.factor * run.times[0], clock.factor * run.times[-1])
    legend_above(figure, axes.get_legend_handles_labels()[0])
    return figure
