"""Temperature and displacement of the probes over time (as Figs. 18 and 20 of the paper)."""

from typing import TYPE_CHECKING

import numpy as np

from sparsemor.core.analysis.charts.style import COLUMN, legend_above, new_figure, style_of, tidy
from sparsemor.core.analysis.charts.units import unit
from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.run_result import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def probe_temperature_figure(run: RunResult) -> "Figure | None":
    """All probes that have a temperature, a panel a body; None where there is none."""
    return _figure(run, {name: run.probe(name)[:, -1] for name in run.probes
                         if run.probe_header(name).components[-1] == "temperature"},
                   "temperature", "K")


def probe_displacement_figure(run: RunResult) -> "Figure | None":
    """|u| of all probes on elastic bodies, against the body's frame, a panel a body."""
    shown = {}
    for name in run.probes:
        named = run.probe_header(name).components
        columns = [k for k, component in enumerate(named) if component.startswith("u_")]
        if columns:
            shown[name] = np.asarray(np.linalg.norm(run.probe(name)[:, columns], axis=1))
    return _figure(run, shown, "displacement |u|", "m")


def _figure(
    run: RunResult, shown: dict[str, FloatArray], what: str, si: str
) -> "Figure | None":
    """A panel a body, each with its own scale: a pad gets hotter than its disk."""
    if not shown or len(run.times) < 2:
        return None
    bodies = list(dict.fromkeys(run.probe_header(name).body for name in shown))
    clock = unit(float(run.times[-1]), "s")
    figure = new_figure(COLUMN, 0.4 + 0.17 * -(-len(shown) // 3) + 1.75 * len(bodies))
    panels = figure.subplots(len(bodies), 1, sharex=True, squeeze=False)[:, 0]
    handles = {}
    for body, axes in zip(bodies, panels, strict=True):
        own = {name: v for name, v in shown.items() if run.probe_header(name).body == body}
        # kelvin stay kelvin: nobody reads kilokelvin
        scale = unit(max(float(np.abs(v).max()) for v in own.values()) if si == "m" else 0.0, si)
        for name, values in own.items():
            style = style_of(list(shown).index(name))
            (handles[name],) = axes.plot(
                clock.factor * run.times, scale.factor * values, color=style.colour,
                linestyle=style.dash, linewidth=1.1, label=name)
        tidy(axes, f"time ({clock.name})" if axes is panels[-1] else "", f"{what} ({scale.name})",
             body if len(bodies) > 1 else "")
        axes.ticklabel_format(axis="y", useOffset=False)
        axes.set_xlim(clock.factor * run.times[0], clock.factor * run.times[-1])
    legend_above(figure, [handles[name] for name in shown])
    return figure
