"""The paper's step: select atoms, then solve on the support with prepared arrays."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import (
    Dictionary,
    SparseSolver,
    SparseStart,
    State,
    StepFormula,
    StepOutcome,
)
from sparsemor.core.status import Status
from sparsemor.reducers.sampled import RankDeficient, SampledElastic, SampledHeat, numbers
from sparsemor.reducers.selection import HeatProblem, MechanicsProblem
from sparsemor.reducers.stepper import Memory, Stepper

KEPT = 32
"""Prepared supports kept per run: a support often comes back."""


class SparseMemory(Memory):
    """Adds the stepper of the current supports; prepared arrays are rebuilt after unpickling."""

    def __init__(self, x: FloatArray, points: int) -> None:
        super().__init__(x, points)
        self.step = 0
        self.prepared: dict[tuple[str, bytes], Any] = {}
        self.current: Stepper | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "prepared": {}, "current": None}


@dataclass(frozen=True, slots=True, eq=False)
class SparseStepper:
    """StepSolver that carries a support. base: a Stepper whose blocks without selection are
    prepared; heat, elastic: the blocks where a budget is smaller than the dictionary.

    every: steps between selections; carried: whether one starts from the last support; polish:
    whether the step is solved again on the selected support, with exact border rows.
    """

    base: Stepper
    heat: Mapping[str, SampledHeat]
    elastic: Mapping[str, SampledElastic]
    solver: SparseSolver
    every: int
    carried: bool
    polish: bool

    @property
    def layout(self) -> Layout:
        return self.base.layout

    @property
    def dictionaries(self) -> Mapping[str, Dictionary]:
        return self.base.dictionaries

    @property
    def rows(self) -> Mapping[str, IntArray]:
        return self.base.rows

    @property
    def elements_touched(self) -> Mapping[str, int]:
        return self.base.elements_touched

    @property
    def notes(self) -> tuple[str, ...]:
        return self.base.notes

    def start(self, state: State) -> tuple[State, SparseMemory]:
        reduced = self.base.reduced(state)
        memory = SparseMemory(reduced.x, self.base.points)
        memory.factorizations = self.base.factorizations
        blocks = [h.block for h in self.heat.values()] + [e.block for e in self.elastic.values()]
        for block in blocks:
            memory.supports[block.name] = np.zeros(block.atoms, dtype=np.bool_)
        return reduced, memory

    def solve(self, step: StepFormula, memory: SparseMemory) -> tuple[StepOutcome, SparseMemory]:
        due = memory.step % self.every == 0
        memory.step += 1
        try:
            if due:
                found = self._select(step, memory)
                if not found.status.ok:
                    return found, memory
                if not self.polish and self.elastic:  # else the mechanics are not solved yet
                    return self.base.accepted(found, memory), memory
            if memory.current is None:
                memory.current = self._prepared(memory)
        except RankDeficient as error:
            x = memory.ring.predict()
            return StepOutcome(x, Status.RANK_DEFICIENT, 0, error.block, error.detail), memory
        outcome, _ = memory.current.solve(step, memory)
        return outcome, memory

    def _select(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """New supports for this step, and the solvers' own solution; heat first, because its
        temperatures load the bodies."""
        x, iterations = memory.ring.predict(), 0
        found: dict[str, BoolArray] = {}
        for body in self.base.separated.heat:
            name, at = body.thermal, self.layout[body.thermal]
            if name not in self.heat:
                x[at] = self.base.heat[name].solve(step.r1[at], step.t, x[at]).T
                continue
            problem = HeatProblem.at(self.heat[name], step.r1[at], step.t)
            first = self._first(memory.supports[name])
            out = self.solver.solve(problem, SparseStart(np.where(first, x[at], 0.0), first))
            if not out.status.ok:
                return StepOutcome(x, out.status, out.iterations, name, "selection of atoms")
            found[name], x[at] = out.support, out.c
            iterations = max(iterations, out.iterations)
            # temperatures out of bounds would only show in the bodies that they load
            insane = self.base.insane(x, name)
            if insane is not None:
                return insane
        if self.elastic:
            mechanics = self._select_elastic(step, x, memory, found)
            if not mechanics.status.ok:
                return mechanics
            iterations = mechanics.iterations
        changed = False
        for name, support in found.items():
            if not np.array_equal(support, memory.supports[name]):
                memory.supports[name] = support
                memory.support_changes += 1
                changed = True
        if changed:
            memory.current = None
            memory.ring.restart()
        return StepOutcome(x, Status.DONE, iterations)

    def _select_elastic(
        self, step: StepFormula, x: FloatArray, memory: SparseMemory, found: dict[str, BoolArray]
    ) -> StepOutcome:
        """One joint problem of all elastic blocks; x gets its solution."""
        mechanics = self.base.mechanics
        assert mechanics is not None
        sampled = [self.elastic.get(b.elastic_name) for b in mechanics.bodies]
        problem = MechanicsProblem(mechanics, sampled, step, x)
        c = problem.start()
        support = np.ones(len(c), dtype=bool)
        for g in problem.groups[:-1]:
            support[g.start : g.stop] = self._first(memory.supports[g.name])
        out = self.solver.solve(problem, SparseStart(c, support))
        if not out.status.ok:
            detail = f"selection of atoms, residual {out.residual_norm:.1e}"
            return StepOutcome(x, out.status, out.iterations, problem.groups[0].name, detail)
        for g in problem.groups[:-1]:
            found[g.name] = out.support[g.start : g.stop]
            x[self.layout[g.name]] = out.c[g.start : g.stop]
        y, nr = out.c[problem.k :], mechanics.n_rigid
        x[:nr], x[mechanics.algebraic] = y[:nr], y[nr:]
        return StepOutcome(x, Status.DONE, out.iterations)

    def _first(self, support: BoolArray) -> BoolArray:
        """The support that a selection starts from."""
        return support if self.carried else np.zeros_like(support)

    def _prepared(self, memory: SparseMemory) -> Stepper:
        heat, elastic = dict(self.base.heat), dict(self.base.elastic)
        for name, h in self.heat.items():
            heat[name] = self._block(name, h, memory)
        for name, e in self.elastic.items():
            elastic[name] = self._block(name, e, memory)
        s = replace(self.base, heat=heat, elastic=elastic)
        return replace(s, mechanics=s.with_mechanics())

    def _block(self, name: str, source: Any, memory: SparseMemory) -> Any:
        support = memory.supports[name]
        key = (name, support.tobytes())
        if key not in memory.prepared:
            if len(memory.prepared) >= KEPT:
                memory.prepared.pop(next(iter(memory.prepared)))
            memory.prepared[key] = source.prepared(numbers(support))
            memory.factorizations += 1
        return memory.prepared[key]

    def supports(self, memory: SparseMemory) -> Mapping[str, BoolArray]:
        return memory.supports

    def counters(self, memory: SparseMemory) -> Mapping[str, int]:
        return self.base.counters(memory)
