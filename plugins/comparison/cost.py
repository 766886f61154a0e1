"""Cost of a run: computing times, iterations, basis vectors (atoms), sampled rows, the work of its
linear solvers; its wall-clock gain over full order, and the number of runs after which its offline
time has paid off (break-even)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sparsemor.core.results.run_result import RunResult
from sparsemor.core.status import Status
from sparsemor.plugins.publishing.tables import number, text_table


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Cost of one run; None for quantities that were not recorded.

    ms_per_step: online time, writing included, divided by the number of steps; ms_per_step_solver:
    median time of the step solver alone; iterations: mean per step; offline_seconds: offline time
    of this run; offline_whole_seconds: offline time with an empty cache; online_seconds: online
    time of the run; atoms: number of trial basis vectors (atoms); active_atoms: mean number of
    active ones; rows: number of sampled rows; end: last stored time, s; linear_solvers: linear
    solvers of the steps, by block, as text; peak_gb: peak memory of the process.
    """

    reducer: str
    status: Status
    steps: int
    ms_per_step: float | None
    offline_seconds: float | None
    offline_whole_seconds: float | None
    online_seconds: float | None
    iterations: float | None
    atoms: int
    active_atoms: float
    rows: int
    end: float = 0.0
    linear_solvers: str = ""
    peak_gb: float | None = None
    ms_per_step_solver: float | None = None

    @property
    def atoms_text(self) -> str:
        return f"{self.active_atoms:.3g}/{self.atoms}" if self.atoms else "-"

    def as_dict(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__} | {
            "status": self.status.value}


def run_facts(run: RunResult) -> RunFacts:
    """Cost of a run, from the summary at its end, or from the stored steps where there is no
    summary."""
    summary = run.summary
    stepped = np.flatnonzero(run.step_seconds > 0.0)
    steps = int(summary.get("steps", stepped.size))
    wall = summary.get("wall_s", {})
    solver: float | None = summary.get("ms_per_step_solver")
    if solver is None and stepped.size:
        solver = 1e3 * float(np.median(run.step_seconds[stepped]))
    reduced = [b.name for b in run.layout if b.name in run.solver_layout and run.reduced(b.name)]
    return RunFacts(reducer=run.reducer, status=run.status, steps=steps,
        ms_per_step=summary.get("ms_per_step"), offline_seconds=wall.get("offline"),
        offline_whole_seconds=summary.get("offline_whole_s", wall.get("offline")),
        online_seconds=wall.get("online"),
        iterations=float(run.iterations[stepped].mean()) if stepped.size else None,
        atoms=sum(run.support(name).shape[1] for name in reduced),
        active_atoms=float(sum(run.support(name).sum(axis=1).mean() for name in reduced))
        if len(run.times) else 0.0, rows=sum(run.rows(b.name).size for b in run.layout),
        end=float(run.times[-1]) if len(run.times) else 0.0,
        linear_solvers="; ".join(solvers_in_words(summary.get("linear_solvers", ()))),
        peak_gb=summary.get("memory", {}).get("peak_gb"), ms_per_step_solver=solver)


def solvers_in_words(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Text lines such as `disk.elastic: amg, 5.2 iterations/step, 0.12 GB` for the linear solvers
    of the steps."""
    lines = []
    for e in entries:
        if e["for"] == "steps":
            count = e.get("iterations_a_step")
            iterations = "" if count is None else f", {count:.3g} iterations/step"
            lines.append(f"{e['block']}: {e['solver']}{iterations}, {e['memory_gb']:.2g} GB")
    return lines


# ------------------------------------------------------------------ gain over full order


class Gain(NamedTuple):
    """Wall-clock time of the reference over that of a run: once, with the preparation (with an
    empty cache); again: of its steps alone, as a further run of a kept model has."""

    once: float
    again: float


def gains(facts: Mapping[str, RunFacts], base: str) -> dict[str, Gain]:
    """Run -> gain over the run `base`, for runs that both reached the same end."""
    full, found = facts[base], {}
    for name, own in facts.items():
        # of the base, then of the run, its offline time with an empty cache
        times = (full.offline_seconds, full.online_seconds, own.offline_whole_seconds,
                 own.online_seconds)
        if name == base or None in times or not (full.status.ok and own.status.ok):
            continue
        offline, online, before, steps = (float(t or 0.0) for t in times)
        # once, with the preparation, and again, of the steps alone
        if steps > 0.0 and abs(full.end - own.end) <= 1e-9 * max(full.end, own.end):
            found[name] = Gain((offline + online) / (before + steps), (offline + online) / steps)
    return found


def gain_table(found: Mapping[str, Gain]) -> str:
    """Text table of gains."""
    return text_table([["wall-clock gain", "with offline", "further runs"], *(
        [name, number(g.once, ".3g"), number(g.again, ".3g")] for name, g in found.items())])


def pays_after(full: RunFacts, own: RunFacts) -> int | None:
    """Break-even number of runs: offline time / (online time of full order - own online time),
    rounded up.

    Number of online runs of the same time span after which the offline time is recovered. The
    offline time is that with an empty cache; otherwise the second run would appear to be free. None
    if the offline time is never recovered, was not recorded, or one of the runs did not reach its
    end.
    """
    offline, online, base = own.offline_whole_seconds, own.online_seconds, full.online_seconds
    if offline is None or online is None or base is None or online >= base:
        return None
    same_span = abs(full.end - own.end) <= 1e-9 * max(full.end, own.end)
    if not (full.status.ok and own.status.ok and same_span):
        return None
    return max(1, math.ceil(offline / (base - online)))
