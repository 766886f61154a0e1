"""Training and wall clock of compared runs: the span on which each was trained, and how much faster
a run is with its preparation and without."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from sparsemor.core.results.cost import RunFacts
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.tables import number, text_table


class Gain(NamedTuple):
    """Wall-clock time of the reference over that of a run: once, with the preparation (with an
    empty cache); again: of its steps alone, as a further run of a kept model has."""

    once: float
    again: float


def gains(facts: Mapping[str, RunFacts], base: str) -> dict[str, Gain]:
    """Run -> gain over the run `base`, for runs that both reached the same end."""
    full, found = facts[base], {}
    for name, own in facts.items():
        times = (full.offline_seconds, full.online_seconds, own.offline_whole_seconds,
                 own.online_seconds)
        if name == base or None in times or not (full.status.ok and own.status.ok):
            continue
        offline, online, before, steps = (float(t or 0.0) for t in times)
        if steps > 0.0 and abs(full.end - own.end) <= 1e-9 * max(full.end, own.end):
            found[name] = Gain((offline + online) / (before + steps), (offline + online) / steps)
    return found


def gain_table(found: Mapping[str, Gain]) -> str:
    """Text table of gains."""
    return text_table([["wall-clock gain", "with offline", "further runs"], *(
        [name, number(g.once, ".3g"), number(g.again, ".3g")] for name, g in found.items())])


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
