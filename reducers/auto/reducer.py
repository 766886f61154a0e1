"""Reducer `auto`: chooses fields, reducer, bases and numbers of atoms by trial runs over the
training run."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.core import (
    Basis,
    Choice,
    FloatArray,
    ReducedProblem,
    Slot,
    SolveFailed,
    StepSolver,
    TrialRun,
    slot_default,
)
from sparsemor.reducers.auto.sources import CONSTANT, Source, learned, responses
from sparsemor.reducers.auto.trials import Reference
from sparsemor.reducers.projection.base import Projection, ProjectionReducer
from sparsemor.reducers.projection.ecsw.reducer import Ecsw
from sparsemor.reducers.projection.galerkin import Galerkin
from sparsemor.reducers.step_options import ReducedStepOptions

REDUCERS: Mapping[str, type[ProjectionReducer]] = {"galerkin": Galerkin, "ecsw": Ecsw}
SAFE = 0.3
"""Share of the tolerance that errors over the training run may reach, a margin for other loads."""
SPARE = 0.25
"""Share of atoms, two at least, that learned bases have beyond what the training run needs: a
margin for other parameters, under which projection errors fall more slowly with the number."""
TIGHTER = 0.3
"""Factor of the target of a projection error where a trial run is not accurate enough."""
ATTEMPTS = 4
"""Largest number of trial runs for one kind of bases."""
WEIGHINGS = 2
"""Largest number of sets of ECSW weights."""
WORTH = 4
"""Elements of local terms per atom from which on their hyper-reduction is tried."""
RIGID = 1e-9
"""Largest displacement, relative to the size of its body, of a body that may as well be rigid."""


class Auto(ReducedStepOptions):
    """Chooses the reducer of a scene: the smallest model that meets a tolerance over the training
    run.

    Replaced by the reducer that it chooses before a run starts. Fields that do not change in the
    training run are left out. Other bases are learned from the first part of the training run and
    tried on the whole of it; where loads move, bases need no training. Galerkin projection, or
    ECSW where local terms have many elements. `sparsemor advise` prints all trial runs.
    """

    tolerance: float = Field(default=1e-3, ge=1e-8, lt=1.0)
    """Largest error of each field, relative to its largest change."""
    learning: float = Field(default=0.5, gt=0.0, lt=1.0)
    """Share of the training run from which the bases of the trial runs are learned; the rest is
    held out. The chosen bases learn from the whole of it."""
    most: int = Field(default=500, ge=1)
    """Largest number of atoms of a block."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of blocks over which no load moves; its number of atoms is chosen."""
    bases: ClassVar[Mapping[str, Basis]] = {}

    def left_out(self, problem: ReducedProblem) -> tuple[str, ...]:
        """Temperatures that do not change, and displacements below 1e-9 of the size of the
        body."""
        ref = Reference.of(problem, self.learning)
        found = []
        for name in problem.model.reducible():
            data = problem.model.block_data(name)
            if data.order == 1:
                needless = name in ref.constant
            else:
                size = float(np.ptp(data.coordinates, axis=0).max())
                needless = largest(problem.offline.snapshots(name)) <= RIGID * size
            found += [name] if needless else []
        return tuple(found)

    def choose(
        self, problem: ReducedProblem, unstable: Callable[[Mapping[str, object], StepSolver], str]
    ) -> Choice:
        """Reducer for a problem, by trial runs over its training run. ECSW that is unstable gives
        way to Galerkin projection, which is not checked: its model inherits the stability of the
        full-order one."""
        search = Search(self, problem)
        counts = search.sized(problem, search.learned())
        if search.tau:
            options = search.options("ecsw", counts)
            why = unstable(options, made(options).project(problem).solver())
            if why:
                search.without_weights(why)
                counts = search.sized(problem, counts)
        return search.choice(counts)

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        """Step solver of the chosen reducer, without a stability check."""
        return made(self.choose(problem, lambda options, solver: "").reducer).prepare(problem)

    def restart_refusal(self) -> str:
        return "trial runs take fixed steps: name the reducer of a run with time.control"


