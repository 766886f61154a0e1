"""Quantities that a paper's figures and tables report, computed from runs and studies."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from sparsemor.core.analysis.charts.fields import values_of
from sparsemor.core.analysis.charts.time_histories import rate_of
from sparsemor.core.analysis.reproduction.measure import Measure, OfRun, Results
from sparsemor.core.analysis.reproduction.rules import Operand, evaluate
from sparsemor.core.analysis.study.jobs import BROKEN, DIED, REFUSED
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import layout
from sparsemor.core.results.cost import run_facts
from sparsemor.core.results.error_norms import Errors, common_steps
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.overrides import split as key_parts

Moment = float | Literal["end"]
"""Time in s, or the last stored time."""
Statistic = Literal["max", "min", "mean", "median", "last", "first"]
_STATISTICS: Mapping[str, Any] = {
    "max": np.max, "min": np.min, "mean": np.mean, "median": np.median,
    "last": lambda v: v[-1], "first": lambda v: v[0]}
UNCOMPUTED = (REFUSED, BROKEN, DIED)
"""Statuses of rows of a study that are no results."""
FIELDS = {"displacement": layout.Quantity.DISPLACEMENT, "temperature": layout.Quantity.TEMPERATURE}


class Formula(Measure):
    """Number computed from other values of the item."""

    use: Literal["formula"]
    text: str
    """Arithmetic on earlier names, such as `a / b`."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        return evaluate(self.text, known)


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


class FieldValue(OfRun):
    """Extreme nodal value of a field of one body at one time."""

    use: Literal["field"]
    body: str
    """Name of the body."""
    field: Literal["displacement", "temperature"]
    """Displacement magnitude, m, or temperature, K."""
    at: Moment = "end"
    """Time, s."""
    take: Literal["max", "min"] = "max"
    """Extreme over the nodes."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        run = results.run(self.run)
        values = values_of(run, self.body, step_at(run, self.at), FIELDS[self.field])
        if values is None:
            raise InputError(f"{self.body} has no {self.field}")
        return float(_STATISTICS[self.take](values))


class Rotation(OfRun):
    """Rotation angle or angular velocity of a body frame, or its largest difference from that of
    another run."""

    use: Literal["rotation"]
    body: str
    """Name of the body."""
    at: Moment = "end"
    """Time, s; without effect with `minus`."""
    rate: bool = False
    """Angular velocity, rad/s, instead of the angle, rad."""
    degrees: bool = False
    """Angle in degrees."""
    minus: str = ""
    """Run whose angles are subtracted: the largest difference in magnitude is returned."""

    def runs(self) -> tuple[str, ...]:
        return (self.run, self.minus) if self.minus else (self.run,)

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        run = results.run(self.run)
        angle = angles_of(run, self.body)
        factor = 180.0 / np.pi if self.degrees else 1.0
        if self.minus:
            other = results.run(self.minus)
            here, there = common_steps(run.times, other.times)
            difference = angle[here] - angles_of(other, self.body)[there]
            return float(factor * np.abs(difference).max())
        values = rate_of(run.times, angle) if self.rate else angle
        return float(factor * values[step_at(run, self.at)])


class Position(OfRun):
    """Displacement of the origin of a body frame since the start."""

    use: Literal["position"]
    body: str
    """Name of the body."""
    axis: Literal[0, 1, 2] = 0
    """Direction: x, y, z."""
    at: Moment = "end"
    """Time, s."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        run = results.run(self.run)
        last = run.pose(self.body, step_at(run, self.at))
        return float(last[self.axis] - run.pose(self.body, 0)[self.axis])


class ProbeValue(OfRun):
    """Value of a probe at one time, or its statistic over time."""

    use: Literal["probe"]
    probe: str
    """Name of the probe."""
    field: Literal["displacement", "temperature"]
    """Displacement magnitude, m, or temperature, K."""
    at: Moment | None = "end"
    """Time, s; null for the statistic."""
    take: Statistic = "max"
    """Statistic over time."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        run = results.run(self.run)
        values = probe_values(run, self.probe, self.field)
        if self.at is not None:
            return float(values[step_at(run, self.at)])
        return float(_STATISTICS[self.take](values))


class ContactValue(OfRun):
    """Statistic over time of a quantity of a contact, without the initial time."""

    use: Literal["contact"]
    contact: str
    """Name of the contact."""
    quantity: Literal["normal", "friction", "power", "pressure"]
    """Normal force, friction (N), friction power (W) or maximum pressure (Pa)."""
    take: Statistic | Literal["integral"] = "mean"
    """Statistic, or the integral over time."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        kept = results.run(self.run).contacts()[self.contact]
        times, values = kept["time"], kept[self.quantity]
        if self.take == "integral":  # implicit Euler: the value at the end of each step
            return float(np.sum(np.diff(times) * values[1:]))
        return float(_STATISTICS[self.take](values[1:]))


