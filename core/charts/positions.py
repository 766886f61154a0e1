"""How far bodies have moved over time (as Fig. 11 of the paper)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.charts.angles import turning_bodies
from sparsemor.core.charts.style import COLUMN, legend_above, new_figure, style_of, tidy
from sparsemor.core.charts.units import unit
from sparsemor.core.placement import PLANAR
from sparsemor.core.results import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def moving_bodies(run: RunResult) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Body -> times (j,), s, and pose (j, 3), m and rad, in a scene with contact or a rigid stage:
    of the frames that the run followed, else of those that it solved for."""
    stage = run.stage()
    if stage is not None:
        return {body: (stage.times, stage.frames[body].pose) for body in sorted(stage.moves)}
    if not run.scene.get("contacts"):
        return {}
    return {body: (run.times, pose) for body in turning_bodies(run)
            if (pose := run.block(f"{body}.rigid")).shape[1] == PLANAR}


def positions_figure(moving: Mapping[str, tuple[FloatArray, FloatArray]]) -> "Figure | None":
    """Displacement of each frame's origin along x and y, and its turn; None when there is none.
    moving: as `moving_bodies` gives it.

    x and y have a panel each, because a slider goes millimetres along and micrometres down.
    """
    end = max((float(times[-1]) for times, _ in moving.values() if len(times) > 1), default=0.0)
    if end <= 0.0:
        return None
    figure = new_figure(COLUMN, 0.55 + 3 * 1.3)
    panels = figure.subplots(3, 1, sharex=True)
    clock = unit(end, "s")
    for row, (axes, what) in enumerate(zip(panels, ("x moved", "y moved", "turned"), strict=True)):
        moved = {body: pose[:, row] - pose[0, row] for body, (_, pose) in moving.items()}
        largest = max(float(np.abs(v).max()) for v in moved.values())
        scale = unit(largest, "m" if row < 2 else "rad")
        for number, (body, values) in enumerate(moved.items()):
            style = style_of(number)
            axes.plot(moving[body][0] * clock.factor, values * scale.factor,
                      color=style.colour, linestyle=style.dash, linewidth=1.1, label=body)
        tidy(axes, f"time ({clock.name})" if row == 2 else "", f"{what} ({scale.name})")
        axes.set_xlim(0.0, end * clock.factor)
        _no_offset(axes)
    legend_above(figure, panels[0].get_legend_handles_labels()[0])
    return figure


def _no_offset(axes: Any) -> None:
    """Full numbers on the axis instead of differences from one."""
    axes.ticklabel_format(axis="y", useOffset=False)
