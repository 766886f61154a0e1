"""Bodies where they are, coloured by a field, at three times (as Fig. 5 of the paper)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.charts.style import COLUMN, NORMAL, PAGE, SMALL, TRACE, new_figure, tidy
from sparsemor.core.results import RunResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Quantity = Literal["elastic", "thermal"]
_MAPS = {"elastic": "viridis", "thermal": "YlOrRd"}
"""The cold inside of a heated body stays light, so that a thin hot layer is seen."""


def drawable_bodies(run: RunResult) -> list[str]:
    """Planar bodies with a mesh of triangles."""
    return [body for body in run.bodies
            if run.points(body).shape[1] == 2 and run.cells(body).shape[1:] == (3,)
            and (f"{body}.rigid" not in run.layout or _size(run, f"{body}.rigid") == 3)]


def deformation_figure(
    run: RunResult, quantity: Quantity, times: Sequence[float] | None = None
) -> "Figure | None":
    """|u| or temperature on the moved bodies at `times` (s; default: a third, two, the end).

    Displacements are magnified by a round factor, which the picture states. None when no planar
    body has the field.
    """
    bodies = drawable_bodies(run)
    if len(run.times) == 0 or not any(f"{b}.{quantity}" in run.layout for b in bodies):
        return None
    end = float(run.times[-1])
    wanted = times or (end / 3.0, 2.0 * end / 3.0, end)
    steps = [int(np.argmin(np.abs(run.times - t))) for t in wanted]
    factor = magnification(run, bodies, steps)
    scale, label = _unit(run, bodies, steps, quantity)
    colours = [[_values(run, b, s, quantity) for b in bodies] for s in steps]
    seen = np.concatenate([v * scale for row in colours for v in row if v is not None])
    low, high = (0.0 if quantity == "elastic" else float(seen.min())), float(seen.max())
    if low == high:  # one colour throughout still needs a scale
        low, high = low - 0.5, high + 0.5
    shades = {"vmin": low, "vmax": high, "cmap": _MAPS[quantity]}
    box = _bounds(run, bodies, steps, factor)
    figure, panels = _panels(len(steps), (box[3] - box[2]) / (box[1] - box[0]))
    drawn: Any = None
    for axes, step, row in zip(panels, steps, colours, strict=True):
        place = axes.get_subplotspec()
        tidy(axes, "x (m)" if place.is_last_row() else "",
             "y (m)" if place.is_first_col() else "", f"t = {run.times[step]:.3f} s")
        for body, values in zip(bodies, row, strict=True):
            _trace(axes, run, body)
            x, y = run.positions(body, step, factor).T
            cells = run.cells(body)
            if values is not None:
                drawn = axes.tripcolor(x, y, cells, values * scale, shading="gouraud",
                                       rasterized=True, **shades)
            edges = _outline(cells)
            axes.plot(x[edges].T, y[edges].T, color="#606060", linewidth=0.3)
        axes.set_aspect("equal")
        axes.set(xlim=box[:2], ylim=box[2:])
    bar = figure.colorbar(drawn, ax=panels, shrink=0.9, pad=0.015, aspect=30)
    bar.set_label(label, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, width=0.6, length=3)
    note = "grey: path of each body frame's origin"
    if any(f"{b}.elastic" in run.layout for b in bodies):
        note = f"drawn with displacements × {factor:g}; {note}"
    figure.supxlabel(note, fontsize=SMALL)
    return figure


def _panels(count: int, slope: float) -> "tuple[Figure, list[Any]]":
    """Side by side, or below each other where what is drawn is wide; slope: height by width."""
    wide = slope < 0.75
    rows, columns = (count, 1) if wide else (1, count)
    width = 1.35 * COLUMN if wide else PAGE
    panel = (width - 1.2) / columns * slope
    figure = new_figure(width, rows * (panel + 0.35) + 0.6)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, list(panels.ravel())


def _outline(cells: IntArray) -> IntArray:
    """(b, 2) edges that belong to one triangle only."""
    edges = np.sort(cells[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    single, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(single[count == 1], dtype=np.int64)


def magnification(run: RunResult, bodies: Sequence[str], steps: Sequence[int]) -> float:
    """1, 2 or 5 times a power of ten that makes the largest |u| about 6 % of a body; at least 1."""
    ratio = 0.0
    for body in bodies:
        size = float(np.ptp(run.points(body), axis=0).max())
        for step in steps:
            u = np.linalg.norm(run.nodal_displacement(body, step), axis=1).max()
            ratio = max(ratio, float(u) / size)
    if ratio == 0.0 or ratio >= 0.06:
        return 1.0
    wanted = 0.06 / ratio
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= wanted * (1.0 + 1e-12)))


def _values(run: RunResult, body: str, step: int, quantity: Quantity) -> FloatArray | None:
    if f"{body}.{quantity}" not in run.layout:
        return None
    if quantity == "thermal":
        return run.nodal_temperature(body, step)
    return np.asarray(np.linalg.norm(run.nodal_displacement(body, step), axis=1))


def _unit(
    run: RunResult, bodies: Sequence[str], steps: Sequence[int], quantity: Quantity
) -> tuple[float, str]:
    if quantity == "thermal":
        return 1.0, "temperature (K)"
    largest = max(float(np.abs(run.nodal_displacement(b, s)).max()) for b in bodies for s in steps)
    units = ((1.0, "m"), (1e3, "mm"), (1e6, "µm"), (1e9, "nm"))
    scale, unit = next((u for u in units if largest * u[0] >= 0.5), units[-1])
    return scale, f"displacement |u| ({unit})"


def _bounds(
    run: RunResult, bodies: Sequence[str], steps: Sequence[int], factor: float
) -> tuple[float, float, float, float]:
    points = [run.positions(b, s, factor) for b in bodies for s in steps]
    points += [run.block(f"{b}.rigid")[:, :2] for b in bodies if f"{b}.rigid" in run.layout]
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    margin = 0.04 * float((high - low).max())
    return (float(low[0] - margin), float(high[0] + margin),
            float(low[1] - margin), float(high[1] + margin))


def _trace(axes: Any, run: RunResult, body: str) -> None:
    """The path of the body frame's origin, which sits at a joint in most scenes."""
    if f"{body}.rigid" in run.layout:
        path = run.block(f"{body}.rigid")[:, :2]
        axes.plot(path[:, 0], path[:, 1], color=TRACE, linewidth=0.8, zorder=0)


def _size(run: RunResult, name: str) -> int:
    place = run.layout[name]
    return int(place.stop - place.start)
