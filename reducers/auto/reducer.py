"""Reducer `auto`: chooses fields, reducer, bases and numbers of atoms by trial runs over the
training run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from sparsemor.core import (
    Basis,
    BlockBases,
    FloatArray,
    ReducedProblem,
    Slot,
    SolveFailed,
    State,
    StepSolver,
    slot_default,
)
from sparsemor.core.protocols.reducer import Choice, TrialRun
from sparsemor.reducers.auto.candidate_bases import CONSTANT, Source, learned, responses
from sparsemor.reducers.auto.trials import TrainingReference
from sparsemor.reducers.projection.ecsw.reducer import Ecsw
from sparsemor.reducers.projection.galerkin import Galerkin
from sparsemor.reducers.projection.projection_reducer import Projection, ProjectionReducer
from sparsemor.reducers.reducer_options import ReducedStepOptions

REDUCERS: Mapping[str, type[ProjectionReducer]] = {"galerkin": Galerkin, "ecsw": Ecsw}
SAFE = 0.3
"""Share of the tolerance that errors over the training run may reach, a margin for other loads."""
SPARE = 0.25
"""Share of atoms, two at least, that learned bases have beyond what the training run needs: a
margin for other parameters, under which projection errors fall more slowly with the number."""
HELD_OUT = 0.5
"""Share of the tolerance that errors may reach on the part of the training run that was held
out."""
TIGHTER = 0.3
"""Least factor of the target of a projection error where a trial run is not accurate enough."""
NEARER = 0.7
"""Share of its limit to which the error of ECSW on that part is to fall, since more atoms need more
elements; for Galerkin projection `TIGHTER`."""
ATTEMPTS = 4
"""Largest number of trial runs for one kind of bases."""
WEIGHINGS = 2
"""Largest number of sets of ECSW weights."""
WORTH = 4
"""Elements of local terms per atom from which on their hyper-reduction is tried."""
TELLING = 4
"""Largest number of atoms that bases of the first part of the training run may need, as a multiple
of what bases of the whole need: beyond it the first part does not show what follows."""
PARTS = 3
"""Largest number of first parts that are tried, each half-way from the last one to the whole."""
RIGID = 1e-9
"""Largest displacement, relative to the size of its body, of a body that may as well be rigid."""


class Auto(ReducedStepOptions):
    """Chooses the reducer of a scene: the smallest model that meets a tolerance over the training
    run.

    Replaced by the reducer that it chooses before a run starts. Fields that do not change in the
    training run are left out. Other bases are learned from the first part of the training run and
    tried on the whole of it, or learned from all but the last of several training runs and tried
    on that; where loads move, bases need no training. Galerkin projection, or
    ECSW where local terms have many elements. `sparsemor advise` prints all trial runs.
    """

    tolerance: float = Field(default=1e-3, ge=1e-8, lt=1.0)
    """Largest error of each field, relative to its largest change."""
    learning: float = Field(default=0.5, gt=0.0, lt=1.0)
    """Share of the training run from which the bases of the trial runs are learned; the rest is
    held out. Where this share does not show what follows, a larger one is taken. The chosen bases
    learn from the whole of it."""
    most: int = Field(default=500, ge=1)
    """Largest number of atoms of a block."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of blocks over which no load moves; its number of atoms is chosen."""

    def trial_bases(self) -> BlockBases:
        return BlockBases(self.basis, {})

    @property
    def chooses(self) -> bool:
        return True

    def left_out(self, problem: ReducedProblem) -> tuple[str, ...]:
        """Temperatures that do not change, and displacements below 1e-9 of the size of the
        body."""
        ref = TrainingReference.from_problem(problem, self.learning)
        found = []
        for name in problem.model.reducible():
            data = problem.model.block_data(name)
            if data.order == 1:
                needless = name in ref.constant
            else:
                size = float(np.ptp(data.coordinates, axis=0).max())  # of the body, m
                needless = largest(problem.offline.snapshots(name)) <= RIGID * size
            found += [name] if needless else []
        return tuple(found)

    def choose(
        self, problem: ReducedProblem,
        unstable: Callable[[Mapping[str, object], StepSolver, Sequence[State]], str],
    ) -> Choice:
        """Reducer for a problem, by trial runs over its training run. ECSW that is unstable gives
        way to Galerkin projection, which is not checked: its model inherits the stability of the
        full-order one."""
        search = Search(self, problem)
        least = search.learned()
        counts = search.sized(search.largest(problem), least)
        if search.tau:  # ECSW is chosen; `last`: step solver and states of its trial run
            last_trial = search.last
            why = "it is singular" if not last_trial else unstable(
                search.options("ecsw", counts), *last_trial)
            if why:
                search.without_weights(why)
                counts = search.sized(search.largest(problem), counts)
        return search.choice(counts)

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        """Step solver of the chosen reducer, without a stability check."""
        return made(self.choose(problem, lambda *of: "").reducer).prepare(problem)

    def restart_refusal(self) -> str:
        return "trial runs take fixed steps: name the reducer of a run with time.control"


