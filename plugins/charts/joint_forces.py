"""Forces and moments of joints over time: the multipliers with their names and units."""

from typing import TYPE_CHECKING

from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.style import draw_line, handles_of, legend_above, time_panels, unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def joint_forces_figure(run: RunResult) -> "Figure | None":
    """Multipliers over time, one panel per joint and unit; None if no joint has any."""
    panels = {(joint, si): {name: v for (name, u), v in values.items() if u == si}
              for joint, values in run.joint_forces().items()
              for si in dict.fromkeys(u for _, u in values)}
    if not panels or len(run.times) < 2:
        return None
    scales = {key: unit(max(float(abs(v).max()) for v in lines.values()), key[1])
              for key, lines in panels.items()}
    figure, axes, clock = time_panels(
        [(f"{'moment' if si == 'N m' else 'force'} ({scales[joint, si].name})", joint)
         for joint, si in panels], float(run.times[-1]), 1.4)
    order = list(dict.fromkeys(name for lines in panels.values() for name in lines))
    for (key, lines), ax in zip(panels.items(), axes, strict=True):
        for name, values in lines.items():
            draw_line(ax, clock.factor * run.times, scales[key].factor * values,
                      order.index(name), name)
        ax.set_xlim(clock.factor * run.times[0], clock.factor * run.times[-1])
    legend_above(figure, handles_of(axes, order))
    return figure
