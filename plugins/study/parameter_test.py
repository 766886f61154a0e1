"""Test of a reduced model at random parameters that its training has not seen: errors against
full-order runs, times, and the break-even number of runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, inf
from typing import Any

import numpy as np

from sparsemor.core.errors import InputError, check_count
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.default_plugins import FULL_ORDER
from sparsemor.core.scene.html import html_text
from sparsemor.core.scene.parameters_and_training_points import uniform, values_at
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.comparison.error_norms import measure_errors, measure_names
from sparsemor.plugins.kept_models.reduced_model import ReducedModel, reduce
from sparsemor.plugins.publishing.tables import csv_table, marked, number, text_table, with_head
from sparsemor.plugins.study.jobs import cached_reference

Row = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ParameterTest:
    """Errors of a reduced model at random parameters; `str()` returns a table of the worst ones.

    rows: one per run, with its parameters, number of unknowns, status, errors (largest over time,
    `error_` and the name of a block or field), wall times (s) and kinds of warnings; a list of
    plain dictionaries, from which pandas makes a table. parameters: their names; measures: errors
    of the table (combined, fields, angle). offline_seconds: wall time of preparing the model, s,
    without any cache.
    """

    rows: Sequence[Row]
    parameters: tuple[str, ...]
    measures: tuple[str, ...]
    offline_seconds: float

    @property
    def worst(self) -> dict[str, float]:
        """Field, `combined` or `angle_rad` -> largest error of any run of the whole model; infinite
        if a run failed."""
        return self._worst(self._largest_model)

    @property
    def break_even(self) -> int | None:
        """Number of runs, each with everything that it includes, after which preparing the model
        and running it took less wall time than as many full-order runs; None if it never does."""
        full, reduced = self._mean("full_s"), self._mean("reduced_s")
        return max(1, ceil(self.offline_seconds / (full - reduced))) if reduced < full else None

    def __str__(self) -> str:
        """Table of the largest errors over the runs, a line for each number of unknowns; mean times
        of the largest model, and the break-even number of runs."""
        table = [["unknowns", "runs", "failed", *(m.replace("_", " ") for m in self.measures)]]
        for size in dict.fromkeys(r["unknowns"] for r in self.rows):
            mine = [r for r in self.rows if r["unknowns"] == size]
            failed = sum(r["status"] != "done" for r in mine)
            worst = self._worst(mine)
            table.append([str(size), str(len(mine)), str(failed),
                          *(marked(worst[m], ".2e", LIMIT) for m in self.measures)])
        return "\n".join([
            "worst error over the runs", text_table(table), "",
            f"full order {self._mean('full_s'):.3g} s per run, reduced "
            f"{self._mean('reduced_s'):.3g} s, prepared in {self.offline_seconds:.3g} s: pays "
            f"after {number(self.break_even, 'd')} runs"])

    def __repr__(self) -> str:
        return f"<ParameterTest of {len(self.rows)} runs: " + ", ".join(
            f"{m} {e:.1e}" for m, e in self.worst.items()) + ">"

    def _repr_html_(self) -> str:
        """The table, for notebooks."""
        return html_text(str(self))

    def to_csv(self) -> str:
        """CSV text of the rows."""
        return csv_table(with_head(self.rows))

    @property
    def _largest_model(self) -> Sequence[Row]:
        most = max(r["unknowns"] for r in self.rows)
        return [r for r in self.rows if r["unknowns"] == most]

    def _worst(self, rows: Sequence[Row]) -> dict[str, float]:
        return {m: max(float(r[f"error_{m}"]) for r in rows) for m in self.measures}

    def _mean(self, column: str) -> float:
        return float(np.mean([r[column] for r in self._largest_model]))


def parameter_test(
    model: ReducedModel | Scene, count: int = 50, *, seed: int = 1, sizes: Sequence[int] = (),
    progress: Callable[[int, int], None] | None = None,
) -> ParameterTest:
    """Errors of a reduced model at `count` points, uniformly distributed over the box of the
    parameters of its scene.

    model: a reduced model, or a scene of which one is made; seed: of the points, other than that of
    training; sizes: also for the models of so many first atoms of each block; progress: called with
    the number of runs done and of all. Full-order runs are kept in the cache, shared with studies.
    Raises InputError for a scene without parameters and for wrong numbers, SolveFailed if a
    full-order run fails.
    """
    check_count(count, "count")
    check_count(seed, "seed", least=0)
    for size in sizes:
        check_count(size, "sizes")
    made = reduce(model) if isinstance(model, Scene) else model
    scene = made.scene
    if not scene.parameters:
        raise InputError("the scene declares no parameters", "parameters")
    # bodies are assembled once for all points; each run has a model of its own
    bodies, rows, names = BodyCache(), [], dict[str, None]()
    for done, point in enumerate(uniform(scene.parameters, count, seed)):
        _, full = cached_reference(
            scene.using({**values_at(point), "reducer": FULL_ORDER}), body_cache=bodies.of_bodies())
        if not full.status.ok:
            raise SolveFailed(full.status, float(full.times[-1]), "", "full order")
        for atoms in (None, *sizes):
            run, unknowns = _run(made, point, atoms)
            errors = measure_errors(full, run).worst if run.status.ok else {}
            names |= dict.fromkeys(f"error_{m}" for m in errors)
            rows.append({
                "run": done + 1, **point, "unknowns": unknowns, "status": run.status.value,
                **{f"error_{m}": e for m, e in errors.items()},
                "full_s": _seconds(full), "reduced_s": _seconds(run),
                "warnings": " ".join(run.summary.get("note_kinds", ()))})
        if progress is not None:
            progress(done + 1, count)
    for row, name in product(rows, names):  # of a run that failed
        row.setdefault(name, inf)
    measures = tuple(m for m in measure_names(full.layout.kinds) if f"error_{m}" in names)
    return ParameterTest(rows, tuple(scene.parameters), measures, made.offline_seconds)


def _run(
    model: ReducedModel, point: Mapping[str, float], atoms: int | None
) -> tuple[RunResult, int]:
    """Result at a point, also of a run that failed, and the number of unknowns."""
    chosen = model if atoms is None else model.at(point, atoms)
    try:
        return chosen.run(parameters=point), chosen.size
    except SolveFailed as error:
        if not isinstance(error.result, RunResult):
            raise
        return error.result, chosen.size


def _seconds(run: RunResult) -> float:
    """Wall time of a run with everything that it includes, as without a cache."""
    summary = run.summary
    return float(summary["offline_whole_s"] + summary["wall_s"]["online"])
