"""Deformed planar bodies coloured by a field, at three times (as Fig. 5 of the paper)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import PLANAR_POSE
from sparsemor.core.results.result_variables import Field
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.fields import (
    MAPS,
    NO_RUNS,
    drawn_steps,
    field_mesh,
    magnification,
    scale_of,
    shades,
    step_near,
    step_title,
    values_of,
)
from sparsemor.plugins.charts.style import (
    COLUMN,
    NORMAL,
    PAGE,
    SMALL,
    TRACE,
    AxisUnit,
    new_figure,
    plain,
    tidy,
    unit,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def drawable_bodies(run: RunResult) -> list[str]:
    """Planar bodies with a mesh."""
    return [body for body in run.bodies
            if run.points(body).shape[1] == 2 and len(run.cells(body))
            and ((frame := run.layout.of(body, Quantity.POSE)) is None
                 or frame.size == PLANAR_POSE)]


def deformation_figure(
    run: RunResult, quantity: Field, times: Sequence[float] | None = None,
    others: Mapping[str, RunResult] = NO_RUNS, name: str = "reference",
) -> "Figure | None":
    """Displacement magnitude |u|, temperature, von Mises stress or equivalent strain on the
    deformed bodies at `times`, s.

    Default times: one third, two thirds and the end of the run. Displacements are magnified by a
    round factor, which the chart states. others: label -> run whose fields are drawn in a row
    below, with the colours, the magnification and the times of the first run, which is labelled
    `name`; each panel then states its maximum. None if no planar body has the field.
    """
    bodies = drawable_bodies(run)
    if len(run.times) == 0 or not any(
            run.has(b, quantity) for b in bodies):
        return None
    steps = drawn_steps(run, times).tolist()
    factor = magnification(run, bodies, steps)
    scale, label = scale_of(run, bodies, steps, quantity)
    colours = [values_of(run, b, s, quantity) for s in steps for b in bodies]
    low, high = shades(np.concatenate([v * scale for v in colours if v is not None]), quantity)
    box = _bounds(run, bodies, steps, factor)
    metre = _length_unit(box)
    look = _Look(quantity, factor, scale, label, (low, high), box, metre)
    rows = {name: run, **others}
    figure, panels = _panels(len(rows), len(steps), (box[3] - box[2]) / (box[1] - box[0]))
    drawn: Any = None
    for axes, (row, step) in zip(panels, product(rows, steps), strict=True):
        place, at = axes.get_subplotspec(), float(run.times[step])
        shown = step_near(rows[row], at)
        title = step_title(run, step, ".3f")
        if others:
            title = f"{plain(row)}\n{title}{_largest_in_words(rows[row], bodies, shown, look)}"
        tidy(axes, f"x ({metre.name})" if place.is_last_row() else "",
             f"y ({metre.name})" if place.is_first_col() else "", title)
        if shown is not None:
            drawn = _draw(axes, rows[row], bodies, shown, look) or drawn
        axes.set_aspect("equal")
        axes.set(xlim=[metre.factor * x for x in box[:2]],
                 ylim=[metre.factor * y for y in box[2:]])
    bar = figure.colorbar(drawn, ax=panels, shrink=0.9, pad=0.015, aspect=30)
    bar.set_label(label, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, width=0.6, length=3)
    notes = [f"drawn with displacements × {factor:g}"] * any(
        run.layout.of(b, Quantity.DISPLACEMENT) is not None for b in bodies)
    notes += ["grey: path of each body frame's origin"] * any(
        _path(run, b) is not None for b in bodies)
    figure.supxlabel("; ".join(notes), fontsize=SMALL)
    return figure


@dataclass(frozen=True, slots=True)
class _Look:
    """Field, magnification of displacements, factor (`scale`) from the field's SI unit to that of
    the colours and its label, limits of the colours in that unit, and axes of all panels: box
    (x from, x to, y from, y to), m, and the unit in which they are labelled."""

    quantity: Field
    magnification: float
    scale: float
    label: str
    limits: tuple[float, float]
    box: tuple[float, float, float, float]
    metre: AxisUnit


def _draw(axes: Any, run: RunResult, bodies: Sequence[str], step: int, look: _Look) -> Any:
    """Draws all bodies of a run at one stored step; returns the last coloured surface, or None."""
    drawn: Any = None
    for body in bodies:
        values = values_of(run, body, step, look.quantity)
        _trace(axes, run, body, look.metre)
        nodes, cells, edges = field_mesh(run, body, look.quantity)
        x, y = look.metre.factor * run.positions(body, step, look.magnification)[nodes].T
        if values is not None:
            drawn = axes.tripcolor(
                x, y, cells, values * look.scale, shading="gouraud", rasterized=True,
                vmin=look.limits[0], vmax=look.limits[1], cmap=MAPS[look.quantity])
        axes.plot(x[edges].T, y[edges].T, color="#606060", linewidth=0.3)
    return drawn


def _largest_in_words(
    run: RunResult, bodies: Sequence[str], step: int | None, look: _Look
) -> str:
    """End of a panel's title: the maximum of the field, or why the panel is empty."""
    if step is None:
        return f": stopped at {run.times[-1]:.3g} s"
    found = [values_of(run, body, step, look.quantity) for body in bodies]
    values = [look.scale * float(v.max()) for v in found if v is not None]
    name = look.label.rpartition("(")[2].rstrip(")")
    return f", max {max(values):.4g} {name}" if values else ""


def _panels(runs: int, count: int, slope: float) -> "tuple[Figure, list[Any]]":
    """Figure with a row of `count` panels per run; for one run with wide contents they are below
    each other. slope: ratio of height to width of the contents."""
    wide = slope < 0.75 and runs == 1
    rows, columns = (count, 1) if wide else (runs, count)
    width = 1.35 * COLUMN if wide else PAGE if runs == 1 else 1.15 * PAGE
    panel = (width - 1.2) / columns * slope
    figure = new_figure(width, rows * (panel + (0.35 if runs == 1 else 0.6)) + 0.6)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, list(panels.ravel())


def _length_unit(box: tuple[float, float, float, float]) -> AxisUnit:
    return unit(max(box[1] - box[0], box[3] - box[2]), "m")


def _bounds(
    run: RunResult, bodies: Sequence[str], steps: Sequence[int], factor: float
) -> tuple[float, float, float, float]:
    points = [run.positions(b, s, factor) for b in bodies for s in steps]
    points += [path for b in bodies if (path := _path(run, b)) is not None]
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    margin = 0.04 * float((high - low).max())
    return (float(low[0] - margin), float(high[0] + margin),
            float(low[1] - margin), float(high[1] + margin))


def _trace(axes: Any, run: RunResult, body: str, metre: AxisUnit) -> None:
    """Draws the path of the origin of the body's frame, which is located at a joint in most
    scenes."""
    path = _path(run, body)
    if path is not None:
        axes.plot(*(metre.factor * path.T), color=TRACE, linewidth=0.8, zorder=0)


def _path(run: RunResult, body: str) -> FloatArray | None:
    """(j, 2) path of the origin of the body's frame, computed in the run or prescribed by the rigid
    pre-simulation; None for a fixed frame."""
    frame = run.layout.of(body, Quantity.POSE)
    if frame is not None:
        return run.block(frame.name)[:, :2]
    stage = run.stage()
    if stage is None or body not in stage.moves:
        return None
    return stage.frames[body].pose[stage.times <= run.times[-1], :2]
