"""Charts of runs and comparisons, by matplotlib objects only: no window, no global state."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from sparsemor.core.errors import InputError
from sparsemor.core.results.fields import Field
from sparsemor.plugins.charts.active_atoms import active_atoms_figure
from sparsemor.plugins.charts.comparison import error_over_time_of, work_precision_of
from sparsemor.plugins.charts.error_over_time import error_over_time_figure
from sparsemor.plugins.charts.fields import NO_RUNS, alike
from sparsemor.plugins.charts.joint_forces import joint_forces_figure
from sparsemor.plugins.charts.planar_fields import deformation_figure
from sparsemor.plugins.charts.style import save, saved
from sparsemor.plugins.charts.surface_fields import DEFAULT_FIELDS, NAMES, surface_figures
from sparsemor.plugins.charts.time_histories import (
    angles_figure,
    contact_forces_figure,
    moving_bodies,
    positions_figure,
    probe_displacement_figure,
    probe_temperature_figure,
)
from sparsemor.plugins.charts.work_precision import WorkPoint, work_precision_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.core.analysis.compare import Comparison
    from sparsemor.core.results.run_result import RunResult
    from sparsemor.plugins.charts.animation import Animation

FORMATS = ("png", "svg")
Figures: TypeAlias = "Iterator[tuple[str, Figure | None]]"
"""Names of files with figures, drawn one by one."""


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
    for name, figure in _of_comparison(comparison, times):
        if figure is not None:
            yield from save(figure, folder, name, formats)


def _of_comparison(comparison: "Comparison", times: Sequence[float] | None) -> Figures:
    reference, runs, name = comparison.reference, comparison.runs, comparison.name
    yield from _of_reference(reference, times, alike(reference, runs), name)
    yield "angles", angles_figure(reference, runs, name)
    yield "error_over_time", error_over_time_of(comparison)
    yield "work_precision", work_precision_of(comparison)
    for label, run in runs.items():
        yield _atoms_file(label), active_atoms_figure(run, label)


def write_run_charts(
    run: "RunResult", folder: Path, times: Sequence[float] | None = None,
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
    for name, figure in _of_run(run, times, fields):
        if figure is not None:
            for path in saved(figure, folder, name, formats):
                files.append(path)
                if report is not None:
                    report(path)
    return files


def _of_run(
    run: "RunResult", times: Sequence[float] | None, fields: Sequence[Field]
) -> Figures:
    yield from _of_reference(run, times, fields=fields)
    yield "angles", angles_figure(run, {}, run.reducer)
    yield "active_atoms", active_atoms_figure(run, run.reducer)


def _of_reference(
    run: "RunResult", times: Sequence[float] | None, others: "Mapping[str, RunResult]" = NO_RUNS,
    name: str = "reference", fields: Sequence[Field] = DEFAULT_FIELDS,
) -> Figures:
    for f in fields:
        yield NAMES[f], deformation_figure(run, f, times, others, name)
    yield "probe_displacement", probe_displacement_figure(run, others, name)
    yield "probe_temperature", probe_temperature_figure(run, others, name)
    yield from surface_figures(run, times, others=others, name=name, fields=fields).items()
    yield "contact_forces", contact_forces_figure(run.contacts())
    yield "joint_forces", joint_forces_figure(run)
    yield "positions", positions_figure(moving_bodies(run))


def figure_of(
    run: "RunResult | Comparison", chart: str | None = None, times: Sequence[float] | None = None
) -> "Figure":
    """Chart of a run or a comparison by its name (`sparsemor.plot`)."""
    from sparsemor.plugins.charts.plot import plot

    return plot(run, chart, times)


def animation_of(run: "RunResult", field: str = "displacement", **options: Any) -> "Animation":
    """Animation of a run, in memory."""
    from sparsemor.plugins.charts.animation import animation_of

    return animation_of(run, field, **options)


__all__ = [
    "DEFAULT_FIELDS", "FORMATS", "NAMES", "WorkPoint", "active_atoms_figure", "alike",
    "angles_figure", "animation_of", "contact_forces_figure",
    "deformation_figure", "error_over_time_figure", "figure_of", "joint_forces_figure",
    "positions_figure", "probe_displacement_figure", "probe_temperature_figure", "surface_figures",
    "usual_files", "work_precision_figure", "write_charts", "write_run_charts",
]
