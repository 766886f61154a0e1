"""Surfaces of bodies in space, coloured by a field, at several times (as Fig. 19 of the paper)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.results.result_variables import Derived, Field
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.fields import (
    MAPS,
    NO_RUNS,
    drawn_steps,
    field_mesh,
    magnification,
    round_below,
    scale_of,
    shades,
    step_near,
    step_title,
    values_of,
)
from sparsemor.plugins.charts.style import NORMAL, PAGE, SMALL, new_figure, plain, unit
from sparsemor.plugins.charts.view_in_space import (
    VIEWS,
    BodySurface,
    View,
    half_of,
    middle,
    paint,
    rendered,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES: Mapping[Field, str] = {
    Quantity.DISPLACEMENT: "deformation", Quantity.TEMPERATURE: "temperature",
    Derived.STRESS: "stress", Derived.STRAIN: "strain"}
"""First part of the name of a chart."""
DEFAULT_FIELDS: tuple[Field, ...] = (Quantity.DISPLACEMENT, Quantity.TEMPERATURE)
_ACROSS = 3
Render = Callable[[Sequence[BodySurface]], list[NDArray[np.uint8]] | None]


@dataclass(frozen=True, slots=True, eq=False)
class _Skin:
    """Surface of one body, coloured by one field. rows: title, view and surfaces at the times (None
    after the end of a run) of each row of panels; factor: magnification of displacements; label:
    of the colour bar."""

    run: RunResult
    body: str
    steps: list[int]
    factor: float
    label: str
    rows: list[tuple[str, View, list[BodySurface | None]]]


def solid_bodies(run: RunResult) -> list[str]:
    """Bodies in space with a mesh."""
    return [body for body in run.bodies if run.points(body).shape[1] == 3
            and len(run.cells(body))]


def surface_figures(
    run: RunResult, times: Sequence[float] | None = None, render: Render = rendered,
    others: Mapping[str, RunResult] = NO_RUNS, name: str = "reference",
    only: Sequence[tuple[str, Field]] | None = None, fields: Sequence[Field] = DEFAULT_FIELDS,
) -> "dict[str, Figure]":
    """Charts `temperature_BODY`, `deformation_BODY` (|u|), `stress_BODY` and `strain_BODY` of each
    body in space, from above and below.

    times: s (default: one third, two thirds and the end). Displacements are magnified by a round
    factor, which the chart states. render: preferred renderer; if it returns None, matplotlib
    draws. others: label -> run, drawn from above below the first run, which is labelled `name`,
    with its colours; fields: those that are drawn; only: bodies and fields (default: all).
    """
    if len(run.times) == 0:
        return {}
    steps = drawn_steps(run, times).tolist()
    skins = {f"{NAMES[q]}_{body}": _skin_of(run, body, q, steps, others, name)
             for body in solid_bodies(run) for q in fields
             if run.has(body, q) and (only is None or (body, q) in only)}
    every = [s for skin in skins.values() for _, _, row in skin.rows for s in row if s is not None]
    images = render(every) if every else []
    drawn = repeat(None) if images is None else iter(images)
    return {name: _figure(skin, drawn) for name, skin in skins.items()}


def _skin_of(
    run: RunResult, body: str, quantity: Field, steps: list[int],
    others: Mapping[str, RunResult], name: str,
) -> _Skin:
    """Surfaces of a body at the steps: from several sides, or of several runs from one side."""
    factor = magnification(run, [body], steps)
    scale, label = scale_of(run, [body], steps, quantity)
    nodes, _, triangles = field_mesh(run, body, quantity)
    fields = [values_of(run, body, step, quantity) for step in steps]
    limits = shades(np.concatenate(
        [scale * field[triangles] for field in fields if field is not None]), quantity)
    half: FloatArray | None = None
    rows: list[tuple[str, View, list[BodySurface | None]]] = []
    sides = [(view.name, view, run) for view in VIEWS] if not others else [
        (title, VIEWS[0], r) for title, r in {name: run, **others}.items()]
    for title, view, shown in sides:
        at = [step_near(shown, float(run.times[s])) for s in steps]
        rotated = [None if s is None else view.rotated(shown.positions(body, s, factor)[nodes])
                   for s in at]
        if half is None or not others:  # panels of several runs have the size of the first run's
            half = half_of([p for p in rotated if p is not None])
        row: list[BodySurface | None] = []
        for s, points in zip(at, rotated, strict=True):
            values = None if s is None else values_of(shown, body, s, quantity)
            row.append(None if points is None or values is None else BodySurface(
                (points - middle(points))[triangles], scale * values[triangles], *limits,
                MAPS[quantity], half))
        rows.append((title, view, row))
    return _Skin(run, body, steps, factor, label, rows)


def _figure(skin: _Skin, images: Iterator[NDArray[np.uint8] | None]) -> "Figure":
    """Figure of one body and field: groups of rows, one per view or run, with up to three times per
    row. images: picture of each surface in the order of rows and times, None where matplotlib
    draws it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    across, tall = min(_ACROSS, len(skin.steps)), len(skin.rows)
    groups = -(-len(skin.steps) // across)
    first = [next(s for s in row if s is not None) for _, _, row in skin.rows if any(row)]
    slope = max(s.half[1] / s.half[0] for s in first)
    panel = min((PAGE - 1.3) / across, 3.2)
    figure = new_figure(panel * across + 1.3, tall * groups * (panel * slope + 0.25) + 0.35)
    grid = figure.subplots(tall * groups, across, squeeze=False)
    for axes in grid.ravel():
        axes.set_visible(False)
    for side, (title, view, row) in enumerate(skin.rows):
        for number, (step, surface) in enumerate(zip(skin.steps, row, strict=True)):
            group, column = divmod(number, across)
            axes = grid[tall * group + side, column]
            if surface is None:
                continue
            _panel(axes, surface, next(images))
            if side == 0:
                axes.set_title(step_title(skin.run, step, ".4g"), fontsize=NORMAL, loc="left")
            if column == 0:
                axes.set_ylabel(plain(title), fontsize=NORMAL)
                _directions(axes, view, surface)
                _length(axes, surface)
    colours = ScalarMappable(Normalize(first[0].low, first[0].high), first[0].colours)
    bar = figure.colorbar(colours, ax=grid.ravel().tolist(), shrink=0.8, pad=0.015, aspect=30)
    bar.set_label(skin.label, fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, width=0.6, length=3)
    figure.supxlabel(_note(skin), fontsize=SMALL)
    return figure


def _panel(axes: "Axes", surface: BodySurface, image: NDArray[np.uint8] | None) -> None:
    w, h = surface.half
    axes.set_visible(True)
    if image is None:
        paint(axes, surface)
    else:
        axes.imshow(image, extent=(-w, w, -h, h), interpolation="antialiased", rasterized=True)
    axes.set(xlim=(-w, w), ylim=(-h, h), xticks=[], yticks=[], aspect="equal")
    for spine in axes.spines.values():
        spine.set_visible(False)


def _directions(axes: "Axes", view: View, surface: BodySurface) -> None:
    """Draws the directions of the x, y and z axes in a corner on the left."""
    size = 0.16 * float(surface.half.min())
    corner = (surface.half - 1.5 * size) * (-1.0, _emptier(surface, -1.0))
    for name, (dx, dy) in zip("xyz", view.axes[:2].T, strict=True):
        tip = corner + size * np.array([dx, dy])
        axes.plot([corner[0], tip[0]], [corner[1], tip[1]], color="black", linewidth=0.7)
        x, y = corner + 1.45 * size * np.array([dx, dy])
        axes.text(x, y, name, fontsize=SMALL, ha="center", va="center")


def _length(axes: "Axes", surface: BodySurface) -> None:
    """Draws a scale bar of round length in a corner on the right."""
    half = surface.half
    length = round_below(0.5 * float(half[0]))
    shown = unit(length, "m")
    low = _emptier(surface, 1.0) < 0.0
    x, y = 0.97 * half[0], (-0.97 if low else 0.85) * half[1]
    axes.plot([x - length, x], [y, y], color="black", linewidth=1.2, solid_capstyle="butt")
    axes.text(x - 0.5 * length, y + 0.02 * half[0], f"{shown.factor * length:g} {shown.name}",
              fontsize=SMALL, ha="center", va="bottom")


def _emptier(surface: BodySurface, side: float) -> float:
    """Corner on the left (side -1) or right (1) that contains less of the body: -1.0 for the lower,
    1.0 for the upper one."""
    x, y = (surface.corners.reshape(-1, 3)[:, :2] / surface.half).T
    inside = [int(np.sum((side * x > 0.5) & (up * y > 0.5))) for up in (-1.0, 1.0)]
    return -1.0 if inside[0] <= inside[1] else 1.0


def _note(skin: _Skin) -> str:
    drawn = f"drawn with displacements × {skin.factor:g}; " if (
        skin.run.layout.of(skin.body, Quantity.DISPLACEMENT) is not None) else ""
    return f"{drawn}each panel is centred on the body"
