"""Stability survey: number of random seeds for which each variant of a reduced model is stable
(`sparsemor stability`)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from statistics import median
from typing import Any

import numpy as np

from sparsemor.core import ReducedProblem, State, StepSolver
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene
from sparsemor.core.scene.yaml_reader import LocatedError
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.simulation.time_stepping import started
from sparsemor.core.simulation.validation import checked_model, time_faults
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.publishing.tables import number, text_table
from sparsemor.plugins.stability.galerkin_reference import (
    along,
    linearization_times,
    projected,
    states_along,
    times_checked,
)
from sparsemor.plugins.stability.spectrum import (
    EigenvalueErrors,
    eigenvalue_errors,
    eigenvalues,
    exact_values,
    own_radii,
)
from sparsemor.plugins.stability.stability_check import (
    LIMIT,
    Judgement,
    ReferenceModels,
    failed,
    judged,
    over_the_run,
)
from sparsemor.plugins.stability.step_map import step_map
from sparsemor.plugins.stability.variants import SurveyPlan, Variant, variants

UNKNOWN = EigenvalueErrors(None, {}, None)


@dataclass(frozen=True, slots=True, eq=False)
class SeedStability:
    """Stability of one variant with one seed: the worst of its linearisations along the run.

    judgement: spectral radius and growth of the coupled time-step map; departure: eigenvalue
    errors; own: spectral radius of each block or field alone; missed: number of loads and joints
    that act on no sampled row of a block; fields: names of the reducible fields.
    """

    seed: int
    judgement: Judgement
    departure: EigenvalueErrors
    own: Mapping[str, float]
    missed: int
    fields: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers; None for values that are infinite or were not computed."""
        j, d = self.judgement, self.departure
        numbers = {"radius": j.radius, "reference": j.reference, "growth": j.growth,
                   "gate": j.gate}
        finite = {k: v if v is not None and isfinite(v) else None for k, v in numbers.items()}
        return {"seed": self.seed, "stable": j.stable, **finite, "block": j.block, "t": j.t,
                "status": j.status.value, "missed": self.missed, "departure": d.projected,
                **{f"departure_{field}": d.fields.get(field) for field in self.fields},
                "imaginary": d.imaginary, "own": dict(self.own)}


