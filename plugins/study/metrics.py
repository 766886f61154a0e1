"""Errors, cost and counts of one run, as columns of a study's table."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sparsemor.core.analysis.break_even import pays_after
from sparsemor.core.errors import InputError
from sparsemor.core.results.cost import RunFacts, run_facts
from sparsemor.core.results.error_norms import Errors, measure_errors, measure_names
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.study.columns import SERIES
from sparsemor.plugins.study.quantities import QuantityOfInterest

SPANS = 120
NONE: Mapping[str, QuantityOfInterest] = {}


def measured(
    run: RunResult, reference: RunResult | None, errors_from: float, failure: str,
    quantities: Mapping[str, QuantityOfInterest] = NONE, prepared: float | None = None,
) -> dict[str, Any]:
    """Columns of the table for `run`, compared with `reference` unless that is None.

    errors_from: time from which late errors are evaluated, s; failure: reason why the run stopped
    early, "" if it did not; quantities: column -> quantity of interest; prepared: time of the
    preparation of a model that it shares, s, None if it has its own.
    """
    facts, summary = run_facts(run), run.summary
    if prepared is not None:
        facts = replace(facts, offline_whole_seconds=prepared)
    numbers, texts = _numbers(run, quantities)
    found = {} if reference is None else _compared(run, reference, errors_from)
    return {
        "status": facts.status.value,
        **found,
        "message": "; ".join(text for text in (failure, found.get("message"), *texts) if text),
        **numbers,
        "steps": facts.steps,
        "t_end": summary.get("t_end"),
        "iterations": facts.iterations,
        "atoms_all": facts.atoms,
        "atoms_active": facts.active_atoms,
        "rows_sampled": facts.rows,
        "factorizations": summary.get("factorizations"),
        "support_changes": summary.get("support_changes"),
        "elements_touched": sum(summary.get("elements_touched", {}).values()),
        "stable": summary.get("stability", {}).get("stable"),
        "notes": "; ".join(summary.get("notes", ())),
        "facts": summary.get("facts", {}),
        **_cost(run, facts, None if reference is None else run_facts(reference)),
        **({} if prepared is None else {"offline_cache": "shared model"}),
    }


def _numbers(
    run: RunResult, quantities: Mapping[str, QuantityOfInterest]
) -> tuple[dict[str, float | None], list[str]]:
    """Values of the quantities of interest, None where the run has none, and the reasons."""
    found: dict[str, float | None] = {}
    missing = []
    for name, quantity in quantities.items():
        try:
            found[name] = quantity.of(run)
        except InputError as error:
            found[name] = None
            missing.append(f"{name}: {error}")
    return found, missing


def _compared(run: RunResult, reference: RunResult, errors_from: float) -> dict[str, Any]:
    """Columns of a run that compare it with its reference."""
    errors, note, series = _errors(reference, run, errors_from)
    measures = measure_names(reference.layout.kinds)
    constant = [] if series is None else [m for m in measures if m in series.constant]
    return {
        "message": note,
        "reference_status": reference.status.value,
        "above_limit": "" if series is None else " ".join(series.above()),
        **errors,
        SERIES: None if series is None else thinned(series, measures),
        "constant": " ".join(constant),
    }


def _errors(
    reference: RunResult, run: RunResult, errors_from: float
) -> tuple[dict[str, float | None], str, Errors | None]:
    try:
        errors = measure_errors(reference, run, errors_from)
    except InputError as error:
        return {}, f"not measured: {error}", None
    if errors.until <= float(reference.times[0]):
        return {}, "", None  # it stopped in its first step: at the start all runs are right
    measures = measure_names(reference.layout.kinds)
    found = {f"error_{m}": errors.worst.get(m) for m in measures}
    if errors_from > 0.0:
        found |= {f"late_{m}": errors.worst_late.get(m) for m in measures}
    for when, worst in (("start_up", errors.start_up), ("steady", errors.steady)):
        found |= {f"{when}_{m}": worst.get(m) for m in measures}
    return found, "", errors


def thinned(errors: Errors, measures: Iterable[str]) -> dict[str, list[float]]:
    """Errors over time reduced to at most 120 points: the maximum in each of intervals of growing
    length, which start as single steps. `time` (s): end of each interval."""
    count = len(errors.times)
    ends = np.unique(np.geomspace(1, max(count - 1, 1), SPANS).round().astype(np.int64))
    ends = ends[ends < count]
    found = {"time": errors.times[ends]}
    for m in measures:
        if m in errors.series:
            spans = np.maximum.reduceat(errors.series[m], np.append(1, ends[:-1] + 1))
            found[m] = spans
    return {name: [float(f"{v:.4g}") for v in values] for name, values in found.items()}


def _cost(run: RunResult, facts: RunFacts, base: RunFacts | None) -> dict[str, Any]:
    """Cost columns. offline_s: offline time of this run; offline_total_s: with an empty cache;
    pays_after: number of online runs after which the latter is recovered."""
    ms, used = facts.ms_per_step, run.summary.get("cache", {})
    base_ms = None if base is None else base.ms_per_step
    return {
        "ms_per_step": ms,
        "reference_ms_per_step": base_ms,
        "speed_up": base_ms / ms if ms and base_ms else None,
        "offline_s": facts.offline_seconds,
        "offline_total_s": facts.offline_whole_seconds,
        "offline_cache": ", ".join(f"{k} {how}" for k, how in used.items()),
        "online_s": facts.online_seconds,
        "pays_after": None if base is None else pays_after(base, facts),
        "ms_per_step_solver": facts.ms_per_step_solver,
    }

