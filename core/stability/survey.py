"""How many seeds of each variant of a scene are stable: the table behind `sparsemor stability`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from sparsemor.core.cache import Cache
from sparsemor.core.checks import checked_model, time_faults
from sparsemor.core.errors import InputError
from sparsemor.core.hooks import new_manager
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline, step_count
from sparsemor.core.prepared import prepared
from sparsemor.core.protocols import State, StepSolver
from sparsemor.core.scene import Scene
from sparsemor.core.stability.check import (
    LIMIT,
    Judgement,
    Reference,
    failed,
    judged,
    over_the_run,
)
from sparsemor.core.stability.departure import Departure, departure, exact_values, own_radii
from sparsemor.core.stability.differences import step_map
from sparsemor.core.stability.plan import Plan, Variant, variants
from sparsemor.core.stability.reference import (
    along,
    course,
    course_times,
    projected,
    started,
    times_checked,
)
from sparsemor.core.status import SolveFailed
from sparsemor.core.text_table import text_table
from sparsemor.core.threads import fixed_threads

UNKNOWN = Departure(None, None, None, None)


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """One seed of one variant: the worst of its linearisations. own: radius of each field's own
    map there; missed: loads and joints that no row of a block feels."""

    seed: int
    judgement: Judgement
    departure: Departure
    own: Mapping[str, float]
    missed: int

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers; None for what is infinite or not known."""
        j, d = self.judgement, self.departure
        numbers = {"radius": j.radius, "reference": j.reference, "growth": j.growth,
                   "gate": j.gate}
        known = {k: v if v is not None and isfinite(v) else None for k, v in numbers.items()}
        return {"seed": self.seed, "stable": j.stable, **known, "block": j.block, "t": j.t,
                "status": j.status.value, "missed": self.missed, "departure": d.projected,
                "departure_elastic": d.elastic, "departure_thermal": d.thermal,
                "imaginary": d.imaginary, "own": dict(self.own)}


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One variant over its seeds."""

    settings: Mapping[str, str]
    findings: Sequence[Finding]

    @property
    def stable(self) -> int:
        return sum(f.judgement.stable for f in self.findings)

    @property
    def radii(self) -> list[float]:
        return sorted(f.judgement.radius for f in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Settings and sums over the seeds."""
        gates = [f.judgement.gate for f in self.findings]
        numbers = {"median_radius": _median(self.radii), "worst_radius": max(self.radii),
                   "median_gate": _median(gates), "worst_gate": max(gates)}
        return {
            **self.settings, "stable": self.stable, "seeds": len(self.findings),
            **{k: v if isfinite(v) else None for k, v in numbers.items()},
            "departure": _worst(f.departure.projected for f in self.findings),
            "departure_elastic": _worst(f.departure.elastic for f in self.findings),
            "departure_thermal": _worst(f.departure.thermal for f in self.findings),
            "imaginary": _worst(f.departure.imaginary for f in self.findings),
            "missed": sum(f.missed > 0 for f in self.findings)}


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """The table; `str()` prints it with the least rows that are stable for all seeds."""

    entries: Sequence[Entry]

    def least_rows(self) -> list[dict[str, str]]:
        """For each combination of the other settings: the fewest rows from which on every asked
        number of rows is stable for all seeds ("none" if not even the most)."""
        groups: dict[tuple[str, ...], list[Entry]] = {}
        for e in self.entries:
            groups.setdefault(tuple(v for k, v in e.settings.items() if k != "rows"), []).append(e)
        found = []
        for entries in groups.values():
            least = "none"
            for e in sorted(entries, key=lambda e: _numbers(e.settings["rows"]), reverse=True):
                if e.stable < len(e.findings):
                    break
                least = e.settings["rows"]
            found.append({**entries[0].settings, "rows": least})
        return found

    def __str__(self) -> str:
        head = ["sampler", "required", "rows", "atoms", "integrator", "step", "stable",
                "median radius", "worst radius", "worst gate", "departure", "imaginary", "missed"]
        table = [head]
        for e in self.entries:
            d = e.as_dict()
            table.append([*e.settings.values(), f"{d['stable']}/{d['seeds']}",
                          _text(d["median_radius"], ".6f"), _text(d["worst_radius"], ".6f"),
                          _text(d["worst_gate"], ".3g"), _text(d["departure"], ".2g", "-"),
                          _text(d["imaginary"], ".2g", "-"), str(d["missed"])])
        lines = [text_table(table), ""]
        for least in self.least_rows():
            rows = least.pop("rows")
            if rows != "-":
                lines.append(f"least rows stable for all seeds: {rows}  ("
                             f"{', '.join(v for v in least.values() if v != '-')})")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        return {"limit": LIMIT, "least_rows": self.least_rows(), "variants": [
            e.as_dict() | {"each": [f.as_dict() for f in e.findings]} for e in self.entries]}