class Search:
    """Trial runs for one problem: numbers of atoms by block, and the reducer."""

    def __init__(self, auto: Auto, problem: ReducedProblem) -> None:
        self.auto, self.problem = auto, problem
        self.ref = Reference.of(problem, auto.learning)
        self.trials: list[TrialRun] = []
        self.heat: dict[str, str] = {}
        self.moving: list[str] = []
        self.sources: dict[str, Source] = {}
        self.tau = 0.0
        self.rejected = ""
        self.falls: Mapping[str, FloatArray] = {}
        self.lead: dict[str, int] = {}
        self.targets = dict.fromkeys(problem.model.reducible(), SAFE * auto.tolerance)
        for name in problem.model.reducible():
            data = problem.model.block_data(name)
            if data.heat is not None:
                self.heat[name] = data.heat.name
            carried = data.order == 2 and data.heat is not None and data.heat.moving
            if name in self.ref.constant:
                self.sources[name] = lambda k: dict(CONSTANT)
            elif data.moving or carried:
                self.moving.append(name)
                self.sources[name] = responses(data)
            else:
                self.sources[name] = learned(auto.basis)

    @property
    def trained(self) -> bool:
        """True if any basis learns from snapshots."""
        return any(n not in self.moving and n not in self.ref.constant for n in self.sources)

    def options(self, use: str, counts: Mapping[str, int]) -> dict[str, Any]:
        """Options of a reducer with so many atoms of each block, as in a scene."""
        own = {k: v for k, v in self.auto.model_dump(mode="json").items()
               if k in ReducedStepOptions.model_fields and k in self.auto.model_fields_set}
        return {"use": use, **({"tau": self.tau} if use == "ecsw" else {}), **own, "bases": {
            n: source(max(1, counts[n] - self.lead.get(n, 0)))
            for n, source in self.sources.items()}}

    def learned(self) -> dict[str, int]:
        """Numbers of atoms that meet the tolerance with bases of the first part of the training
        run; of learned bases also spare ones."""
        if not self.trained:
            return {}
        offline = self.problem.offline.learning(self.ref.first)
        met = self.sized(replace(self.problem, offline=offline), {}, "learned from the first part")
        return {n: k if n in self.moving else k + max(2, round(SPARE * k)) for n, k in met.items()}

    def sized(
        self, problem: ReducedProblem, least: Mapping[str, int], said: str = ""
    ) -> dict[str, int]:
        """Numbers of atoms, at least those of `least`, that meet the tolerance with the bases of
        `problem`; said: what these have learned, "" for the whole training run."""
        most = dict.fromkeys(self.sources, self.auto.most)
        whole = made(self.options("galerkin", most)).project(problem)
        total = {n: d.atoms.shape[1] for n, d in whole.dictionaries.items()}
        self.falls = {n: self.ref.projection(n, d) for n, d in whole.dictionaries.items()}
        counts = {n: min(max(self._needed(n), least.get(n, 1)), total[n]) for n in total}
        if self._hyper(whole, counts):
            return self._weighted(problem, counts, total, said)
        for attempt in range(ATTEMPTS):
            trial = self._tried(whole.leading(counts), f"galerkin{said and ', '}{said}", said)
            more = self._grown(counts, total, trial)
            if more == counts or attempt + 1 == ATTEMPTS:
                break
            counts = more
        if not said:
            self.lead = {n: max(0, k - self.auto.most) for n, k in total.items()}
        return counts

    def without_weights(self, why: str) -> None:
        """Rejects ECSW, for a reason."""
        self.tau, self.rejected = 0.0, f"ecsw was rejected: {why}"

    def _needed(self, name: str) -> int:
        """Smallest number of atoms whose projection error meets the block's target; all if none
        does."""
        met = np.flatnonzero(self.falls[name][1:] <= self.targets[name])
        return int(met[0]) + 1 if met.size else len(self.falls[name]) - 1

    def _grown(
        self, counts: Mapping[str, int], total: Mapping[str, int], trial: TrialRun
    ) -> dict[str, int]:
        """Numbers of atoms after a trial run: more in blocks that are not accurate enough, and in
        the temperatures that act on them."""
        poor = {n for n, e in trial.errors.items() if e > SAFE * self.auto.tolerance}
        more = dict(counts)
        for name in poor | {self.heat[n] for n in poor if n in self.heat}:
            self.targets[name] *= TIGHTER
            more[name] = min(max(self._needed(name), counts[name] + 1), total[name])
        return more

    def _tried(self, projection: Projection, method: str, said: str) -> TrialRun:
        try:
            trial = self.ref.run(method, projection.solver(), bool(said))
        except SolveFailed:  # dependent atoms
            atoms = {n: d.atoms.shape[1] for n, d in projection.dictionaries.items()}
            trial = TrialRun(method, atoms, dict.fromkeys(atoms, np.inf), {}, None)
        self.trials.append(trial)
        return trial

    def _hyper(self, whole: Projection, counts: Mapping[str, int]) -> bool:
        """True if local terms have so many elements that their hyper-reduction may pay."""
        model = self.problem.model
        local = any(b.local for b in model.separated.heat) or model.separated.elastic_local
        if not local or self.rejected or model.separated.other and Ecsw().check(model):
            return False
        touched = sum(whole.leading(counts).solver().elements_touched.values())
        return touched > WORTH * sum(counts.values()) and not Ecsw().check(model)

    def _weighted(
        self, problem: ReducedProblem, counts: dict[str, int], total: Mapping[str, int], said: str
    ) -> dict[str, int]:
        """Numbers of atoms with which ECSW meets the tolerance. Each attempt trains weights of
        its own; where the first part of the training run has been tried, the whole is tried
        once."""
        if self.tau and not said:
            chosen = made(self.options("ecsw", counts)).project(problem)
            self._tried(chosen, f"ecsw, tau {self.tau:.1g}", "")
            return counts
        self.tau = 0.1 * self.auto.tolerance
        for attempt in range(WEIGHINGS):
            projection = made(self.options("ecsw", counts)).project(problem)
            trial = self._tried(projection, f"ecsw, tau {self.tau:.1g}{said and ', '}{said}", said)
            more = self._grown(counts, total, trial)
            if more == counts or attempt + 1 == WEIGHINGS:
                break
            counts, self.tau = more, max(0.1 * self.tau, 1e-8)
        return counts

    def choice(self, counts: Mapping[str, int]) -> Choice:
        """The chosen reducer, and what speaks for and against it."""
        tolerance = self.auto.tolerance
        reasons = [self.rejected] if self.rejected else []
        doubts: list[str] = []
        held = next((t for t in reversed(self.trials) if t.holdout), None)
        last = self.trials[-1]
        for trial, errors, where in ((held, held.holdout if held else {}, "on the part of the "
                                      "training run that was held out"),
                                     (last, last.errors, "over the training run")):
            if trial is None or not errors:
                continue
            name = max(errors, key=lambda n: errors[n])
            text = (f"{trial.method}: largest error {where} {errors[name]:.1e} ({name}), "
                    f"{errors[name] / tolerance:.2g} of the tolerance")
            (reasons if errors[name] <= tolerance else doubts).append(text)
        if self.moving:
            reasons.append(f"loads move over {', '.join(self.moving)}: atoms of the load tables, "
                           "which need no training")
        for name, fall in self.falls.items():
            k = counts[name]
            ten = np.flatnonzero(fall[k:] <= 0.1 * fall[k])
            if name not in self.ref.constant:
                reasons.append(f"{name}: projection error {fall[k]:.1e} with {k} atoms, a tenth of "
                               + (f"it with {k + int(ten[0])}" if ten.size else
                                  f"it with none of {len(fall) - 1}"))
        use = "ecsw" if self.tau else "galerkin"
        return Choice(self.options(use, counts), tuple(self.trials), tuple(reasons), tuple(doubts))


def made(options: Mapping[str, Any]) -> ProjectionReducer:
    """Reducer with these options."""
    return REDUCERS[options["use"]](**{k: v for k, v in options.items() if k != "use"})


def largest(X: FloatArray) -> float:
    """Largest absolute entry of X."""
    return float(np.abs(X).max(initial=0.0))
