"""Span of time on which compared runs were trained."""

from collections.abc import Iterable, Mapping

from sparsemor.core.results.run_result import RunResult


def trained_to(run: RunResult) -> float | None:
    """End of the training run of a run, s; None if it had none."""
    found = run.summary.get("trained_to")
    return None if found is None else float(found)


def end_of_training(reference: RunResult, runs: Iterable[RunResult]) -> float:
    """Latest end of the training of the runs, s, if it is before the end of the reference; else
    0."""
    last = max((t for run in runs if (t := trained_to(run)) is not None), default=0.0)
    return last if len(reference.times) and last < reference.times[-1] * (1 - 1e-9) else 0.0


def training_lines(reference: RunResult, runs: Mapping[str, RunResult]) -> list[str]:
    """Sentences on the runs that were trained, by the end of their training: on the run that is
    compared, its beginning, or another run."""
    # end of training, and True if it was another run -> names
    groups: dict[tuple[float, bool], list[str]] = {}
    for name, run in runs.items():
        end = trained_to(run)
        if end is not None:
            changed = set(run.scene.get("training", {}).get("overrides", {})) - {"time.end"}
            groups.setdefault((end, bool(changed)), []).append(name)
    last = float(reference.times[-1]) if len(reference.times) else 0.0
    lines = []
    for (end, other), names in groups.items():
        who = ", ".join(names)
        if other:
            lines.append(f"trained on another run, to {end:.4g} s: {who}")
        elif end < last * (1 - 1e-9):
            lines.append(f"trained to {end:.4g} s of {last:.4g} s: {who}")
        else:
            lines.append(f"errors in training, on the run of which the basis was made: {who}; "
                         "errors of other runs are larger")
    return lines
