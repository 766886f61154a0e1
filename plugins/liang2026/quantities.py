"""The quantities that an item of a paper file may name: `{use: error, run: a, reference: b}`."""

from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.layout import Quantity as Unknown
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.expressions import Expression
from sparsemor.core.scene.overrides import split as key_parts
from sparsemor.plugins.charts.fields import values_of
from sparsemor.plugins.charts.time_histories import rate_of
from sparsemor.plugins.comparison.cost import run_facts
from sparsemor.plugins.comparison.error_norms import common_steps
from sparsemor.plugins.liang2026.computing_time_split import split_of
from sparsemor.plugins.liang2026.item_functions import (
    Known,
    PaperPart,
    Rows,
    Value,
    errors_of,
    part_of,
)
from sparsemor.plugins.study.jobs import UNCOMPUTED

Moment = float | Literal["end"]
"""Time in s, or the last stored time."""
FieldName = Literal["displacement", "temperature"]
"""Displacement magnitude, m, or temperature, K."""
FIELDS = {"displacement": Unknown.DISPLACEMENT, "temperature": Unknown.TEMPERATURE}
Statistic = Literal["max", "min", "mean", "median", "last", "first"]
_STATISTICS: Mapping[str, Any] = {
    "max": np.max, "min": np.min, "mean": np.mean, "median": np.median,
    "last": lambda v: v[-1], "first": lambda v: v[0]}


def formula(text: str, known: Known) -> Value:
    """Number computed from earlier values of the item, such as `a / b`."""
    number = Expression.parse(text, "number").value(known)
    return float(number) if np.isfinite(number) else None


def error(
    run: RunResult, reference: RunResult, norm: str = "combined",
    over: Literal["run", "start_up", "steady", "steady_present", "last"] = "run",
) -> Value:
    """Maximum error of a run relative to a reference run. norm: `combined`, a field, `body.field`,
    or `angle_rad`; over: all of the run, its first 2 % or the rest, or the last common time."""
    errors = errors_of(reference, run)
    if over == "last":
        return float(errors.series[norm][-1]) if norm in errors.series else None
    found: Mapping[str, float] = getattr(errors, "worst" if over == "run" else over)
    return found.get(norm)


def field(
    run: RunResult, body: str, field: FieldName, at: Moment = "end",
    take: Literal["max", "min"] = "max",
) -> Value:
    """Extreme nodal value of a field of one body at one time."""
    values = values_of(run, body, _step(run, at), FIELDS[field])
    if values is None:
        raise InputError(f"{body} has no {field}")
    return _statistic(take, values)


def rotation(
    run: RunResult, body: str, at: Moment = "end", rate: bool = False, degrees: bool = False,
    minus: RunResult | None = None,
) -> Value:
    """Rotation angle, rad, or with `rate` angular velocity, rad/s, of a body frame; or its largest
    difference from the angle in another run, `minus`, at all times."""
    angle, factor = _angles(run, body), 180.0 / np.pi if degrees else 1.0
    if minus is not None:
        here, there = common_steps(run.times, minus.times)
        return float(factor * np.abs(angle[here] - _angles(minus, body)[there]).max())
    values = rate_of(run.times, angle) if rate else angle
    return float(factor * values[_step(run, at)])


def position(run: RunResult, body: str, axis: Literal[0, 1, 2] = 0, at: Moment = "end") -> Value:
    """Displacement of the origin of a body frame since the start, along x, y or z."""
    return float(run.pose(body, _step(run, at))[axis] - run.pose(body, 0)[axis])


def probe(
    run: RunResult, probe: str, field: FieldName, at: Moment | None = "end",
    take: Statistic = "max",
) -> Value:
    """Value of a probe at one time; with `at: null`, its statistic over time."""
    column = getattr(run.probe_header(probe), field)
    if column is None:
        raise InputError(f"probe {probe} records no {field}")
    found = run.probe(probe)[:, column]
    values = np.linalg.norm(found, axis=1) if field == "displacement" else found
    return _statistic(take, values) if at is None else float(values[_step(run, at)])


def contact(
    run: RunResult, contact: str, quantity: Literal["normal", "friction", "power", "pressure"],
    take: Statistic | Literal["integral"] = "mean",
) -> Value:
    """Statistic over time, or integral, of the normal force, friction (N), friction power (W) or
    maximum pressure (Pa) of a contact, without the initial time."""
    kept = run.contacts()[contact]
    values = kept[quantity][1:]
    if take == "integral":  # implicit Euler: the value at the end of each step
        return float(np.sum(np.diff(kept["time"]) * values))
    return _statistic(take, values)


