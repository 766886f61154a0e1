"""The pictures that an item of a paper file may name: `{draws: angles, reference: a, others:
{label: b}}`. Each is drawn from our runs, as figures by name, None where there are no data; also
sketches: geometry of a scene from its meshes, flow charts, and our numbers next to published
ones."""

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.facets import linear_surface, plane_triangles
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins import charts
from sparsemor.plugins.charts.planar_fields import drawable_bodies
from sparsemor.plugins.charts.style import COLUMN, NORMAL, PAGE, SMALL, new_figure, plain, unit
from sparsemor.plugins.charts.style import style_of as style
from sparsemor.plugins.charts.surface_fields import solid_bodies
from sparsemor.plugins.charts.time_histories import moving_bodies
from sparsemor.plugins.charts.view_in_space import VIEWS, front_facing
from sparsemor.plugins.liang2026.item_functions import PaperPart, errors_of, part_of
from sparsemor.plugins.liang2026.quantities import FIELDS, FieldName

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = object

Figures: TypeAlias = Mapping[str, Figure | None]
Others: TypeAlias = Mapping[str, RunResult]
"""Label -> run."""
NONE: Others = {}


def angles(reference: RunResult, others: Others = NONE, label: str = "full order") -> Figures:
    """Rotation angles over time; label: of the reference."""
    return {"angles": charts.angles_figure(reference, others, label)}


def errors(reference: RunResult, others: Others = NONE, label: str = "full order") -> Figures:
    """Errors of the other runs over time."""
    return {"errors": charts.error_over_time_figure(
        {name: errors_of(reference, run) for name, run in others.items()},
        {name: run.status for name, run in others.items()}, reference.layout.kinds, LIMIT)}


def fields(
    reference: RunResult, field: FieldName, times: list[float], others: Others = NONE,
    label: str = "full order", bodies: list[str] = [],  # noqa: B006 (never changed)
) -> Figures:
    """A field of the bodies at some times, of all runs next to each other; bodies: those in space
    that are drawn, none for all. Planar bodies are drawn together."""
    end, quantity = float(reference.times[-1]), FIELDS[field]
    within = [t for t in times if t <= end * (1.0 + 1e-9)] or [end]
    return {field: charts.deformation_figure(reference, quantity, within, others, label),
            **charts.surface_figures(reference, within, others=others, name=label, only=[
                (b, quantity) for b in bodies or reference.bodies])}


def probes(
    reference: RunResult, field: FieldName, others: Others = NONE, label: str = "full order"
) -> Figures:
    """Values of probes over time."""
    chart = (charts.probe_temperature_figure if field == "temperature"
             else charts.probe_displacement_figure)
    return {field: chart(reference, others, label)}


def atoms(of: RunResult, label: str = "as published") -> Figures:
    """Active basis vectors (atoms) over time."""
    return {"atoms": charts.active_atoms_figure(of, label)}


def forces(of: RunResult) -> Figures:
    """Contact forces over time."""
    return {"forces": charts.contact_forces_figure(of.contacts())}


def positions(of: RunResult) -> Figures:
    """Displacement of the body frames over time."""
    return {"positions": charts.positions_figure(moving_bodies(of))}


def geometry(of: RunResult) -> Figures:
    """Meshes of the bodies at the start of a run, with joints' and loads' names."""
    return {"geometry": geometry_figure(of)}


def flow(
    steps: list[str], back: tuple[int, int] | None = None, again: str = ""
) -> Figures:
    """Flow chart: steps from top to bottom, and an arrow back from one step to another (the first
    is 1) with the text `again`."""
    return {"flow": flow_figure(steps, back, again)}


if TYPE_CHECKING:
    Picture: TypeAlias = PaperPart
else:
    Picture = Annotated[reduce(or_, (part_of(f, "draws") for f in (
        angles, errors, fields, probes, atoms, forces, positions, geometry, flow))),
        Field(discriminator="draws")]