class Search:
    """Trial runs for one problem: numbers of atoms by block, and the reducer.

    ref: snapshots that errors are measured by; sources: options of the bases of each block; moving:
    blocks over which loads move, whose bases need no training; heat: elastic block -> thermal block
    of its body. Of the last bases, projection_errors: block -> error (k + 1,) by the number of
    atoms, and targets: largest one allowed; lead: atoms that a basis has beyond its option `count`.
    trials: all trial runs; last: step solver and states of the last one, None if it failed. tau:
    tolerance of ECSW weights, 0 for Galerkin projection; rejected: why ECSW was.
    """

    def __init__(self, auto: Auto, problem: ReducedProblem) -> None:
        self.auto, self.problem = auto, problem
        self.ref = TrainingReference.from_problem(problem, auto.learning)
        self.trials: list[TrialRun] = []
        self.last: tuple[StepSolver, Sequence[State]] | None = None  # of the last trial run
        self.heat: dict[str, str] = {}  # elastic block -> thermal block of its body
        self.moving: list[str] = []  # blocks over which loads move
        self.sources: dict[str, Source] = {}  # block -> options of its basis by number of atoms
        self.tau = 0.0  # tolerance of ECSW weights, 0 for Galerkin projection
        self.rejected = ""  # why ECSW was
        self.projection_errors: Mapping[str, FloatArray] = {}  # (k + 1,) by number of atoms
        self.lead: dict[str, int] = {}  # atoms that a basis has beyond its option `count`
        self.targets: dict[str, float] = {}  # largest projection errors allowed
        for name in problem.model.reducible():
            data = problem.model.block_data(name)
            if data.heat is not None:
                self.heat[name] = data.heat.name
            # displacements under a heat source that moves
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
        return any(self._learns(n) for n in self.sources)

    def options(self, use: str, counts: Mapping[str, int]) -> dict[str, Any]:
        """Options of a reducer with so many atoms of each block, as in a scene."""
        own = {k: v for k, v in self.auto.model_dump(mode="json").items()
               if k in ReducedStepOptions.model_fields and k in self.auto.model_fields_set}
        if self.auto.error_estimate == "auto":
            own["error_estimate"] = "on"
        return {"use": use, **({"tau": self.tau} if use == "ecsw" else {}), **own, "bases": {
            n: source(max(1, counts[n] - self.lead.get(n, 0)))
            for n, source in self.sources.items()}}

    def learned(self) -> dict[str, int]:
        """Numbers of atoms that meet the tolerance with bases of the first part of the training
        run; of learned bases also spare ones.

        The first part is a larger one where bases of a smaller one need far more atoms than bases
        of the whole, or miss the tolerance on what follows. Of several training runs it is all but
        the last.
        """
        if not self.trained:
            return {}
        offline, share = self.problem.offline, self.auto.learning
        self.largest(self.problem)
        # numbers of atoms that bases of the whole training run need, by the projection errors that
        # `largest` has set
        whole = {n: self._needed(n) for n in self.sources if self._learns(n)}
        # left: number of first parts that may still be tried after this one
        for left in reversed(range(PARTS if self.ref.runs == 1 else 1)):
            self.ref = self.ref.after(share)
            said = (f"learned from the first {share:.3g} of it" if self.ref.runs == 1 else
                    f"learned from {self.ref.runs - 1} runs")
            part = replace(self.problem, offline=offline.learning(self.ref.first))
            largest = self.largest(part)
            # with up to TELLING times as many atoms as the whole needs, the part shows what follows
            if not left or all(self._needed(n) <= TELLING * k for n, k in whole.items()):
                met = self.sized(largest, {}, said)
                held_out = self.trials[-1].holdout.values()
                if max(held_out, default=np.inf) <= self.auto.tolerance:
                    break
            share = 0.5 * (1.0 + share)
        return {n: k + max(2, round(SPARE * k)) if n in whole else k for n, k in met.items()}

    def largest(self, problem: ReducedProblem) -> Projection:
        """The model with as many atoms as there may be. Sets the projection errors of each block by
        the number of atoms, and the largest ones allowed (`targets`)."""
        most = dict.fromkeys(self.sources, self.auto.most)
        whole = made(self.options("galerkin", most)).project(problem)
        self.projection_errors = {
            n: self.ref.projection(n, d) for n, d in whole.dictionaries.items()}
        self.targets = dict.fromkeys(self.sources, SAFE * self.auto.tolerance)
        return whole

    def sized(
        self, whole: Projection, least: Mapping[str, int], said: str = ""
    ) -> dict[str, int]:
        """Numbers of atoms, at least those of `least`, that meet the tolerance, among those of the
        largest model `whole`: they grow from trial run to trial run, of ECSW where that may pay,
        else of Galerkin projection. said: what its bases have learned, "" for the whole training
        run."""
        total = {n: d.atoms.shape[1] for n, d in whole.dictionaries.items()}
        counts = {n: min(max(self._needed(n), least.get(n, 1)), total[n]) for n in total}
        if self._ecsw_may_pay(whole, counts):
            return self._sized_by_ecsw(whole, counts, total, said)
        self.tau = 0.0
        for attempt in range(ATTEMPTS):
            trial = self._trial_run(whole.leading(counts), f"galerkin{said and ', '}{said}", said)
            more = self._more_atoms(counts, total, trial, TIGHTER)
            if more == counts or attempt + 1 == ATTEMPTS:
                break
            counts = more
        if not said:  # atoms beyond the option `count` of a basis
            self.lead = {n: max(0, k - self.auto.most) for n, k in total.items()}
        return counts

    def without_weights(self, why: str) -> None:
        """Rejects ECSW, for a reason."""
        self.tau, self.rejected = 0.0, f"ecsw was rejected: {why}"

    def _learns(self, name: str) -> bool:
        """True if the basis of a block learns from snapshots."""
        return name not in self.moving and name not in self.ref.constant

    def _needed(self, name: str) -> int:
        """Smallest number of atoms whose projection error meets the block's target; all if none
        does."""
        met = np.flatnonzero(self.projection_errors[name][1:] <= self.targets[name])
        return int(met[0]) + 1 if met.size else len(self.projection_errors[name]) - 1

    def _more_atoms(
        self, counts: Mapping[str, int], total: Mapping[str, int], trial: TrialRun, aim: float
    ) -> dict[str, int]:
        """Numbers of atoms after a trial run: more in blocks that are not accurate enough, and in
        the temperatures that act on them. aim: share of its limit to which an error shall fall;
        the targets, largest projection errors allowed, are lowered by as much."""
        # share: of the tolerance that errors may reach, on what is held out or over the whole run;
        # factors: block -> factor of its target
        share, factors = HELD_OUT if trial.holdout else SAFE, dict[str, float]()
        limit = share * self.auto.tolerance
        for name, error in trial.errors.items():
            for each in {name, self.heat.get(name, name)} if error > limit else ():
                factor = max(aim * limit / error, TIGHTER)
                factors[each] = min(factor, factors.get(each, 1.0))
        more = dict(counts)
        for name, factor in factors.items():
            self.targets[name] *= factor
            more[name] = min(max(self._needed(name), counts[name] + 1), total[name])
        return more

    def _trial_run(self, projection: Projection, method: str, said: str) -> TrialRun:
        """Trial run of a method with this projection, added to `trials`; its states are kept in
        `last` if its errors are within the tolerance. said: what its bases have learned, "" for
        the whole training run, of which nothing is held out then."""
        try:
            solver = projection.solver()
            trial, states = self.ref.run(method, solver, bool(said))
            accurate = max(trial.errors.values()) <= self.auto.tolerance
            self.last = solver, states if accurate else ()
        except SolveFailed:  # dependent atoms
            self.last = None
            atoms = {n: d.atoms.shape[1] for n, d in projection.dictionaries.items()}
            trial = TrialRun(method, atoms, dict.fromkeys(atoms, np.inf), {}, None)
        self.trials.append(trial)
        return trial

    def _ecsw_may_pay(self, whole: Projection, counts: Mapping[str, int]) -> bool:
        """True if local terms have so many elements that their hyper-reduction may pay."""
        model = self.problem.model
        local = any(b.local for b in model.separated.heat) or model.separated.elastic_local
        if not local or self.rejected or model.separated.other and Ecsw().check(model):
            return False
        touched = sum(whole.leading(counts).solver().elements_touched.values())
        return touched > WORTH * sum(counts.values()) and not Ecsw().check(model)

    def _sized_by_ecsw(
        self, whole: Projection, counts: dict[str, int], total: Mapping[str, int], said: str
    ) -> dict[str, int]:
        """Numbers of atoms with which ECSW meets the tolerance, from `counts` up to `total`; said:
        what the bases have learned, "" for the whole training run. Each attempt trains weights of
        its own, to the tolerance `tau`; where the first part of the training run has been tried,
        the whole is tried once."""
        if self.tau and not said:
            self._trial_run(
                self._ecsw_model(whole, counts, part=False), f"ecsw, tau {self.tau:.1g}", said="")
            return counts
        self.tau = 0.1 * self.auto.tolerance
        for attempt in range(WEIGHINGS):
            projection = self._ecsw_model(whole, counts, part=bool(said))
            method = f"ecsw, tau {self.tau:.1g}{said and ', '}{said}"
            trial = self._trial_run(projection, method, said)
            # shares of its limit to which an error is to fall; less far on the first part, since
            # more atoms need more elements
            more = self._more_atoms(counts, total, trial, NEARER if said else TIGHTER)
            if more == counts or attempt + 1 == WEIGHINGS:
                break
            counts, self.tau = more, max(0.1 * self.tau, 1e-8)
        return counts

    def _ecsw_model(
        self, whole: Projection, counts: Mapping[str, int], part: bool
    ) -> Projection:
        """ECSW model on the leading atoms. part: with bases of the first part of the training run,
        and as large a part of the states from which weights are trained."""
        options, problem = self.options("ecsw", counts), whole.problem
        reducer = Ecsw(**{k: v for k, v in options.items() if k != "use"})
        if not part:
            return reducer.project(problem)
        # states: number of those from which weights are trained; learned: share of the first part
        states = max(2, round(self.ref.learned * reducer.states))
        reducer = reducer.model_copy(update={"states": states})
        leading = whole.leading(counts)
        return replace(leading, reducer=reducer, approximation=reducer.approximation(
            problem.model, leading.dictionaries, problem.offline, problem.step))

    def choice(self, counts: Mapping[str, int]) -> Choice:
        """The chosen reducer, and what speaks for and against it: errors of the last trial runs
        within the tolerance (reasons) or above it (doubts), and how projection errors fall. tau:
        tolerance of ECSW weights, 0 for Galerkin projection; rejected: why ECSW was."""
        tolerance = self.auto.tolerance
        reasons = [self.rejected] if self.rejected else []
        doubts: list[str] = []
        held = next((t for t in reversed(self.trials) if t.holdout), None)
        last, several = self.trials[-1], self.ref.runs > 1
        for trial, errors, where in (
                (held, held.holdout if held else {}, "on the training run that was held out"
                 if several else "on the part of the training run that was held out"),
                (last, last.errors, f"over the {'last ' if several else ''}training run")):
            if trial is None or not errors:
                continue
            name = max(errors, key=lambda n: errors[n])
            text = (f"{trial.method}: largest error {where} {errors[name]:.1e} ({name}), "
                    f"{errors[name] / tolerance:.2g} of the tolerance")
            (reasons if errors[name] <= tolerance else doubts).append(text)
        if self.moving:
            reasons.append(f"loads move over {', '.join(self.moving)}: atoms of the load tables, "
                           "which need no training")
        for name, fall in self.projection_errors.items():  # fall: error by number of atoms, 0 first
            k = counts[name]
            ten = np.flatnonzero(fall[k:] <= 0.1 * fall[k])  # further atoms for a tenth of it
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
