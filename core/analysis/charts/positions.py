"""Chart of the positions of body frames over time (as Fig. 11 of the paper)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.analysis.charts.style import COLUMN, legend_above, new_figure, style_of, tidy
from sparsemor.core.analysis.charts.units import unit
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import FREE_POSE, KNOWN, PLANAR_POSE, turned_by
from sparsemor.core.results.run_result import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("x moved", "y moved", "z moved", "turned")
_STILL = 1e-12
"""m or rad: a panel in which nothing moves farther is left out."""


def moving_bodies(run: RunResult) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Body -> times (j,), s, and pose (j, 3), (j, 4) or (j, 7), m and rad: of the frames that the
    run followed; else of those that it solved for, in space, and in a scene with contact."""
    stage = run.stage()
    if stage is not None:
        return {body: (stage.times, stage.frames[body].pose) for body in sorted(stage.moves)}
    least = PLANAR_POSE if run.scene.get("contacts") else PLANAR_POSE + 1
    return {b.owner: (run.times, run.block(b.name)) for b in run.layout
            if b.kind.quantity is Quantity.POSE and b.size in KNOWN and b.size >= least}


def positions_figure(moving: Mapping[str, tuple[FloatArray, FloatArray]]) -> "Figure | None":
    """Displacement of each frame's origin along the axes, and its turn; None when there is none.
    moving: as `moving_bodies` gives it.

    Each has a panel, because a slider goes millimetres along and micrometres down.
    """
    end = max((float(times[-1]) for times, _ in moving.values() if len(times) > 1), default=0.0)
    rows = {what: shown for what in _AXES if (shown := _moved(moving, what))}
    if end <= 0.0 or not rows:
        return None
    figure = new_figure(COLUMN, 0.55 + len(rows) * 1.3)
    panels = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    clock = unit(end, "s")
    bodies = list(moving)
    for axes, (what, moved) in zip(panels, rows.items(), strict=True):
        largest = max(float(np.abs(v).max()) for v in moved.values())
        scale = unit(largest, "rad" if what == "turned" else "m")
        for body, values in moved.items():
            style = style_of(bodies.index(body))
            axes.plot(moving[body][0] * clock.factor, values * scale.factor,
                      color=style.colour, linestyle=style.dash, linewidth=1.1, label=body)
        tidy(axes, f"time ({clock.name})" if axes is panels[-1] else "", f"{what} ({scale.name})")
        axes.set_xlim(0.0, end * clock.factor)
        _no_offset(axes)
    handles = {h.get_label(): h for axes in panels for h in axes.get_legend_handles_labels()[0]}
    legend_above(figure, [handles[body] for body in bodies if body in handles])
    return figure


def _moved(
    moving: Mapping[str, tuple[FloatArray, FloatArray]], what: str
) -> dict[str, FloatArray]:
    """Body -> (j,) since the start, m or rad; empty where nothing moves."""
    found = {}
    for body, (_, pose) in moving.items():
        plane = pose.shape[1] == PLANAR_POSE
        if what == "turned":
            found[body] = (
                turned_by(pose) if pose.shape[1] == FREE_POSE else pose[:, -1] - pose[0, -1])
        elif what != "z moved" or not plane:
            column = pose[:, _AXES.index(what)]
            found[body] = column - column[0]
    moves = any(np.abs(values).max(initial=0.0) > _STILL for values in found.values())
    return found if moves else {}


def _no_offset(axes: Any) -> None:
    """Full numbers on the axis instead of differences from one."""
    axes.ticklabel_format(axis="y", useOffset=False)