def geometry_figure(run: RunResult) -> "Figure | None":
    """Meshes of all bodies of a run at its start, in the plane or in a view from above; None
    without bodies. Names, sizes and numbers of elements are written next to them."""
    flat, solid = drawable_bodies(run), solid_bodies(run)
    shapes = {body: _lines(run, body, body in solid) for body in (*flat, *solid)}
    if not shapes:
        return None
    size = np.ptp(np.concatenate([lines.reshape(-1, 2) for lines in shapes.values()]), axis=0)
    metre = unit(float(size.max()), "m")
    figure = new_figure(PAGE, float(np.clip(PAGE * size[1] / size[0], 1.2, 5.5)) + 0.9)
    axes = figure.subplots()
    for number, (body, edges) in enumerate(shapes.items()):
        lines, colour = metre.factor * edges, style(number).colour
        axes.plot(lines[..., 0].T, lines[..., 1].T, color=colour, linewidth=0.35)
        extent = np.ptp(run.points(body), axis=0)
        own = unit(float(extent.max()), "m")
        axes.plot([], [], color=colour, label=plain(
            f"{body}: {len(run.cells(body))} elements, {len(run.points(body))} nodes, "
            f"{' × '.join(f'{own.factor * s:.4g}' for s in extent)} {own.name}"))
    names = ", ".join([*run.scene.get("joints", {}), *run.scene.get("contacts", {})])
    loads = ", ".join(run.scene.get("loads", {}))
    axes.set_aspect("equal")
    if solid:
        axes.set_axis_off()
    axes.set_xlabel(f"x ({metre.name})", fontsize=NORMAL)
    axes.set_ylabel(f"y ({metre.name})", fontsize=NORMAL)
    axes.tick_params(labelsize=SMALL)
    axes.set_title(plain(f"joints and contacts: {names or 'none'}; loads: {loads or 'none'}"),
                   fontsize=NORMAL, loc="left")
    figure.legend(loc="outside lower left", fontsize=SMALL, frameon=False)
    return figure


def _lines(run: RunResult, body: str, solid: bool) -> FloatArray:
    """(l, 2, 2) ends of the edges that are drawn of a body, m."""
    cells, corners = run.cells(body), run.positions(body, 0)
    if not solid:
        cells = plane_triangles(cells)
    else:
        triangles = linear_surface(cells, 3)
        corners = VIEWS[0].rotated(corners)
        cells = triangles[front_facing(corners[triangles])]
    edges = np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])
    return np.asarray(corners[np.unique(np.sort(edges, axis=1), axis=0)][..., :2])


def flow_figure(steps: Sequence[str], back: tuple[int, int] | None, again: str) -> "Figure":
    """Flow chart with one box per step from top to bottom, and an arrow from step back[0] to step
    back[1] (counted from 1) with the text `again`."""
    count = len(steps)
    figure = new_figure(1.5 * COLUMN, 0.62 * count + 0.2)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set(xlim=(0.0, 1.05), ylim=(-count + 0.4, 0.6))
    box = {"boxstyle": "round,pad=0.45", "facecolor": "#eef4fa", "edgecolor": style(0).colour,
           "linewidth": 0.8}
    for number, text in enumerate(steps):
        axes.text(0.5, -number, plain(f"{number + 1}. {text}"), ha="center", va="center",
                  fontsize=NORMAL, bbox=box)
        if number:
            _arrow(axes, (0.5, -number + 0.72), (0.5, -number + 0.3))
    if back is not None:
        start, end = 1.0 - back[0], 1.0 - back[1]
        axes.plot([0.88, 0.96, 0.96], [start, start, end], color="black", linewidth=0.8)
        _arrow(axes, (0.96, end), (0.86, end))
        axes.text(0.985, 0.5 * (start + end), plain(again), rotation=90, ha="left", va="center",
                  fontsize=SMALL)
    return figure


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate("", xy=end, xytext=start,
                  arrowprops={"arrowstyle": "-|>", "linewidth": 0.8, "color": "black"})


def numbers_figure(pairs: Mapping[str, tuple[float, float]]) -> "Figure | None":
    """Published numbers and ours next to each other on a logarithmic axis; None for fewer than two
    pairs of positive numbers, or if no pair differs by more than a fifth.

    pairs: label -> (published, ours).
    """
    shown = {name: pair for name, pair in pairs.items()
             if min(pair) > 0.0 and np.isfinite(pair).all()}
    if len(shown) < 2 or all(max(pair) <= 1.2 * min(pair) for pair in shown.values()):
        return None
    figure = new_figure(1.6 * COLUMN, 0.75 + 0.27 * len(shown))
    axes = figure.subplots()
    rows, found = -np.arange(len(shown), dtype=np.float64), np.array(list(shown.values()))
    axes.hlines(rows, found.min(axis=1), found.max(axis=1), color="#c8c8c8", linewidth=1.0,
                zorder=0)
    axes.plot(found[:, 0], rows, "s", color=style(1).colour, markersize=5, label="published",
              markerfacecolor="none")
    axes.plot(found[:, 1], rows, "o", color=style(0).colour, markersize=5, label="here")
    axes.set_xscale("log")
    axes.set_yticks(rows, [plain(name) for name in shown], fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    axes.grid(True, axis="x", color="#e6e6e6", linewidth=0.5)
    axes.set_ylim(rows[-1] - 0.6, 0.6)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper left", ncols=2, fontsize=SMALL, frameon=False)
    return figure
