"""Stability check before a reduced run: growth of its linearised, coupled time-step map.

Criterion: (excess growth per step over the Galerkin model of the same atoms) x steps <= LIMIT,
accumulated over a few states of the coming run. Errors are then multiplied by e^LIMIT = 150 at
most. A limit on the spectral radius itself would refuse good models: sampled blocks reach 1 + 1e-5,
and an insulated body has an eigenvalue exactly 1.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from sparsemor.core import Integrator, State, StepSolver
from sparsemor.core.arrays import Arrays
from sparsemor.core.errors import InputError
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note, information
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.overrides import split
from sparsemor.core.scene.run_identity import IRRELEVANT
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.checks import Check, Findings
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.time_stepping import started
from sparsemor.core.simulation.training import in_training
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.checks import place
from sparsemor.plugins.stability.galerkin_reference import (
    PROJECTION,
    linearization_times,
    projected,
    states_along,
)
from sparsemor.plugins.stability.spectrum import (
    ComplexArray,
    block_of,
    eigenvalues,
    excess,
)
from sparsemor.plugins.stability.step_map import StepMap, step_map

UNSTABLE = "unstable"
"""Identifier of the warning."""
LIMIT = 5.0
"""Largest (excess growth per step) x steps of a model that is called stable."""
ADVICE = ("keep the required rows, sample more rows, or try another seed, sampler or a more damped "
          "integrator (`sparsemor stability` tabulates them)")


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """Stability of a run of `steps` steps, from one linearisation at time t (s).

    radius: spectral radius of the coupled time-step map; reference: that of the Galerkin model of
    the same atoms, None where it was not needed or could not be computed; excess: growth per step
    beyond the reference; block: where the mode of largest growth has its largest entry, "" if
    stable; status: how the step failed, if it did (radius and excess are then infinite); over:
    excess x steps accumulated over several states, of which this is the worst, None for a single
    state.
    """

    t: float
    steps: int
    radius: float
    reference: float | None
    excess: float
    block: str
    status: Status = Status.DONE
    over: float | None = None

    @property
    def growth(self) -> float:
        """(radius - 1) x steps: exponent of the growth over the run, physical or not."""
        return (self.radius - 1.0) * self.steps

    @property
    def gate(self) -> float:
        """Excess growth exponent of the run: excess x steps, accumulated where there are several
        states."""
        return self.excess * self.steps if self.over is None else self.over

    @property
    def stable(self) -> bool:
        return self.gate <= LIMIT

    def facts(self) -> dict[str, Any]:
        """Numbers that are stored with the results of the run."""
        numbers = {"radius": self.radius, "growth": self.growth, "gate": self.gate}
        finite = {name: v if isfinite(v) else None for name, v in numbers.items()}
        return {"t": self.t, **finite, "stable": self.stable} | (
            {} if self.stable else {"block": self.block})

    def in_words(self) -> str:
        """Warning text about a predicted instability."""
        if not self.status.ok:
            return (f"the reduced model is unstable in {self.block}: its step from t = "
                    f"{self.t:g} s, or from a state near it, ends {self.status.value}; {ADVICE}")
        return (
            f"the reduced model is unstable in {self.block}: its coupled time-step map at t = "
            f"{self.t:g} s has spectral radius {self.radius:.6g}, and errors grow by "
            f"e^{self.gate:.3g} over {self.steps} steps beyond the motion itself (limit "
            f"e^{LIMIT:g}); {ADVICE}")


class ReferenceModels:
    """Galerkin reference models on the active atoms of step solvers, each built when it is first
    needed."""

    def __init__(self, model: Model, registry: Registry | None = None) -> None:
        self.model, self.registry = model, registry
        self._known: dict[str, StepMap | None] = {}

    def step(
        self, of: StepMap, integrator: Integrator, h: float, full: State
    ) -> StepMap | None:
        """Time-step map of the Galerkin model at a full-order state, None if it cannot be built.
        of: map of the reduced model; h: step size, s."""
        solver, supports = of.solver, of.supports
        key = digest(h, full.t, full.x, full.v, integrator, {
            n: [d.atoms, d.offset, supports.get(n)] for n, d in solver.dictionaries.items()})
        if key not in self._known:
            try:
                twin = projected(self.model, integrator, h, solver, supports, self.registry)
                self._known[key] = step_map(twin, integrator, h, *started(twin, integrator, full))
            except (SolveFailed, InputError):  # or terms that cannot be projected
                self._known[key] = None
        return self._known[key]


def judge(
    solver: StepSolver, integrator: Integrator, h: float, steps: int, full: State,
    reference: ReferenceModels,
) -> Judgement:
    """Stability of a step solver linearised about a full-order state, for `steps` steps of h, s.
    The Galerkin reference is computed only if the spectral radius exceeds the limit.

    A step that fails, at this state or one near it, counts as infinite growth: all tested models of
    this kind stopped during the run.
    """
    try:
        step = step_map(solver, integrator, h, *started(solver, integrator, full))
    except SolveFailed as failure:
        return failed(full.t, steps, failure)
    values = eigenvalues(step.matrix)
    theirs = None
    if (abs(values[0]) - 1.0) * steps > LIMIT:
        theirs = reference.step(step, integrator, h, full)
    return judged(step, values, theirs, full.t, steps)


def judge_along(
    solver: StepSolver, integrator: Integrator, h: float, steps: int, states: Sequence[State],
    reference: ReferenceModels,
) -> Judgement:
    """Worst of several linearisations, with the excess growth accumulated over the run
    (`over_the_run`)."""
    return over_the_run([judge(solver, integrator, h, steps, s, reference) for s in states])


def over_the_run(found: Sequence[Judgement]) -> Judgement:
    """Worst of several linearisations in the order of their times, with the accumulated excess
    growth: each counts for the part of the run that lies nearer to its time than to the others."""
    worst, t = max(found, key=lambda j: j.excess), [j.t for j in found]
    if not (worst.excess < inf and t[-1] > t[0]):
        return worst
    middle = [t[0], *(0.5 * (a + b) for a, b in zip(t, t[1:], strict=False)), t[-1]]
    parts = [b - a for a, b in zip(middle, middle[1:], strict=False)]
    gate = sum(j.excess * j.steps * part for j, part in zip(found, parts, strict=True))
    over = gate / (t[-1] - t[0])
    return replace(worst, over=over, block=worst.block or ("" if over <= LIMIT else "the run"))


def failed(t: float, steps: int, failure: SolveFailed) -> Judgement:
    """Judgement of a model whose step cannot be linearised, because it failed."""
    return Judgement(t, steps, inf, None, inf, failure.block or "the whole system",
                     failure.status)


def judged(
    step: StepMap, values: ComplexArray, reference: StepMap | None, t: float, steps: int
) -> Judgement:
    """Judgement from the time-step map of a reduced model, its eigenvalues, and the map of its
    Galerkin reference."""
    theirs = None if reference is None else eigenvalues(reference.matrix)
    beyond, value = excess(values, theirs)
    stable = beyond * steps <= LIMIT
    return Judgement(
        t, steps, float(abs(values[0])), None if theirs is None else float(abs(theirs[0])),
        beyond, "" if stable else block_of(step, value))


class Stability(Check):
    """Stability of a reduced model: growth of its linearised time-step map before the run."""

    order = place("stability")

    def before_steps(self, run: PreparedRun, again: PreparedRun | None) -> Findings:
        """Warning about a predicted instability, and numbers for the summary; those of an earlier
        run of a kept model (`again`) are used again, and a run without model or offline data has
        none. Raises InputError (key `check_stability`) if the model is unstable and the scene's
        option is `refuse`."""
        if again is not None:
            return Findings([n for n in again.notes if n.kind == UNSTABLE],
                            {"stability": again.summary.get("stability", {})})
        if run.model is None or run.offline is None:
            return Findings(summary={"stability": {}})
        notes, facts = check_run(run.scene, run.model, run.solver, run.start, run.offline)
        return Findings(notes, {"stability": facts})


def check_run(
    scene: Scene, model: Model, solver: StepSolver, full: State, offline: Offline,
    states: Sequence[State] = (),
) -> tuple[tuple[Note, ...], dict[str, Any]]:
    """Stability check of a run before its first step, about the full-order initial state `full`:
    warnings, and numbers to store. The result is cached with the offline products.

    states: those of a full-order run, or of one that is known to be accurate, in the order of their
    times; without them, those of the training run where this is the same run but for its loads, or
    else of a run of the Galerkin model of the same atoms.

    Full-order and Galerkin models are the reference and are not checked. Raises InputError (key
    `check_stability`) if the model is unstable and the scene's option is `refuse`.
    """
    projects = scene.reducer_name == PROJECTION
    if scene.check_stability == "off" or not solver.dictionaries or projects:
        return (), {}
    if not scene.integrator.one_solve:
        return (information("the stability check does not apply to an integrator with several "
                            "solves a step", "stability_unchecked"),), {}
    # keys of the scene that cannot change the result are reset, so that they do not change its key
    plain = {key: value for key, value in IRRELEVANT.items() if key not in ("seed", "parameters")}
    depends = scene.using(plain).digest(), *([len(states)] if states else [])
    with offline.product("stability", depends) as product:
        if not product.hit:
            product.arrays = _as_arrays(_judged_run(scene, model, solver, full, offline, states))
    words, facts = str(product.arrays["words"]), json.loads(str(product.arrays["facts"]))
    if not words:
        return (), facts
    if scene.check_stability == "refuse":
        raise InputError(words, "check_stability")
    return (Note(words, UNSTABLE),), facts


def _judged_run(
    scene: Scene, model: Model, solver: StepSolver, full: State, offline: Offline,
    known: Sequence[State],
) -> Judgement:
    """Judgement of the worst of several states of the run: those `known` to be of it or near it,
    else of the training run where that is near it, else of a run of the Galerkin model from the
    initial state `full`."""
    integrator, h, steps = scene.integrator, scene.time.step, step_count(scene)
    registry = scene.source.registry
    if not known and integrator.order == 1 and offline.trained and _trained_along(scene):
        known = offline.states()
    states = states_along(
        model, integrator, h, solver, full, linearization_times(h, steps), registry, known)
    return judge_along(solver, integrator, h, steps, states, ReferenceModels(model, registry))


def _trained_along(scene: Scene) -> bool:
    """True if the training run is the run itself, or the same run of its bodies under other loads:
    its states are as near to those of the run as the model is valid for."""
    own = scene.training.overrides
    return in_training(scene.using({"training.overrides": {}}) if own and all(
        split(key)[0] == "loads" for key in own) else scene)


def _as_arrays(found: Judgement) -> Arrays:
    """Warning text ("" for a stable model) and stored numbers of a judgement, as arrays for the
    cache."""
    return {"words": np.array("" if found.stable else found.in_words()),
            "facts": np.array(json.dumps(found.facts()))}