def cost(
    run: RunResult, what: Literal["online_seconds", "ms_per_step", "ms_per_step_solver", "steps",
                                  "atoms", "rows", "end", "iterations"],
) -> Value:
    """Cost of a run."""
    found: Value = run_facts(run).as_dict()[what]
    return found


def split(run: RunResult, part: Literal["matrix", "update", "overall"]) -> Value:
    """Part of the processor time of a run's time loop, s: that of the profiled pass, for all steps
    of the run. `matrix`: solution of linear systems and least-squares problems, products with
    precomputed inverses and selection included; `update`: everything else."""
    shares = split_of(run.path.parent)
    overall = shares["seconds"] / shares["steps"] * run_facts(run).steps
    return overall if part == "overall" else overall * shares[part]


def status(run: RunResult) -> Value:
    """Final status of a run: `done`, or why it stopped."""
    return run.status.value


def summary(run: RunResult, path: list[str]) -> Value:
    """Entry of a run's summary; path: keys from the outside to the inside."""
    found: Value = _inside(run.summary, path)
    return found


def parameter(run: RunResult, key: str) -> Value:
    """Option of the scene of a run, such as `bodies.link1.material.E`."""
    found = _inside(run.scene, key_parts(key))
    return found if isinstance(found, str | bool) else float(found)


def mesh(run: RunResult, body: str, what: Literal["elements", "nodes"] | FieldName) -> Value:
    """Number of elements or nodes of a body, or of unknowns of one of its fields."""
    if what in FIELDS:
        block = run.layout.of(body, FIELDS[what])
        return None if block is None else block.size
    return len(run.cells(body) if what == "elements" else run.points(body))


def active(
    run: RunResult, block: str,
    what: Literal["active", "atoms", "changes", "exchanged", "highest"],
) -> Value:
    """Mean number of active basis vectors (atoms) of a block; number of atoms; steps at which the
    selection changes; mean share of active atoms that is exchanged per step; highest number of an
    active atom."""
    selected = run.support(block)[1:]  # nothing is selected at the start
    count = float(selected.sum(axis=1).mean())
    found: Mapping[str, float] = {
        "active": count, "atoms": selected.shape[1],
        "changes": int(np.any(selected[1:] != selected[:-1], axis=1).sum()),
        "exchanged": float((selected[:-1] & ~selected[1:]).sum(axis=1).mean() / count),
        "highest": int(np.flatnonzero(selected.any(axis=0)).max()) + 1}
    return found[what]


def study(
    study: Rows, column: str, where: dict[str, Any] = {},  # noqa: B006 (never changed)
    take: Literal["max", "min", "median", "mean"] = "max",
) -> Value:
    """Statistic of one column over the rows of a study, such as seeds, that have the values
    `where`, by column."""
    rows = [row for row in study if all(row.get(k) == v for k, v in where.items())]
    if not rows:
        raise InputError(f"no row with {where}")
    broken = [str(row.get("message")) for row in rows if row.get("status") in UNCOMPUTED]
    if broken:
        raise InputError(broken[0])
    found = [row.get(column) for row in rows]
    if len(found) == 1 and isinstance(found[0], str):
        return found[0]
    numbers = [v for v in found if v is not None]
    return _statistic(take, numbers) if numbers else None


if TYPE_CHECKING:
    Quantity: TypeAlias = PaperPart
else:
    Quantity = Annotated[reduce(or_, (part_of(f, "use") for f in (
        formula, error, field, rotation, position, probe, contact, cost, split, status, summary,
        parameter, mesh, active, study))), Field(discriminator="use")]


def _step(run: RunResult, at: Moment) -> int:
    """Index of the stored step closest to a time. Raises InputError outside the run."""
    return len(run.times) - 1 if at == "end" else int(run.steps_at([float(at)])[0])


def _statistic(name: str, values: Any) -> float:
    return float(_STATISTICS[name](values))


def _angles(run: RunResult, body: str) -> FloatArray:
    """(j,) rotation angle of a body's frame at the stored times, rad."""
    frame = run.layout.of(body, Unknown.POSE)
    if frame is not None:
        return run.block(frame.name)[:, -1]
    return np.array([run.pose(body, step)[-1] for step in range(len(run.times))])


def _inside(found: Any, path: Any) -> Any:
    for key in path:
        if not isinstance(found, Mapping) or key not in found:
            raise InputError(f"no entry {'.'.join(map(str, path))}")
        found = found[key]
    return found
