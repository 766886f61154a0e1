"""Balance of the heat that a run brought into its bodies and that they stored."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core import (
    BoolArray,
    Check,
    Findings,
    FloatArray,
    Note,
    OnStep,
    PreparedRun,
    RunResult,
    State,
    Term,
)
from sparsemor.core.model.equations import AssembledTerm
from sparsemor.core.model.linear_equations import LinearEquations, TabledEquations
from sparsemor.core.protocols.integrator import differences, second_difference
from sparsemor.core.protocols.step_amplitude import Substep, substep
from sparsemor.core.protocols.time_function import Held
from sparsemor.plugins.checks import place

HEAT_BALANCE = "heat_balance"
"""Kind of the note."""
NOTED = 0.01
"""Heat that does not balance, relative to what came, went or was stored, above which a note says
so."""
LEAST = 0.01
"""Change of the mean temperature of a body by that heat, K, below which no note does."""
SMALLEST = 1e-6
"""Change of the mean temperature of a body, K, of which heat that does not balance is a share at
least: what is smaller is round-off."""
SAMPLES = 32
"""Number of steps at which residuals are looked at where local terms are too expensive for all."""
TIMES, ROUNDING = 5, 1e-9
"""Number of times at which a local term is asked for its power, and share of it that is none."""
LARGEST, AMPLITUDES = 20_000, 50_000
"""Number of full-order unknowns above which residuals are not looked at, and number of values of
functions of time above which there is no balance."""


@dataclass(frozen=True, slots=True)
class Balance:
    """Heat of one block, J. stored: H(T_N) - H(T_0) of its free nodes, with prescribed temperatures
    as at the end in both; brought_in: by all that acts on it, flows to nodes with prescribed
    temperatures included; rest: the part of their difference that the integrator's formula does not
    explain; size: of what came, went or was stored; capacity: J/K."""

    stored: float
    brought_in: float
    rest: float
    size: float
    capacity: float

    @property
    def share(self) -> float:
        """The rest relative to what came, went or was stored."""
        return abs(self.rest) / self.size if self.size > 0.0 else 0.0


class HeatBalance(Check):
    """Balance of the heat that came into each body and that it stored."""

    order = place("heat_balance")
    _sums: "HeatSums | None" = None

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        self._sums = HeatSums.from_run(run, state if whole else None)
        return None if self._sums is None else self._sums.take

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        found = {} if self._sums is None else self._sums.found()
        return Findings(heat_notes(found, bool(run.solver.dictionaries)),
                        {"heat_balance": in_result(found)})


class HeatSums:
    """Sums over the steps of a run from which its balance of heat follows.

    Summed over the rows of a body, conduction cancels but for prescribed temperatures, and each
    step n says: rate of storage S_n = power Q_n of all that acts on it. With h the step,

        sum of h Q_n = H(T_N) - H(T_0) + E,   E = 0 (BDF1),
        E = (H(T_N) - H(T_(N-1)) - h c(T_0) T_0')/2 (BDF2: half a step of delay).

    H is evaluated at the ends alone. Where all powers are linear in the temperatures, as those of
    fluxes and films, their sum follows from the sums of the (reduced) temperatures and of the
    functions of time, and costs the same on each mesh. Where local terms such as radiation bring
    heat, and in reduced runs with any, the rest is that of the residuals h (S_n - Q_n) of some
    states, summed over all rows, and what was brought in follows.
    """

    def __init__(self, run: PreparedRun, state: State, formula: int) -> None:
        """state: first state of the run; formula: 1 (BDF1) or 2 (BDF2), the order of differences of
        the integrator.

        layout: of the full-order unknowns; names, starts: thermal blocks and their first unknowns;
        at: unknowns of temperatures in the step solver; sum, begin, before, end: sum of its
        unknowns over the steps, first, last but one and last state; terms: in thermal rows only;
        sampled: True where the residuals of the steps `looked` are needed, which are summed in
        `residuals`; kept: states at both ends of those steps in a reduced run; means: how the mean
        temperature of each block follows from unknowns of the solver (`_mean_of`), which is taken
        every `every` steps, K, into `sampled_means`.
        """
        assert run.model is not None
        self.run, self.layout, self.formula = run, run.model.layout, formula
        self.h, self.steps = run.scene.time.step, run.steps
        first = self.layout.first
        self.names = [b.name for b in self.layout if first.start <= self.layout[b.name].start
                      and self.layout[b.name].stop <= first.stop]
        self.starts = np.array([self.layout[n].start for n in self.names])
        self.at = run.solver.layout.first
        self.sum, self.begin, self.before, self.end = state.x[self.at] * 0.0, state, state, state
        heated = [(t, np.flatnonzero((t.rows >= first.start) & (t.rows < first.stop)))
                  for t in run.model.terms]
        self.terms: list[Term] = [t.restrict(keep) for t, keep in heated if len(keep)]
        local = [t for t in self.terms if not self._summed(t)]
        self.reduced = bool(run.solver.dictionaries)
        held = any(shape.given for shape in run.given.values())  # stores by prescribed rates, too
        self.sampled = bool(local) and (self.reduced or held or any(map(self._brings, local)))
        count = min(SAMPLES, self.steps if self.reduced else max(1, self.steps // 10))
        self.looked = {round(self.steps * (i + 1) / count) for i in range(count)} if (
            self.sampled) else set()
        self.kept: list[tuple[State, State]] = []
        self.residuals = np.zeros(len(self.names))
        self.means = [self._mean_of(n) for n in self.names]
        self.every, self.sampled_means = max(1, self.steps // SAMPLES), [self._mean(state)]

    @classmethod
    def from_run(cls, run: PreparedRun, start: State | None) -> "HeatSums | None":
        """The balance of a run from its first state; None where there is none: without heat, for
        steps of controlled error, runs without their model, with other loads than the model's or
        controllers (not own_loads), or resumed (`start` None), large reduced models that need
        residuals of steps (`sampled`), and integrators that are no differences of earlier
        temperatures."""
        if (start is None or run.model is None or not run.own_loads
                or run.scene.time.control is not None
                or run.model.layout.first.stop == run.model.layout.first.start):
            return None
        formula = differences(run.scene.integrator)
        made = cls(run, start, formula) if formula else None
        if made is not None and made.sampled and made.reduced and made.layout.size > LARGEST:
            return None
        return made

    def _mean_of(self, name: str) -> tuple[slice, FloatArray, float]:
        """Unknowns of a block, and weights and constant with which they give its mean
        temperature."""
        at, d = self.run.solver.layout[name], self.run.solver.dictionaries.get(name)
        if d is None:
            return at, np.full(at.stop - at.start, 1.0 / max(1, at.stop - at.start)), 0.0
        return at, d.atoms.mean(axis=0), float(d.offset.mean())

    def _mean(self, state: State) -> list[float]:
        """Mean temperature of each block in a state, K."""
        return [float(w @ state.x[at]) + constant for at, w, constant in self.means]

    def _inside(self, term: Term) -> bool:
        """True if a term reads temperatures only."""
        first = self.layout.first
        return bool(((term.columns >= first.start) & (term.columns < first.stop)).all())

    def _summed(self, term: Term) -> bool:
        """True if the sum of a term over the steps follows from sums of temperatures and of
        functions of time."""
        return isinstance(term, AssembledTerm) and self._inside(term) and isinstance(
            term.equations, LinearEquations | TabledEquations)

    def _brings(self, term: Term) -> bool:
        """True unless a term only stores or conducts heat inside of one body, at temperatures that
        vary in space."""
        if not self._inside(term):
            return True
        j, zero = term.columns, np.zeros(len(term.columns))
        x = self.begin.x[j] + np.sin(np.arange(1.0, len(j) + 1.0))
        found = (term.residual(x, zero, zero, t)
                 for t in np.linspace(0.0, self.h * self.steps, TIMES))
        return any(bool((abs(self._of_blocks(term, r)) > ROUNDING * abs(r).sum()).any())
                   for r in found)

    def take(
        self, done: int, before: State, state: State, active: Mapping[str, BoolArray]
    ) -> None:
        """Looks at the step that ended at `state` after `done` steps, from the state `before`: adds
        its temperatures, unknowns `at`, to `sum`, and in the steps `looked` keeps both states of a
        reduced run, or adds the residual of the equations between them."""
        self.sum += state.x[self.at]
        self.before, self.end = before, state
        if done % self.every == 0:
            self.sampled_means.append(self._mean(state))
        if done in self.looked and self.reduced:
            self.kept.append((before, state))
        elif done in self.looked:
            self._add_residual(before, state)

    def _powers(
        self, term: Term, x: FloatArray, v: FloatArray, a: FloatArray, t: float, rates: float
    ) -> FloatArray:
        """Residual of a term summed over each block (blocks,), W, with the rates of temperatures
        times the factor `rates` (0: without storage)."""
        j, heated = term.columns, self.layout.first
        factor = np.where((j >= heated.start) & (j < heated.stop), rates, 1.0)
        with substep(Substep(self.h)):
            r = term.residual(x[j], factor * v[j], factor * a[j], t)
        return self._of_blocks(term, r)

    def _of_blocks(self, term: Term, r: FloatArray) -> FloatArray:
        """Sum of the rows of a term in each block (blocks,)."""
        block = np.searchsorted(self.starts, term.rows, side="right") - 1
        return np.asarray(np.bincount(block, r, minlength=len(self.names)), dtype=np.float64)

    def _stored(self, old: State, new: State) -> FloatArray:
        """H(T) - H(T_0) (blocks,), J: the formula of the integrator, with T_0 for all earlier
        temperatures."""
        at, h = self.layout.first, self.h
        # BDF1: T' = (T_n - T_(n-1)) / h; BDF2: 3/2 of that with T_(n-1) = T_(n-2) = T_0
        gain = 1.5 if self.formula == 2 else 1.0
        v, a = 0.0 * new.x, 0.0 * new.x
        v[at] = gain * (new.x - old.x)[at] / h
        a[at] = (gain - 1.0) * 2.0 * (new.x - old.x)[at] / h**2
        # storage: residual with the rates of temperatures, less that without
        return sum((self._powers(t, new.x, v, a, self.end.t, 1.0)
                    - self._powers(t, new.x, v, a, self.end.t, 0.0)
                    for t in self.terms), np.zeros(len(self.names))) * h / gain

    def _rates(self, at: State, v: FloatArray, terms: Sequence[Term]) -> FloatArray:
        """Rates of storage c(T) T' (blocks,), W, of some terms at temperatures and rates."""
        zero = 0.0 * v
        found = np.zeros(len(self.names))
        for term in terms:
            j = term.columns
            found += self._of_blocks(term, term.residual(
                at.x[j], v[j], zero[j], at.t) - term.residual(at.x[j], zero[j], zero[j], at.t))
        return found

    def found(self) -> Mapping[str, Balance]:
        """Block -> its balance, after the last step; empty where it is not known."""
        with np.errstate(all="ignore"):
            return self._found()

    def _found(self) -> Mapping[str, Balance]:
        """Block -> its balance over the run, with the brought-in heat by sums over the steps where
        terms are linear in temperatures, else from sampled residuals (`sampled`); {} where it would
        take too many values of functions. delay: E of the class."""
        N, h = self.steps, self.h
        summed = [t for t in self.terms if self._summed(t)]
        functions = {id(f) for t in summed if isinstance(t, AssembledTerm) and isinstance(
            t.equations, LinearEquations) for f in t.equations.amplitudes}
        if N * len(functions) > AMPLITUDES or not N:
            return {}
        begin, before, end = (self.run.full_order(s) for s in (self.begin, self.before, self.end))
        mean = self.end.x.copy()
        mean[self.at] = self.sum / N
        # one state with the mean temperatures of the run gives the sums of terms linear in them
        flows = self._sums(summed, self.run.full_order(replace(self.end, x=mean)).x)
        stored = self._stored(begin, end)
        stored_back = self._stored(end, begin)
        delay = np.zeros(len(self.names))
        if self.formula == 2:
            start_rates = 0.0 * begin.v
            start_rates[self.layout.first] = begin.v[self.layout.first]
            delay = 0.5 * (
                self._stored(before, end) - h * self._rates(begin, start_rates, self.terms))
        unit_rates = 0.0 * end.x
        unit_rates[self.layout.first] = 1.0
        constant_terms = [t for t in self.terms if t.linear]  # without latent heat
        capacity = self._rates(end, unit_rates, constant_terms)
        if self.sampled:
            for past, now in self.kept:
                self._add_residual(past, now)
            rest = self.residuals * h * N / len(self.looked)
            brought_in = stored + delay - rest
        else:
            brought_in = sum(flows, np.zeros(len(self.names)))
            rest = stored + delay - brought_in
        came_in, went_out = (sum((np.maximum(s * f, 0.0) for f in flows), np.zeros(len(self.names)))
                      for s in (1.0, -1.0))
        # reference of the share: what came, went or was stored, or a change of mean temperatures
        size = np.max([came_in, went_out, abs(stored), capacity * np.maximum(
            np.ptp(np.array(self.sampled_means), axis=0), SMALLEST)], axis=0)
        # a storage that is no difference of a content has no H
        known = abs(stored + stored_back) <= 1e-3 * NOTED * np.maximum(abs(stored), size)
        return {name: Balance(stored=float(stored[i]), brought_in=float(brought_in[i] - delay[i]),
                              rest=float(rest[i]), size=float(size[i]),
                              capacity=float(capacity[i]))
                for i, name in enumerate(self.names)
                if known[i] and np.isfinite([stored[i], brought_in[i], rest[i], size[i]]).all()}

    def _sums(self, terms: Sequence[Term], x: FloatArray) -> list[FloatArray]:
        """Heat (blocks,) of each term that is linear in temperatures over the run, J: N h times its
        power at the mean temperatures x (n,) and the means of its functions of time; of a moving
        load (`TabledEquations`) the sum of its table over the steps."""
        N, h, zero = self.steps, self.h, 0.0 * x
        times = np.asarray(h * np.arange(1, N + 1), dtype=np.float64)
        means: dict[int, float] = {}
        heats = []
        for term in terms:
            assert isinstance(term, AssembledTerm)
            equations = term.equations
            if isinstance(equations, TabledEquations):
                ones = np.ones((1, equations.load.columns.shape[0]))
                heat = np.zeros(len(self.names))
                heat[int(np.searchsorted(self.starts, term.rows[0], side="right")) - 1] = (
                    h * float(equations.load.projected(ones).along(times).sum()))
                heats.append(heat)
                continue
            for f in equations.amplitudes:
                if id(f) not in means:
                    means[id(f)] = float(np.mean([f(float(t)) for t in times]))
            with_mean_amplitudes = replace(equations, amplitudes=tuple(
                Held(means[id(f)]) for f in equations.amplitudes))
            # powers are on the right-hand side: minus the residual without storage
            heats.append(-N * h * self._powers(
                replace(term, equations=with_mean_amplitudes), x, zero, zero, self.end.t, 0.0))
        return heats

    def _add_residual(self, past: State, now: State) -> None:
        """Adds S_n - Q_n (blocks,), W, of the step between two states."""
        h, at = self.h, self.layout.first
        old, new = self.run.full_order(past), self.run.full_order(now)
        new.a[at] = second_difference(old.x[at], new.x[at], new.v[at], h)
        for term in self.terms:
            self.residuals += self._powers(term, new.x, new.v, new.a, new.t, 1.0)


def heat_notes(found: Mapping[str, Balance], reduced: bool) -> tuple[Note, ...]:
    """Notes on blocks whose heat does not balance. reduced: True for a run with bases."""
    notes = []
    for name, b in found.items():
        if b.share <= NOTED or abs(b.rest) <= LEAST * b.capacity:
            continue
        cause = ("its atoms cannot hold this heat: take more atoms, another basis or reducer, or "
                 "compare it with full order" if reduced else
                 "the storage of its material is not conserved in these steps: take a smaller "
                 "time.step")
        notes.append(Note(
            f"the heat of {name} does not balance: {b.brought_in:.4g} J came in and {b.stored:.4g} "
            f"J are stored, a rest of {100.0 * b.share:.2g} % of what came, went or was stored "
            f"(noted above {100.0 * NOTED:g} %); {cause}", HEAT_BALANCE))
    return tuple(notes)


def in_result(found: Mapping[str, Balance]) -> Mapping[str, Mapping[str, float]]:
    """Block -> stored and brought in, J, and their difference relative to what came, went or was
    stored, for the summary."""
    return {name: {"stored": b.stored, "brought_in": b.brought_in, "share": b.share}
            for name, b in found.items()}
