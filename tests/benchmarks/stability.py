"""Is what the linearised one-step map predicts what runs then do?

    python tests/benchmarks/stability.py [--quick] [--seeds 30] [--minutes 90] [--out FILE]

Every seed of every sample of rows is judged as `run` does (core/stability) and then run: 30/20 POD
atoms of the double pendulum, nothing selected, trained over what is run with the same integrator.
Seeds go round by round over the samples, so that a run that is out of time has seen all of them.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core import State, StepSolver
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.stability.galerkin_reference import linearization_times, states_along
from sparsemor.plugins.stability.stability_check import (
    LIMIT,
    Judgement,
    ReferenceModels,
    failed,
    judge_along,
)

ERRS, TIMES = 1e-5, 10.0
"""Relative error of a field (rad for an angle) from which a run is said to err, if it is also so
many times that of the Galerkin model."""
MARGIN = 10.0
"""Gates up to here are called marginal: growth from round-off that need not show."""
COLD = (0.9, 1.1)
"""Thermal error of a link that stays at its first temperature."""
EVERY = 20
"""Steps between those that are compared with full order."""
ROWS = [(30, 20), (36, 24), (60, 40), (240, 80)]
SAMPLERS = ["lhs", "random", "deim", "leverage", "s_opt"]


@dataclass
class Sample:
    """One sampler, number of rows and treatment of required ones under one integrator."""

    case: common.Case
    label: str
    reducer: Mapping[str, Any]
    settings: Mapping[str, Any]
    seeds: int
    limits: Mapping[str, float]
    states: list[State]
    seen: list[dict[str, Any]] = field(default_factory=list)
    rows: Mapping[str, Any] | None = None

    def repeats(self, rows: Mapping[str, Any]) -> bool:
        """Whether a sampler that draws nothing gives the rows of the first seed again."""
        first = self.rows
        if first is None:
            self.rows = dict(rows)
            return False
        return all(np.array_equal(first[name], rows[name]) for name in rows)


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "double_pendulum, two links of 1280 triangles, 30/20 POD atoms, nothing selected",
        "predicted": f"unstable: (radius - that of the Galerkin model) x steps > {LIMIT:g}, added "
                     "up over the states that `run` looks at, or a step beside one does not "
                     "converge, or rows that cannot tell the atoms apart (no model); marginal: up "
                     f"to {MARGIN:g}",
        "observed": f"stopped; errs: a field off by more than {ERRS:g} of its largest change, or "
                    f"an angle by as many rad, and by {TIMES:g} times what the Galerkin model is; "
                    "cold: a link never heats, as no row feels its flux",
        "check s": "median CPU time of the prediction, the reference included where it is made",
        "seeds": f"1 to {given.seeds} (5 at h = 0.25 ms), or as many as {given.minutes:g} "
                 "minutes allow; one where a sampler draws nothing"}
    counts = out.table("Predicted and observed")
    confusion = out.table("Confusion")
    wrong = out.table("Every disagreement")
    samples = list(all_samples(given))
    references = {id(s.case): ReferenceModels(s.case.model) for s in samples}
    until = time.monotonic() + 60.0 * given.minutes
    for seed in range(1, given.seeds + 1):
        for sample in samples:
            if seed <= sample.seeds and time.monotonic() < until:
                sample.seen += one(sample, seed, references[id(sample.case)])
        report.progress(f"seed {seed}")
    for sample in samples:
        summarised(sample, counts, wrong)
    tally = Counter((r["predicted"], r["observed"]) for s in samples for r in s.seen)
    for predicted in ("stable", "marginal", "unstable", "no step", "no model"):
        confusion.add(predicted=predicted, **{
            kind: tally[predicted, kind] for kind in ("good", "cold", "errs", "stopped")})
    total = sum(tally.values())
    missed = tally["stable", "stopped"] + tally["stable", "errs"]
    false = tally["unstable", "good"] + tally["no step", "good"]
    out.at_most(f"missed blow-ups of {total} runs", missed, 0)
    out.at_most(f"false alarms of {total} runs", false, 0)


def all_samples(given: argparse.Namespace) -> list[Sample]:
    """BDF1 with every sampler; generalized-alpha at several rho_inf and steps with lhs."""
    found = []
    for integrator, h, samplers, rows, seeds in given.plans:
        label = integrator if isinstance(integrator, str) else f"ga {integrator['rho_inf']:g}"
        report.progress(f"{label}, h = {h:g}: training run")
        scene = common.scene_at(1280, given.end, integrator=integrator, **{"time.step": h})
        case = common.Case.of(scene)
        case = replace(case, reference={
            name: np.array(x[::EVERY]) for name, x in case.reference.items()})
        limits, states = galerkin_limits(case), list[State]()
        for sampler in samplers:
            for count in rows:
                for required in (True, False):
                    reducer = common.sparse(count, required=required)
                    reducer["sampler"] = {"use": sampler, "required": required}
                    found.append(Sample(case, f"{label}, {h:g}", reducer, {
                        "integrator": label, "step": f"{h:g}", "sampler": sampler,
                        "required": "kept" if required else "drawn",
                        "rows": f"{count[0]}/{count[1]}"}, seeds, limits, states))
    return found


def galerkin_limits(case: common.Case) -> dict[str, float]:
    """Error of each field from which a run under sampled rows is said to err."""
    run = case.run(common.galerkin())
    assert isinstance(run, common.Trajectory)
    return {name: max(ERRS, TIMES * e) for name, e in thinned(case, run).items()}


def one(sample: Sample, seed: int, reference: ReferenceModels) -> list[dict[str, Any]]:
    """Prediction, then the run; nothing where the rows are those of the first seed."""
    scene, steps = sample.case.scene, sample.case.steps
    try:
        solver = sample.case.prepared(sample.reducer, seed)
    except SolveFailed as failure:
        j = failed(0.0, steps, failure)
        return [{"seed": seed, "predicted": "no model", "observed": "stopped", "judgement": j,
                 "what": common.in_words(failure), "worst": None}]
    if sample.repeats(solver.rows):
        return []
    begun = time.process_time()
    h, model = scene.time.step, sample.case.model
    if not sample.states:  # all samples of a case have its atoms
        sample.states.extend(states_along(
            model, scene.integrator, h, solver, consistent_state(model),
            linearization_times(h, steps)))
    states = sample.states
    j = judge_along(solver, scene.integrator, h, steps, states, reference)
    spent = time.process_time() - begun
    predicted = "no step" if not j.status.ok else "stable" if j.stable else (
        "unstable" if j.gate > MARGIN else "marginal")
    observed, what, worst = observe(sample, solver)
    return [{"seed": seed, "predicted": predicted, "observed": observed, "judgement": j,
             "what": what, "worst": worst, "spent": spent}]


def observe(sample: Sample, solver: StepSolver) -> tuple[str, str, float]:
    """How the run went, in a word and in a phrase, and its worst error."""
    case = sample.case
    run = common.follow(case.scene, case.model, solver, case.steps)
    errors = thinned(case, run)
    worst = max(errors.values())
    told = ", ".join(f"{k} {v:.1e}" for k, v in errors.items())
    if run.failure is not None:
        return "stopped", common.in_words(run.failure), worst
    if COLD[0] < errors["thermal"] < COLD[1]:
        return "cold", told, worst
    good = all(e <= sample.limits[name] for name, e in errors.items())
    return "good" if good else "errs", told, worst


def thinned(case: common.Case, run: common.Trajectory) -> dict[str, float]:
    """As `Case.errors`, at every EVERY-th step only (of which the case has the reference)."""
    h, kept = case.scene.time.step, run.x[::EVERY]
    late = EVERY * h * np.arange(len(kept)) >= min(common.LATE, 0.5 * case.steps * h)
    found = {"angle": 0.0, "elastic": 0.0, "thermal": 0.0}
    for b in case.model.layout:
        if b.field == "multiplier":
            continue
        c, truth = kept[:, run.solver.layout[b.name]], case.reference[b.name][: len(kept)]
        if b.field == "rigid":
            found["angle"] = max(found["angle"], float(np.abs(c - truth)[:, 2].max()))
            continue
        d = run.solver.dictionaries[b.name]
        whole = case.reference[b.name]
        size = np.linalg.norm(whole - whole[0], axis=1).max()
        error = np.linalg.norm(d.offset + c @ d.atoms.T - truth, axis=1)
        error = error[late] if b.field == "elastic" else error
        found[b.field] = max(found[b.field], float(error.max(initial=0.0) / max(size, 1e-300)))
    return found


def summarised(sample: Sample, counts: report.Table, wrong: report.Table) -> None:
    """One line of counts, and one for each disagreement."""
    kinds = Counter(r["predicted"] for r in sample.seen)
    ends = Counter(r["observed"] for r in sample.seen)
    judged: list[Judgement] = [r["judgement"] for r in sample.seen]
    gates = [j.gate for j in judged if j.status.ok]
    bad = [r for r in sample.seen if r["observed"] != "cold" and
           (r["predicted"] == "stable") != (r["observed"] == "good")]
    spent = [r["spent"] for r in sample.seen if "spent" in r]
    good = [r["worst"] for r in sample.seen if r["observed"] == "good"]
    counts.add(**sample.settings, seeds=len(sample.seen), stable=kinds["stable"],
               marginal=kinds["marginal"],
               unstable=kinds["unstable"], no_step=kinds["no step"], no_model=kinds["no model"],
               worst_gate=max(gates, default=None), good=ends["good"], cold=ends["cold"],
               errs=ends["errs"], stopped=ends["stopped"], disagree=len(bad),
               worst_good=max(good, default=None),
               check_s=float(np.median(spent)) if spent else None)
    for r in bad:
        j = r["judgement"]
        wrong.add(**sample.settings, seed=r["seed"], predicted=r["predicted"],
                  gate=j.gate if j.status.ok else None, block=j.block, observed=r["observed"],
                  seen=r["what"])


def arguments() -> argparse.Namespace:
    parser = report.options("stability", __doc__)
    parser.add_argument("--seeds", type=int, default=30, help="at most so many")
    parser.add_argument("--minutes", type=float, default=90.0, help="no new run after so long")
    given = parser.parse_args()
    given.end = 4.0
    alpha = [({"use": "generalized_alpha", "rho_inf": rho}, 1e-3, ["lhs"], ROWS[2:], 30)
             for rho in (0.0, 0.5, 0.8, 1.0)]
    fine = [({"use": "generalized_alpha", "rho_inf": rho}, 2.5e-4, ["lhs"], ROWS[3:], 5)
            for rho in (0.8, 1.0)]
    given.plans = [("bdf1", 1e-3, SAMPLERS, ROWS, 30), *alpha, *fine]
    if given.quick:
        given.end, given.seeds = 0.06, min(given.seeds, 2)
        given.plans = [("bdf1", 1e-3, ["lhs"], ROWS[:1], 2),
                       ({"use": "generalized_alpha", "rho_inf": 1.0}, 1e-3, ["lhs"], ROWS[3:], 2)]
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("stability", fill, arguments()))
