"""Charts of runs and comparisons, by matplotlib objects only: no window, no global state."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.result_variables import Field
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.active_atoms import active_atoms_figure
from sparsemor.plugins.charts.animation import animation_of
from sparsemor.plugins.charts.comparison_points import work_notes, work_points
from sparsemor.plugins.charts.error_over_time import error_over_time_figure
from sparsemor.plugins.charts.fields import NO_RUNS, alike
from sparsemor.plugins.charts.planar_fields import deformation_figure
from sparsemor.plugins.charts.style import save, saved
from sparsemor.plugins.charts.surface_fields import (
    DEFAULT_FIELDS,
    NAMES,
    solid_bodies,
    surface_figures,
)
from sparsemor.plugins.charts.time_histories import (
    angles_figure,
    contact_forces_figure,
    joint_forces_figure,
    moving_bodies,
    positions_figure,
    probe_displacement_figure,
    probe_temperature_figure,
)
from sparsemor.plugins.charts.work_precision import WorkPoint, work_precision_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.plugins.comparison.compare import Comparison

FORMATS = ("png", "svg")
Makers = dict[str, "Callable[[], Figure | None]"]
"""Name of a chart, as of its file -> function that draws it, None without data."""


def usual_files(labels: Sequence[str] = ()) -> list[str]:
    """Names of the files that charts of runs with these labels usually have, whatever the scene."""
    names = [*NAMES.values(), "probe_displacement", "probe_temperature", "contact_forces",
             "joint_forces", "positions", "angles", "active_atoms", "error_over_time",
             "work_precision", *map(_atoms_file, labels)]
    return [f"{name}.{form}" for name in names for form in FORMATS]


def _atoms_file(label: str) -> str:
    return re.sub(r"[^\w.-]+", "_", f"active_atoms_{label}")


def write_charts(
    comparison: "Comparison", folder: Path, times: Sequence[float] | None = None,
    formats: Sequence[str] = FORMATS,
) -> Iterator[Path]:
    """Writes all charts that apply to a comparison of runs; yields the path of each file.

    times: times at which the deformed bodies are drawn, s; formats: file formats.
    """
    for name, make in _of_comparison(comparison, times, DEFAULT_FIELDS).items():
        if (figure := make()) is not None:
            yield from save(figure, folder, name, formats)


def write_run_charts(
    run: RunResult, folder: Path, times: Sequence[float] | None = None,
    formats: Sequence[str] = FORMATS, fields: Sequence[Field] = DEFAULT_FIELDS,
    report: Callable[[Path], None] | None = None,
) -> list[Path]:
    """Writes all charts that apply to a single run (no errors, no costs) into a folder that lists
    them; returns their paths.

    fields: those that colour the bodies; report: called with the path of each file when it is
    written; other arguments as in `write_charts`. InputError for a field that no body has, and
    instead of replacing a file that is not ours.
    """
    absent = [f.value for f in fields if f not in DEFAULT_FIELDS and not any(
        run.has(body, f) for body in run.bodies)]
    if absent:
        raise InputError(f"no body of this run has {absent[0]}", "fields")
    files = []
    for name, make in _of_run(run, times, fields).items():
        if (figure := make()) is not None:
            for path in saved(figure, folder, name, formats):
                files.append(path)
                if report is not None:
                    report(path)
    return files


def plot(
    run: "RunResult | Comparison", chart: str | None = None, times: Sequence[float] | None = None
) -> "Figure":
    """Chart of a run or a comparison by the name of its file.

    chart: of a run deformation (the default), temperature, stress, strain (for bodies in space
    followed by `_BODY`), joint_forces, contact_forces, angles, positions, probe_displacement,
    probe_temperature or active_atoms; of a comparison work_precision (the default),
    error_over_time, or one of a run, with all runs in it where they can be. times: at which fields
    are drawn, s. InputError for another name and where there are no data.
    """
    if isinstance(run, RunResult):
        chart = chart or "deformation"
        makers = _of_run(run, times, tuple(NAMES), chart)
    else:
        chart = chart or "work_precision"
        makers = _of_run(run.reference, times, tuple(NAMES), chart) | _of_comparison(
            run, times, tuple(NAMES), chart)
    return drawn(makers, chart)


def drawn(makers: Makers, chart: str) -> "Figure":
    """One of some charts. Raises InputError for another name, and without data."""
    if chart not in makers:
        others = suggestions(chart, list(makers), "charts")
        raise InputError(f"no chart is called {chart!r}: {others}", "chart")
    figure = makers[chart]()
    if figure is None:
        raise InputError(f"there are no data for {chart}", "chart")
    return figure


figure_of = plot
"""Chart by its name, for results that show themselves."""


def _of_run(
    run: RunResult, times: Sequence[float] | None, fields: Sequence[Field], only: str | None = None
) -> Makers:
    """Charts of a run in the order in which they are written. only: the one that is drawn."""
    return _of_every(run, times, NO_RUNS, "reference", fields, only) | {
        "angles": lambda: angles_figure(run, {}, run.reducer),
        "active_atoms": lambda: active_atoms_figure(run, run.reducer)}


def _of_comparison(
    comparison: "Comparison", times: Sequence[float] | None, fields: Sequence[Field],
    only: str | None = None,
) -> Makers:
    """Charts of a comparison, as `_of_run`."""
    reference, runs, name = comparison.reference, comparison.runs, comparison.name
    kinds, limit = reference.layout.kinds, comparison.limit
    return _of_every(reference, times, alike(reference, runs), name, fields, only) | {
        "angles": lambda: angles_figure(reference, runs, name),
        "error_over_time": lambda: error_over_time_figure(
            comparison.measured, {label: run.status for label, run in runs.items()}, kinds, limit,
            comparison.trained_to),
        "work_precision": lambda: work_precision_figure(
            *work_points(comparison), kinds, limit, work_notes(comparison)),
        **{_atoms_file(label): partial(active_atoms_figure, run, label)
           for label, run in runs.items()}}


def _of_every(
    run: RunResult, times: Sequence[float] | None, others: Mapping[str, RunResult], name: str,
    fields: Sequence[Field], only: str | None,
) -> Makers:
    """Charts that single runs and comparisons have, of a run called `name` and of others. only:
    name of the chart that is drawn, whose bodies alone are rendered; None: all."""
    surfaces = {f"{NAMES[f]}_{body}": (body, f) for body in solid_bodies(run) for f in fields
                if run.has(body, f)}
    figures = cache(partial(  # all at once: each call of the renderer starts a process
        surface_figures, run, times, others=others, name=name, fields=fields,
        only=[of for chart, of in surfaces.items() if only in (None, chart)]))

    def surface(chart: str) -> "Figure | None":
        return figures().get(chart)

    return {
        **{NAMES[f]: partial(deformation_figure, run, f, times, others, name) for f in fields},
        "probe_displacement": partial(probe_displacement_figure, run, others, name),
        "probe_temperature": partial(probe_temperature_figure, run, others, name),
        **{chart: partial(surface, chart) for chart in surfaces},
        "contact_forces": lambda: contact_forces_figure(run.contacts()),
        "joint_forces": partial(joint_forces_figure, run),
        "positions": lambda: positions_figure(moving_bodies(run))}


__all__ = [
    "DEFAULT_FIELDS", "FORMATS", "NAMES", "WorkPoint", "active_atoms_figure", "alike",
    "angles_figure", "animation_of", "contact_forces_figure",
    "deformation_figure", "error_over_time_figure", "figure_of", "joint_forces_figure", "plot",
    "positions_figure", "probe_displacement_figure", "probe_temperature_figure", "surface_figures",
    "usual_files", "work_precision_figure", "write_charts", "write_run_charts",
]
