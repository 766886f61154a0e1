"""Charts of a comparison: errors against computing times and over time."""

from typing import TYPE_CHECKING

from sparsemor.core.analysis.compare import Comparison
from sparsemor.core.analysis.training_span import training_lines
from sparsemor.plugins.charts.error_over_time import error_over_time_figure
from sparsemor.plugins.charts.work_precision import WorkPoint, work_precision_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def work_precision_of(comparison: Comparison) -> "Figure | None":
    """Work-precision chart of a comparison."""
    return work_precision_figure(
        *work_points(comparison), comparison.reference.layout.kinds, comparison.limit,
        work_notes(comparison))


def error_over_time_of(comparison: Comparison) -> "Figure | None":
    """Errors of the runs of a comparison over time."""
    return error_over_time_figure(
        comparison.measured, {name: run.status for name, run in comparison.runs.items()},
        comparison.reference.layout.kinds, comparison.limit, comparison.trained_to)


def work_points(comparison: Comparison) -> tuple[list[WorkPoint], WorkPoint]:
    """Points of the work-precision chart: one per run, and the reference. Errors are those after
    the end of training, if late errors are measured from there."""
    errors = comparison.late_errors if _after_training(comparison) else comparison.errors
    runs = {comparison.name: comparison.reference, **comparison.runs}
    found = {name: WorkPoint(
        name, "", f.ms_per_step, errors.get(name, {}), f.status, f.offline_whole_seconds,
        runs[name].summary.get("stability", {}).get("stable") is not False)
        for name, f in comparison.facts.items()}
    return [found[run] for run in comparison.runs], found[comparison.name]


def work_notes(comparison: Comparison) -> list[str]:
    """Lines below the work-precision chart: training, cost, and runs that failed."""
    late = [f"errors after {comparison.trained_to:.4g} s, the end of training"]
    costs = [f"{name}: wall-clock gain {g.once:.3g} with the offline time, {g.again:.3g} in "
             "further runs"
             for name, g in comparison.gains.items()]
    return [*late * _after_training(comparison),
            *training_lines(comparison.reference, comparison.runs), *costs,
            *comparison.failed_lines()]


def _after_training(comparison: Comparison) -> bool:
    """True if late errors are those after the end of training."""
    end = comparison.trained_to
    return end > 0.0 and any(e.late_from == end for e in comparison.measured.values())
