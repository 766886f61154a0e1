"""Work-precision chart of a comparison: its points, and the notes below it."""

from sparsemor.plugins.charts.work_precision import WorkPoint
from sparsemor.plugins.comparison.compare import Comparison
from sparsemor.plugins.comparison.training_span import training_lines


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
