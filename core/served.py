"""What a run reports of its linear solvers and of its memory."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sparsemor.core.block_solvers import Factored
from sparsemor.core.estimate import Estimate
from sparsemor.core.memory import GIGA, ceiling, peak


@dataclass(frozen=True, slots=True)
class Held:
    """expected: before the first step; offline: bytes at most until then."""

    expected: Estimate | None
    offline: int

    def summary(self) -> dict[str, float]:
        """GB. peak_gb: the most that the process has held since it began; peak_offline_gb: until
        the first step; expected_gb: as told beforehand, at most; available_gb: what it could hold
        when the run ended."""
        told = {} if self.expected is None else {"expected_gb": self.expected.total / GIGA}
        return {"peak_gb": peak() / GIGA, "peak_offline_gb": self.offline / GIGA, **told,
                "available_gb": ceiling() / GIGA}


def solvers_summary(
    log: Iterable[Factored], iterations: Mapping[str, int], steps: int
) -> list[dict[str, Any]]:
    """One entry for each block and purpose; `iterations`: those of the steps, by block."""
    found = []
    for f in log:
        one: dict[str, Any] = {
            "block": f.block, "for": f.purpose, "solver": f.solver, "why": f.note,
            "unknowns": f.unknowns, "factorizations": f.count, "factor_s": f.seconds,
            "memory_gb": f.memory / GIGA}
        if f.purpose == "steps" and f.iterative:
            one["iterations_a_step"] = iterations.get(f.block, 0) / max(steps, 1)
        found.append(one)
    return found


def solvers_in_words(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """`disk.elastic: amg, 5.2 iterations a step, 0.12 GB`, of the steps of this run."""
    lines = []
    for e in entries:
        if e["for"] == "steps":
            count = e.get("iterations_a_step")
            told = "" if count is None else f", {count:.3g} iterations a step"
            lines.append(f"{e['block']}: {e['solver']}{told}, {e['memory_gb']:.2g} GB")
    return lines
