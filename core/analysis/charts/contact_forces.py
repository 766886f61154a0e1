"""Normal force and friction of each contact over time (as Fig. 10 of the paper)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from sparsemor.core.analysis.charts.style import COLUMN, legend_above, new_figure, style_of, tidy
from sparsemor.core.analysis.charts.units import unit
from sparsemor.core.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORCES = {"normal": "normal force", "friction": "friction"}


def contact_forces_figure(
    contacts: Mapping[str, Mapping[str, FloatArray]],
) -> "Figure | None":
    """One panel a contact; None when there is no contact or no step. contacts: as
    `RunResult.contacts` gives them.

    The start, at which nothing may press yet, is not drawn.
    """
    end = max((float(h["time"][-1]) for h in contacts.values() if len(h["time"]) > 1), default=0.0)
    if end <= 0.0:
        return None
    clock = unit(end, "s")
    figure = new_figure(COLUMN, 0.55 + 1.75 * len(contacts))
    panels = figure.subplots(len(contacts), 1, sharex=True, squeeze=False)[:, 0]
    for (name, histories), axes in zip(contacts.items(), panels, strict=True):
        shown = {what: histories[what][1:] for what in FORCES if what in histories}
        force = unit(max((float(abs(v).max()) for v in shown.values()), default=0.0), "N")
        for number, what in enumerate(FORCES):
            if what in shown:
                style = style_of(number)
                axes.plot(histories["time"][1:] * clock.factor, shown[what] * force.factor,
                          color=style.colour, linestyle=style.dash, linewidth=1.1,
                          label=FORCES[what])
        tidy(axes, f"time ({clock.name})" if axes is panels[-1] else "", f"force ({force.name})",
             name)
        low, high = axes.get_ylim()
        axes.set_ylim(min(0.0, low), max(1.08 * high, 0.0) or 1.0)
        axes.set_xlim(0.0, end * clock.factor)
    legend_above(figure, panels[0].get_legend_handles_labels()[0])
    return figure
