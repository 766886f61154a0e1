"""Charts of runs, drawn with matplotlib objects only: no window, no global state."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from sparsemor.core.analysis.charts.active_atoms import active_atoms_figure
from sparsemor.core.analysis.charts.error_over_time import error_over_time_figure
from sparsemor.core.analysis.charts.fields import NO_RUNS
from sparsemor.core.analysis.charts.joint_forces import joint_forces_figure
from sparsemor.core.analysis.charts.planar_fields import deformation_figure
from sparsemor.core.analysis.charts.style import saved
from sparsemor.core.analysis.charts.surface_fields import DEFAULT_FIELDS, NAMES, surface_figures
from sparsemor.core.analysis.charts.time_histories import (
    angles_figure,
    contact_forces_figure,
    moving_bodies,
    positions_figure,
    probe_displacement_figure,
    probe_temperature_figure,
)
from sparsemor.core.analysis.charts.work_precision import WorkPoint, work_precision_figure
from sparsemor.core.errors import InputError
from sparsemor.core.results.stress import Field

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.core.results.error_norms import Errors
    from sparsemor.core.results.run_result import RunResult

FORMATS = ("png", "svg")
Report = Callable[[Path], None]
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


def silent(path: Path) -> None:
    """Reports nothing."""


class Compared(Protocol):
    """Comparison of runs with a reference, as the charts need it (`core.analysis.compare`)."""

    @property
    def reference(self) -> "RunResult": ...
    @property
    def runs(self) -> "Mapping[str, RunResult]": ...
    @property
    def measured(self) -> "Mapping[str, Errors]": ...
    @property
    def name(self) -> str: ...
    @property
    def limit(self) -> float: ...
    @property
    def trained_to(self) -> float: ...
    def work_points(self) -> tuple[list[WorkPoint], WorkPoint]: ...
    def work_notes(self) -> Sequence[str]: ...


def write_charts(
    comparison: Compared, folder: Path, times: Sequence[float] | None = None,
    formats: Sequence[str] = FORMATS, report: Report = silent,
) -> list[Path]:
    """Writes all charts that apply to a comparison of runs; returns their paths.

    times: times at which the deformed bodies are drawn, s; formats: file formats; report: called
    with the path of each file when it is written.
    """
    def figures() -> Figures:
        reference, runs, name = comparison.reference, comparison.runs, comparison.name
        kinds, limit = reference.layout.kinds, comparison.limit
        yield from _of_reference(reference, times, alike(reference, runs), name)
        yield "angles", angles_figure(reference, runs, name)
        yield "error_over_time", error_over_time_figure(
            comparison.measured, {n: run.status for n, run in runs.items()}, kinds, limit,
            comparison.trained_to)
        yield "work_precision", work_precision_figure(
            *comparison.work_points(), kinds, limit, comparison.work_notes())
        for label, run in runs.items():
            yield _atoms_file(label), active_atoms_figure(run, label)

    return _save_all(figures(), folder, formats, report)


def write_run_charts(
    run: "RunResult", folder: Path, times: Sequence[float] | None = None,
    formats: Sequence[str] = FORMATS, fields: Sequence[Field] = DEFAULT_FIELDS,
    report: Report = silent,
) -> list[Path]:
    """Writes all charts that apply to a single run (no errors, no costs); fields: those that colour
    the bodies; other arguments as in `write_charts`. InputError for a field that no body has."""
    absent = [f.value for f in fields if f not in DEFAULT_FIELDS and not any(
        run.has(body, f) for body in run.bodies)]
    if absent:
        raise InputError(f"no body of this run has {absent[0]}", "fields")

    def figures() -> Figures:
        yield from _of_reference(run, times, fields=fields)
        yield "angles", angles_figure(run, {}, run.reducer)
        yield "active_atoms", active_atoms_figure(run, run.reducer)

    return _save_all(figures(), folder, formats, report)


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


def alike(reference: "RunResult", runs: "Mapping[str, RunResult]") -> "dict[str, RunResult]":
    """Runs whose fields can be drawn next to those of the reference: with the same bodies and
    meshes."""
    return {name: run for name, run in runs.items() if len(run.times) and all(
        body in run.bodies and run.points(body).shape == reference.points(body).shape
        for body in reference.bodies)}


def _save_all(
    figures: Figures, folder: Path, formats: Sequence[str], report: Report
) -> list[Path]:
    files = []
    for name, figure in figures:
        if figure is not None:
            for path in saved(figure, folder, name, formats):
                report(path)
                files.append(path)
    return files


__all__ = [
    "DEFAULT_FIELDS", "FORMATS", "NAMES", "WorkPoint", "active_atoms_figure", "alike",
    "angles_figure", "contact_forces_figure",
    "deformation_figure", "error_over_time_figure", "joint_forces_figure", "positions_figure",
    "probe_displacement_figure", "probe_temperature_figure", "surface_figures",
    "usual_files", "work_precision_figure", "write_charts", "write_run_charts",
]