@dataclass(frozen=True, slots=True, eq=False)
class VariantStability:
    """Stability of one variant for all seeds. settings: option -> value, as text; buckled: bodies
    with linear strains beyond their buckling load, for which no variant is stable."""

    settings: Mapping[str, str]
    findings: Sequence[SeedStability]
    buckled: tuple[str, ...] = ()

    @property
    def stable(self) -> int:
        return 0 if self.buckled else sum(f.judgement.stable for f in self.findings)

    @property
    def radii(self) -> list[float]:
        return sorted(f.judgement.radius for f in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Settings, and medians and maxima over the seeds; missed: number of seeds with a load or
        joint that acts on no sampled row."""
        gates = [f.judgement.gate for f in self.findings]
        numbers = {"median_radius": median(self.radii), "worst_radius": max(self.radii),
                   "median_gate": median(gates), "worst_gate": max(gates)}
        return {
            **self.settings, "stable": self.stable, "seeds": len(self.findings),
            **{k: v if isfinite(v) else None for k, v in numbers.items()},
            "departure": _worst(f.departure.projected for f in self.findings),
            **{f"departure_{field}": _worst(f.departure.fields.get(field) for f in self.findings)
               for field in dict.fromkeys(n for f in self.findings for n in f.fields)},
            "imaginary": _worst(f.departure.imaginary for f in self.findings),
            "missed": sum(f.missed > 0 for f in self.findings)}


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Stability of all variants; `str()` returns the table and the smallest numbers of sampled rows
    that are stable for all seeds."""

    entries: Sequence[VariantStability]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on bodies that are unstable whatever the variant."""
        return tuple(dict.fromkeys(text for e in self.entries for text in e.buckled))

    def least_rows(self) -> list[dict[str, str]]:
        """For each combination of the other settings: the smallest number of sampled rows such that
        it and all larger requested numbers are stable for all seeds; "none" if the largest is
        not."""
        groups: dict[tuple[str, ...], list[VariantStability]] = {}
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
        """Table of the variants, a line each, and the smallest stable numbers of sampled rows.
        gate: excess growth exponent of the run; departure: eigenvalue error by the sampled rows;
        imaginary: |Im| / |eigenvalue|; missed: seeds with a load or joint on no sampled row."""
        head = ["sampler", "required", "rows", "atoms", "integrator", "step", "stable",
                "median radius", "worst radius", "worst gate", "departure", "imaginary", "missed"]
        table = [head]
        for e in self.entries:
            d = e.as_dict()
            table.append([*e.settings.values(), f"{d['stable']}/{d['seeds']}",
                          *(number(d[name], form, "no step") for name, form in (
                              ("median_radius", ".6f"), ("worst_radius", ".6f"),
                              ("worst_gate", ".3g"))),
                          *(number(d[name], ".2g") for name in ("departure", "imaginary")),
                          str(d["missed"])])
        lines = [text_table(table), ""]
        for least in self.least_rows():
            rows = least.pop("rows")
            if rows != "-":
                lines.append(f"least rows stable for all seeds: {rows}  ("
                             f"{', '.join(v for v in least.values() if v != '-')})")
        lines += [f"warning: {text}" for text in self.warnings]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        return {"limit": LIMIT, "least_rows": self.least_rows(), "warnings": list(self.warnings),
                "variants": [
            e.as_dict() | {"each": [f.as_dict() for f in e.findings]} for e in self.entries]}


@fixed_threads()
def survey(
    scene: Scene, plan: SurveyPlan, *, cache: Cache | None = None, observers: Sequence[object] = (),
    done: Callable[[VariantStability], None] = lambda entry: None,
) -> Survey:
    """Linearises every variant of a scene with every seed.

    done: called with each entry; observers: receivers of the events of training. Training runs and
    bases are cached, one for each integrator and time step. Raises InputError before anything is
    computed, SolveFailed if a training run fails.
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
                cases[key] = _Case.from_scene(
                    v.scene, *prepared(v.scene, cache or Cache(), manager), plan)
            entry = VariantStability(v.settings, [
                _finding(v.scene, cases[key], seed) for seed in range(1, plan.seeds + 1)],
                cases[key].buckled)
            done(entry)
            entries.append(entry)
    return Survey(entries)


def _refuse(v: Variant, model: Model, plan: SurveyPlan) -> None:
    faults = time_faults(v.scene)
    faults += InputError(list(v.scene.reducer.check(model))).under("reducer").faults
    if faults:  # at the options that make the variant
        raise LocatedError(faults, v.scene.locate(InputError(faults)))
    if v.scene.reducer.full_order:
        raise InputError("full order is what reduced models are judged by: name another one",
                         "reducer")
    times_checked(plan.at or (), v.scene.time.step, v.scene.time.end)


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """Data shared by the variants of one integrator and time step.

    model: full-order model, with the rigid pre-simulation if there is one; offline: training run
    and bases; states: full-order states at which variants are linearised; reference: Galerkin
    models for comparison; exact: block -> lowest full-order eigenvalues; buckled: sentences on
    bodies beyond their buckling load.
    """

    model: Model
    offline: Offline
    states: Sequence[State]
    reference: ReferenceModels
    exact: Mapping[str, Any]
    buckled: tuple[str, ...]

    @classmethod
    def from_scene(cls, scene: Scene, model: Model, offline: Offline, plan: SurveyPlan) -> "_Case":
        states = _states(scene, model, offline, plan.at)
        buckled = Checks.for_scene(scene).of_training(scene, model, offline)
        return cls(model, offline, states, ReferenceModels(model, scene.source.registry),
                   exact_values(model), buckled)


def _states(
    scene: Scene, model: Model, offline: Offline, times: Sequence[float] | None
) -> list[State]:
    """Full-order states of linearisation, from a run of the Galerkin-projected model with the
    scene's trial basis.

    times: s; None: as in the check before a run; only zeros: the initial state.
    """
    h, integrator = scene.time.step, scene.integrator
    start = resolved_start(model, integrator, h).state
    if times is not None and not any(times):
        return [start] * len(times)
    solver = scene.reducer.prepare(ReducedProblem(
        model, integrator, h, offline, np.random.default_rng(scene.seed)))
    registry = scene.source.registry
    if times is None:
        due = linearization_times(h, step_count(scene))
        return states_along(model, integrator, h, solver, start, due, registry)
    reference = projected(model, integrator, h, solver, {}, registry)
    return along(reference, integrator, h, start, times)


def _finding(scene: Scene, case: _Case, seed: int) -> SeedStability:
    """The worst linearisation of one seed, with the growth summed over all linearisations."""
    h, integrator, steps = scene.time.step, scene.integrator, step_count(scene)
    fields = tuple(k.name for k in case.model.layout.kinds if k.reducible)
    try:
        solver: StepSolver = scene.reducer.prepare(ReducedProblem(
            case.model, integrator, h, case.offline, np.random.default_rng(seed)))
    except SolveFailed as failure:
        return SeedStability(seed, failed(0.0, steps, failure), UNKNOWN, {}, 0, fields)
    found = []
    for full in case.states:
        try:
            step = step_map(solver, integrator, h, *started(solver, integrator, full))
        except SolveFailed as failure:
            return SeedStability(seed, failed(full.t, steps, failure), UNKNOWN, {},
                           unsampled(solver), fields)
        theirs = case.reference.step(step, integrator, h, full)
        judgement = judged(step, eigenvalues(step.matrix), theirs, full.t, steps)
        found.append(SeedStability(
            seed, judgement, eigenvalue_errors(step, theirs, case.exact), own_radii(step),
            unsampled(solver), fields))
    worst = max(found, key=lambda f: f.judgement.excess)
    return replace(worst, judgement=over_the_run([f.judgement for f in found]))


def unsampled(solver: StepSolver) -> int:
    """Number of loads and joints without a sampled row in a block they act on."""
    return sum(note.kind == "unsampled" for note in solver.notes)


def _numbers(rows: str) -> tuple[int, ...]:
    return tuple(int(n) if n.isdigit() else 0 for n in rows.split("/"))


def _worst(values: Any) -> float | None:
    return max((v for v in values if v is not None), default=None)


