"""Charts by name, as figures to show or change."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from sparsemor.core.analysis.compare import Comparison
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.fields import Field
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.active_atoms import active_atoms_figure
from sparsemor.plugins.charts.comparison import error_over_time_of, work_precision_of
from sparsemor.plugins.charts.fields import NO_RUNS, alike
from sparsemor.plugins.charts.joint_forces import joint_forces_figure
from sparsemor.plugins.charts.planar_fields import deformation_figure
from sparsemor.plugins.charts.surface_fields import NAMES, solid_bodies, surface_figures
from sparsemor.plugins.charts.time_histories import (
    angles_figure,
    contact_forces_figure,
    moving_bodies,
    positions_figure,
    probe_displacement_figure,
    probe_temperature_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Makers = Mapping[str, "Callable[[], Figure | None]"]
"""Name of a chart, as of its file -> function that draws it, None without data."""


def plot(
    run: RunResult | Comparison, chart: str | None = None, times: Sequence[float] | None = None
) -> "Figure":
    """Chart of a run or a comparison by the name of its file.

    chart: of a run deformation (the default), temperature, stress, strain (for bodies in space
    followed by `_BODY`), joint_forces, contact_forces, angles, positions, probe_displacement,
    probe_temperature or active_atoms; of a comparison work_precision (the default),
    error_over_time, or one of a run, with all runs in it where they can be. times: at which fields
    are drawn, s. InputError for another name and where there are no data.
    """
    if isinstance(run, RunResult):
        return _drawn(_of_run(run, times), chart or "deformation")
    reference, runs, name = run.reference, run.runs, run.name
    return _drawn({
        "work_precision": lambda: work_precision_of(run),
        "error_over_time": lambda: error_over_time_of(run),
        **_of_run(reference, times, alike(reference, runs), name),
        "angles": lambda: angles_figure(reference, runs, name)}, chart or "work_precision")


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
