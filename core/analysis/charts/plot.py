"""Charts by name, as figures to show or change."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from sparsemor.core.analysis.charts import (
    NAMES,
    Compared,
    active_atoms_figure,
    alike,
    angles_figure,
    contact_forces_figure,
    deformation_figure,
    error_over_time_figure,
    joint_forces_figure,
    positions_figure,
    probe_displacement_figure,
    probe_temperature_figure,
    surface_figures,
    work_precision_figure,
)
from sparsemor.core.analysis.charts.fields import NO_RUNS
from sparsemor.core.analysis.charts.surface_fields import solid_bodies
from sparsemor.core.analysis.charts.time_histories import moving_bodies
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stress import Field

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Makers = Mapping[str, "Callable[[], Figure | None]"]
"""Name of a chart, as of its file -> function that draws it, None without data."""


def plot(
    run: RunResult, chart: str = "deformation", times: Sequence[float] | None = None
) -> "Figure":
    """Chart of a run by the name of its file: deformation, temperature, stress, strain (for bodies
    in space followed by `_BODY`), joint_forces, contact_forces, angles, positions,
    probe_displacement, probe_temperature or active_atoms.

    times: at which fields are drawn, s. InputError for another name and where there are no data.
    """
    return _drawn(_of_run(run, times), chart)


def plot_comparison(comparison: Compared, chart: str) -> "Figure":
    """Chart of a comparison by the name of its file (`Comparison.plot`)."""
    runs, reference, name = comparison.runs, comparison.reference, comparison.name
    kinds, limit = reference.layout.kinds, comparison.limit
    return _drawn({
        "work_precision": lambda: work_precision_figure(
            *comparison.work_points(), kinds, limit, comparison.work_notes()),
        "error_over_time": lambda: error_over_time_figure(
            comparison.measured, {n: run.status for n, run in runs.items()}, kinds, limit,
            comparison.trained_to),
        **_of_run(reference, None, alike(reference, runs), name),
        "angles": lambda: angles_figure(reference, runs, name)}, chart)


def _of_run(
    run: RunResult, times: Sequence[float] | None, others: Mapping[str, RunResult] = NO_RUNS,
    name: str = "reference",
) -> Makers:
    made: dict[str, Callable[[], Figure | None]] = {
        "joint_forces": lambda: joint_forces_figure(run),
        "contact_forces": lambda: contact_forces_figure(run.contacts()),
        "angles": lambda: angles_figure(run, {}, run.reducer),
        "positions": lambda: positions_figure(moving_bodies(run)),
        "probe_displacement": lambda: probe_displacement_figure(run, others, name),
        "probe_temperature": lambda: probe_temperature_figure(run, others, name),
        "active_atoms": lambda: active_atoms_figure(run, run.reducer)}
    for field, chart in NAMES.items():
        made[chart] = partial(deformation_figure, run, field, times, others, name)
        for body in solid_bodies(run):
            made[f"{chart}_{body}"] = partial(_surface, run, field, body, times, others, name)
    return made


def _surface(
    run: RunResult, field: Field, body: str, times: Sequence[float] | None,
    others: Mapping[str, RunResult], name: str,
) -> "Figure | None":
    found = surface_figures(
        run, times, others=others, name=name, only=[(body, field)], fields=[field])
    return next(iter(found.values()), None)


def _drawn(makers: Makers, chart: str) -> "Figure":
    if chart not in makers:
        others = suggestions(chart, list(makers), "charts")
        raise InputError(f"no chart is called {chart!r}: {others}", "chart")
    figure = makers[chart]()
    if figure is None:
        raise InputError(f"there are no data for {chart}", "chart")
    return figure
