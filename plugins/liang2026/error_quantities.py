"""Errors of runs relative to a reference, and statistics of the tables of studies."""

from collections.abc import Mapping
from typing import Any, Literal

from sparsemor.core.analysis.study.jobs import BROKEN, DIED, REFUSED
from sparsemor.core.errors import InputError
from sparsemor.core.results.error_norms import Errors
from sparsemor.plugins.liang2026.measure import Measure, OfRun, Results, statistic
from sparsemor.plugins.liang2026.rules import Operand

UNCOMPUTED = (REFUSED, BROKEN, DIED)
"""Statuses of rows of a study that are no results."""


class Error(OfRun):
    """Maximum error of a run relative to a reference run."""

    use: Literal["error"]
    reference: str
    """Run that is the reference."""
    norm: str = "combined"
    """`combined`, a field, `body.field`, or `angle_rad`."""
    over: Literal["run", "start_up", "steady", "steady_present", "last"] = "run"
    """Part of the run: all of it, its first 2 % or the rest, or the last common time."""

    def runs(self) -> tuple[str, ...]:
        return (self.run, self.reference)

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        return self._of(results.errors(self.reference, self.run)).get(self.norm)

    def _of(self, errors: Errors) -> Mapping[str, float]:
        if self.over == "last":
            return {name: float(e[-1]) for name, e in errors.series.items()}
        found: Mapping[str, Mapping[str, float]] = {
            "run": errors.worst, "start_up": errors.start_up, "steady": errors.steady,
            "steady_present": errors.steady_present}
        return found[self.over]


class StudyValue(Measure):
    """Statistic of one column over some rows of a study's table."""

    use: Literal["study"]
    study: str
    """Name of the study."""
    where: dict[str, Any] = {}
    """Column -> value that the rows must have."""
    column: str
    """Column."""
    take: Literal["max", "min", "median", "mean"] = "max"
    """Statistic over the rows, such as seeds."""

    def studies(self) -> tuple[str, ...]:
        return (self.study,)

    def rows(self) -> tuple[Mapping[str, Any], ...]:
        return (self.where,)

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        rows = [r for r in results.rows(self.study)
                if all(r.get(k) == v for k, v in self.where.items())]
        if not rows:
            raise InputError(f"study {self.study} has no row with {self.where}")
        broken = [str(r.get("message")) for r in rows if r.get("status") in UNCOMPUTED]
        if broken:
            raise InputError(f"study {self.study}: {broken[0]}")
        found = [r.get(self.column) for r in rows]
        if len(found) == 1 and isinstance(found[0], str):
            return found[0]
        numbers = [v for v in found if v is not None]
        return statistic(self.take, numbers) if numbers else None