class Cost(OfRun):
    """Cost of a run."""

    use: Literal["cost"]
    what: Literal["online_seconds", "ms_per_step", "ms_per_step_solver", "steps", "atoms", "rows",
                  "end", "iterations"]
    """Attribute of the run's cost."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        value: Operand = run_facts(results.run(self.run)).as_dict()[self.what]
        return value


class Split(OfRun):
    """Part of the processor time of a run's time loop, s: that of the profiled pass, for all
    steps of the run."""

    use: Literal["split"]
    part: Literal["matrix", "update", "overall"]
    """`matrix`: solution of linear systems and least-squares problems, products with precomputed
    inverses and selection included; `update`: evaluation of the equations and everything else."""

    def profiled(self) -> tuple[str, ...]:
        return (self.run,)

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        split = results.split(self.run)
        overall = split["seconds"] / split["steps"] * run_facts(results.run(self.run)).steps
        return overall if self.part == "overall" else overall * split[self.part]


class RunStatus(OfRun):
    """Final status of a run: `done`, or why it stopped."""

    use: Literal["status"]

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        return results.run(self.run).status.value


class Summary(OfRun):
    """Entry of a run's summary."""

    use: Literal["summary"]
    path: list[str] = Field(min_length=1)
    """Keys from the outside to the inside."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        found: Operand = _inside(results.run(self.run).summary, self.path)
        return found


class Parameter(OfRun):
    """Option of the scene of a run."""

    use: Literal["parameter"]
    key: str
    """Dotted key, such as `bodies.link1.material.E`."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        found = _inside(results.run(self.run).scene, key_parts(self.key))
        return found if isinstance(found, str | bool) else float(found)


class MeshCount(OfRun):
    """Number of elements or nodes of a body, or of unknowns of one of its fields."""

    use: Literal["mesh"]
    body: str
    """Name of the body."""
    what: Literal["elements", "nodes", "displacement", "temperature"]
    """Entities that are counted."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        run = results.run(self.run)
        if self.what == "elements":
            return len(run.cells(self.body))
        if self.what == "nodes":
            return len(run.points(self.body))
        block = run.layout.of(self.body, FIELDS[self.what])
        return None if block is None else block.size


class ActiveAtoms(OfRun):
    """Statistics of the active basis vectors (atoms) of one block."""

    use: Literal["active"]
    block: str
    """`body.field`."""
    what: Literal["active", "atoms", "changes", "exchanged", "highest"]
    """Mean number of active atoms; number of atoms; steps at which the selection changes; mean
    share of active atoms that is exchanged per step; highest number of an active atom."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        active = results.run(self.run).support(self.block)[1:]  # nothing is selected at the start
        count = float(active.sum(axis=1).mean())
        left = (active[:-1] & ~active[1:]).sum(axis=1)
        found: Mapping[str, float] = {
            "active": count, "atoms": active.shape[1],
            "changes": int(np.any(active[1:] != active[:-1], axis=1).sum()),
            "exchanged": float(left.mean() / count),
            "highest": int(np.flatnonzero(active.any(axis=0)).max()) + 1}
        return found[self.what]


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
        return float(_STATISTICS[self.take](numbers)) if numbers else None


Quantity = Annotated[
    Formula | Error | FieldValue | Rotation | Position | ProbeValue | ContactValue | Cost | Split
    | RunStatus | Summary | Parameter | MeshCount | ActiveAtoms | StudyValue,
    Field(discriminator="use")]
"""A quantity of a paper file: `{use: error, run: a, reference: b}`."""


def step_at(run: RunResult, at: Moment) -> int:
    """Index of the stored step closest to a time. Raises InputError outside the run."""
    return len(run.times) - 1 if at == "end" else int(run.steps_at([float(at)])[0])


def angles_of(run: RunResult, body: str) -> FloatArray:
    """(j,) rotation angle of a body's frame at the stored times, rad."""
    frame = run.layout.of(body, layout.Quantity.POSE)
    if frame is not None:
        return run.block(frame.name)[:, -1]
    return np.array([run.pose(body, step)[-1] for step in range(len(run.times))])


def probe_values(run: RunResult, probe: str, field: str) -> FloatArray:
    """(j,) temperature (K) or displacement magnitude (m) of a probe. Raises InputError if it does
    not record that field."""
    header, values = run.probe_header(probe), run.probe(probe)
    if field == "temperature" and header.temperature is not None:
        return np.asarray(values[:, header.temperature])
    if field == "displacement" and header.displacement is not None:
        return np.asarray(np.linalg.norm(values[:, header.displacement], axis=1))
    raise InputError(f"probe {probe} records no {field}")


def _inside(found: Any, path: Sequence[Any]) -> Any:
    for key in path:
        if not isinstance(found, Mapping) or key not in found:
            raise InputError(f"no entry {'.'.join(map(str, path))}")
        found = found[key]
    return found
