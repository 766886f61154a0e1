"""Quantities of the state of a run: fields, motion, probes and contact."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from sparsemor.core.analysis.charts.fields import values_of
from sparsemor.core.analysis.charts.time_histories import rate_of
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import layout
from sparsemor.core.results.error_norms import common_steps
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.liang2026.measure import OfRun, Results, Statistic, statistic
from sparsemor.plugins.liang2026.rules import Operand

Moment = float | Literal["end"]
"""Time in s, or the last stored time."""
FIELDS = {"displacement": layout.Quantity.DISPLACEMENT, "temperature": layout.Quantity.TEMPERATURE}


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
        return statistic(self.take, values)


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
        return statistic(self.take, values)


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
        return statistic(self.take, values[1:])


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
