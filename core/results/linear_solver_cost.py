"""Work of the linear solvers of a run, by block."""

from collections.abc import Iterable, Mapping
from typing import Any

from sparsemor.core.model.factorizations import Factored


def solvers_summary(
    log: Iterable[Factored], iterations: Mapping[str, int], steps: int
) -> list[dict[str, Any]]:
    """Report of the linear solvers: one entry per block and purpose.

    log: factorizations of the run; iterations: block -> total number of iterations in all steps;
    steps: number of steps.
    """
    found = []
    for f in log:
        one: dict[str, Any] = {
            "block": f.block, "for": f.purpose, "solver": f.solver, "why": f.note,
            "unknowns": f.unknowns, "factorizations": f.count, "factor_s": f.seconds,
            "memory_gb": f.memory / 1e9}
        if f.purpose == "steps" and f.iterative:
            one["iterations_a_step"] = iterations.get(f.block, 0) / max(steps, 1)
        found.append(one)
    return found