@fixed_threads()
def survey(
    scene: Scene, plan: Plan, *, cache: Cache | None = None, observers: Sequence[object] = (),
    told: Callable[[Entry], None] = lambda entry: None,
) -> Survey:
    """Linearise every seed of every variant. `told` hears each line as it is done.

    Training runs and bases come from the cache, one for each integrator and step. Raises
    InputError before anything is computed, SolveFailed where a training run fails.
    """
    chosen = list(variants(scene, plan))
    model = checked_model(scene)
    for v in chosen:
        _refuse(v, model, plan)
    manager = new_manager(observers)
    cases: dict[str, _Case] = {}
    entries = []
    with np.errstate(all="ignore"):
        for v in chosen:
            key = v.scene.digest("integrator", "time")
            if key not in cases:
                cases[key] = _Case.of(v.scene, *prepared(v.scene, cache or Cache(), manager), plan)
            entry = Entry(v.settings, [
                _finding(v.scene, cases[key], seed) for seed in range(1, plan.seeds + 1)])
            told(entry)
            entries.append(entry)
    return Survey(entries)


def _refuse(v: Variant, model: Model, plan: Plan) -> None:
    faults = time_faults(v.scene)
    check = getattr(v.scene.reducer, "check", None)
    if check is not None:
        faults += InputError(list(check(model))).under("reducer").faults
    if faults:
        raise InputError(faults)
    if v.scene.dump()["reducer"]["use"] == "full":
        raise InputError("full order is what reduced models are judged by: name another one",
                         "reducer")
    try:
        times_checked(plan.at or (), v.scene.time.step, v.scene.time.end)
    except InputError as error:
        raise InputError(f"--at: {error.faults[0].message}") from None


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """What the variants of one integrator and step share: the model (whose rigid stage they take
    part in), its offline products, and where and by what they are judged."""

    model: Model
    offline: Offline
    states: Sequence[State]
    reference: Reference
    exact: Mapping[str, Any]

    @classmethod
    def of(cls, scene: Scene, model: Model, offline: Offline, plan: Plan) -> "_Case":
        return cls(model, offline, _states(scene, model, offline, plan.at),
                   Reference(model, scene.source.registry), exact_values(model))


def _states(
    scene: Scene, model: Model, offline: Offline, times: Sequence[float] | None
) -> list[State]:
    """Where to linearise: on the run of the projected model with the scene's atoms."""
    start, h, integrator = consistent_state(model), scene.time.step, scene.integrator
    if times is not None and not any(times):
        return [start] * len(times)
    solver = scene.reducer.prepare(
        model, integrator, h, offline, np.random.default_rng(scene.seed))
    known = scene.source.registry
    if times is None:
        due = course_times(h, step_count(scene))
        return course(model, integrator, h, solver, start, due, known)
    twin = projected(model, integrator, h, solver, {}, known)
    return along(twin, integrator, h, start, times)


def _finding(scene: Scene, case: _Case, seed: int) -> Finding:
    """The worst of one seed's linearisations, with the growth over all of them."""
    h, integrator, steps = scene.time.step, scene.integrator, step_count(scene)
    try:
        solver: StepSolver = scene.reducer.prepare(
            case.model, integrator, h, case.offline, np.random.default_rng(seed))
    except SolveFailed as failure:
        return Finding(seed, failed(0.0, steps, failure), UNKNOWN, {}, 0)
    found = []
    for full in case.states:
        try:
            step = step_map(solver, integrator, h, *started(solver, integrator, full))
        except SolveFailed as failure:
            return Finding(seed, failed(full.t, steps, failure), UNKNOWN, {}, _unsampled(solver))
        theirs = case.reference.step(step, integrator, h, full)
        found.append(Finding(seed, judged(step, theirs, full.t, steps),
                             departure(step, theirs, case.exact), own_radii(step),
                             _unsampled(solver)))
    worst = max(found, key=lambda f: f.judgement.excess)
    return replace(worst, judgement=over_the_run([f.judgement for f in found]))


def _unsampled(solver: StepSolver) -> int:
    """Number of loads and joints with no sampled row in a block they act on."""
    return sum(note.kind == "unsampled" for note in solver.notes)


def _numbers(rows: str) -> tuple[int, ...]:
    return tuple(int(n) if n.isdigit() else 0 for n in rows.split("/"))


def _median(values: Sequence[float]) -> float:
    ordered = sorted(values)
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else 0.5 * (ordered[middle - 1] + ordered[middle])


def _worst(values: Any) -> float | None:
    return max((v for v in values if v is not None), default=None)


def _text(value: float | None, form: str, missing: str = "no step") -> str:
    return missing if value is None else format(value, form)


