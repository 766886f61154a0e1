"""Bodies where they are, coloured by a field, at three times (as Fig. 5 of the paper)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.charts.style import COLUMN, NORMAL, PAGE, SMALL, TRACE, new_figure, tidy
from sparsemor.core.charts.units import Unit, unit
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
    scale, label = _scale(run, bodies, steps, quantity)
    colours = [[_values(run, b, s, quantity) for b in bodies] for s in steps]
    seen = np.concatenate([v * scale for row in colours for v in row if v is not None])
    low, high = (0.0 if quantity == "elastic" else float(seen.min())), float(seen.max())
    if low == high:  # one colour throughout still needs a scale
        low, high = low - 0.5, high + 0.5
    shades = {"vmin": low, "vmax": high, "cmap": _MAPS[quantity]}
    box, clock = _bounds(run, bodies, steps, factor), unit(end, "s")
    metre = _length_unit(box)
    figure, panels = _panels(len(steps), (box[3] - box[2]) / (box[1] - box[0]))
    drawn: Any = None
    for axes, step, row in zip(panels, steps, colours, strict=True):
        place = axes.get_subplotspec()
        tidy(axes, f"x ({metre.name})" if place.is_last_row() else "",
             f"y ({metre.name})" if place.is_first_col() else "",
             f"t = {clock.factor * run.times[step]:.3f} {clock.name}")
        for body, values in zip(bodies, row, strict=True):
            _trace(axes, run, body, metre)
            x, y = metre.factor * run.positions(body, step, factor).T
            cells = run.cells(body)
            if values is not None:
                drawn = axes.tripcolor(x, y, cells, values * scale, shading="gouraud",
                                       rasterized=True, **shades)
            edges = _outline(cells)
            axes.plot(x[edges].T, y[edges].T, color="#606060", linewidth=0.3)
        axes.set_aspect("equal")
        axes.set(xlim=[metre.factor * x for x in box[:2]],
                 ylim=[metre.factor * y for y in box[2:]])
    bar = figure.colorbar(drawn, ax=panels, shrink=0.9, pad=0.015, aspect=30)
    bar.set_label(label, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, width=0.6, length=3)
    notes = [f"drawn with displacements × {factor:g}"] * any(
        f"{b}.elastic" in run.layout for b in bodies)
    notes += ["grey: path of each body frame's origin"] * any(
        _path(run, b) is not None for b in bodies)
    figure.supxlabel("; ".join(notes), fontsize=SMALL)
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


def _scale(
    run: RunResult, bodies: Sequence[str], steps: Sequence[int], quantity: Quantity
) -> tuple[float, str]:
    if quantity == "thermal":
        return 1.0, "temperature (K)"
    largest = max(float(np.abs(run.nodal_displacement(b, s)).max()) for b in bodies for s in steps)
    shown = unit(largest, "m")
    return shown.factor, f"displacement |u| ({shown.name})"


def _length_unit(box: tuple[float, float, float, float]) -> Unit:
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


def _trace(axes: Any, run: RunResult, body: str, metre: Unit) -> None:
    """The path of the body frame's origin, which sits at a joint in most scenes."""
    path = _path(run, body)
    if path is not None:
        axes.plot(*(metre.factor * path.T), color=TRACE, linewidth=0.8, zorder=0)


def _path(run: RunResult, body: str) -> FloatArray | None:
    """(j, 2) where the origin of the body's frame was, solved for or followed; None: it stays."""
    if f"{body}.rigid" in run.layout:
        return run.block(f"{body}.rigid")[:, :2]
    stage = run.stage()
    if stage is None or body not in stage.moves:
        return None
    return stage.frames[body].pose[stage.times <= run.times[-1], :2]


def _size(run: RunResult, name: str) -> int:
    place = run.layout[name]
    return int(place.stop - place.start)
