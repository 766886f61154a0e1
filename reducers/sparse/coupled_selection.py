"""Selection of atoms by the problems of Eq. 25 of the paper: each thermal block on its own, then
all elastic blocks together with rigid coordinates and joint forces in one nonlinear problem."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    SparseOutcome,
    SparseSolver,
    SparseStart,
    Status,
    StepFormula,
    StepOutcome,
)
from sparsemor.core.registry.returned_values import checked_return
from sparsemor.reducers.sparse.recovery_problem import HeatProblem, MechanicsProblem
from sparsemor.reducers.sparse.sparse_memory import SparseMemory
from sparsemor.reducers.sparse.supported_steps import (
    AtomSelection,
    SolvedStep,
    SupportOf,
    no_selection,
    take,
)
from sparsemor.reducers.step.reduced_mechanics import StepUnknowns


@dataclass(frozen=True, slots=True, eq=False)
class JointSelection(AtomSelection):
    """Selection by the sparse solver's own `solve`, in full in every step.

    carried: blocks that start from the support of the previous step, the others start from the
    empty one; polish: solve the step again on the selected supports. With both, a selection starts
    from the step's solution on the previous supports, and replaces them only where it lowers the
    residual norm by the fraction `hysteresis`.
    """

    solver: SparseSolver
    carried: frozenset[str]
    polish: bool

    def solve(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """A step that starts from the supports of the last one where it has a solution on them,
        otherwise from the predicted state. polish: the step is solved again on the selected
        supports; without, the solution of the sparse solver is that of the step."""
        # before the first step all supports are empty
        if self.polish and self.carried and all(s.any() for s in memory.supports.values()):
            outcome = self.reselected(step, memory, memory.supports)
            if outcome is not None:  # there was a solution on these supports
                return outcome
        found = self._predicted(step, memory)
        if not found.status.ok:
            return found
        if not self.polish and self.steps.elastic:  # else the mechanics are not solved yet
            return self.steps.base.accepted(found, step, memory)
        return self.steps.current(memory).solve(step, memory)[0]

    def thermal(self, at: SolvedStep, memory: SparseMemory) -> dict[str, BoolArray]:
        """Other supports of thermal blocks, each by the problem of its own."""
        changed, x = {}, at.outcome.x
        for name in self.steps.heat:
            support, here = at.supports[name], x[self.steps.base.layout[name]]
            problem = self._heat(name, at.step)
            out = self._sparse_solution(problem, SparseStart(np.where(support, here, 0.0), support))
            if not np.array_equal(out.support, support) and self._better(
                    out, problem.residual(here)):
                changed[name] = out.support
        return changed

    def elastic(self, at: SolvedStep, memory: SparseMemory) -> dict[str, BoolArray]:
        """Other supports of the elastic blocks, by their joint problem; its last group, the border,
        has none."""
        if not self.steps.elastic:
            return {}
        problem, start = self._mechanics(at.step, at.outcome.x, at.supports, memory)
        out = self._sparse_solution(problem, start)
        changed = {g.name: out.support[g.start : g.stop] for g in problem.groups[:-1]
                   if not np.array_equal(out.support[g.start : g.stop], at.supports[g.name])}
        return changed if changed and self._better(out, problem.residual(start.c)) else {}

    def _better(self, out: SparseOutcome, now: FloatArray) -> bool:
        """True if the result replaces a support with the residual `now`."""
        return out.residual_norm < (1.0 - self.hysteresis) * float(np.linalg.norm(now))

    def _predicted(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """Solution of the sparse solver for the step predicted from past ones, whose supports
        replace those in `memory`: heat first, then all elastic blocks with the border, rigid
        coordinates and joint forces. A failure where temperatures exceed their limits. x (n,): the
        prediction, in which each solution replaces its unknowns; problem.groups: ranges of the
        blocks in the problem, the border last, after problem.k coefficients."""
        base, iterations = self.steps.base, 0
        now = StepUnknowns(step, memory.past.guess(step))
        x = step.free + now.d
        found: dict[str, BoolArray] = {}
        for name, at in base.heat_groups:
            if name not in self.steps.heat:  # all its atoms are active: no selection
                # increments of all temperatures from the predicted ones
                x[at] += base.heat[name].solve(
                    *now.temperatures(at), step.t, step.c2_first).d
                continue
            support = self._first(name, memory)  # of the last step, or empty without warm start
            out = self._sparse_solution(
                self._heat(name, step), SparseStart(np.where(support, x[at], 0.0), support))
            found[name], x[at] = out.support, out.c
            iterations = max(iterations, out.iterations)
            # temperatures out of bounds would only show in the bodies that they load
            failed = base.beyond_limits(x, [name])
            if failed is not None:
                return failed
        if self.steps.elastic:
            first = {n: self._first(n, memory) for n in self.steps.elastic}
            problem, start = self._mechanics(step, x, first, memory)
            out = self._sparse_solution(problem, start)
            for g in problem.groups[:-1]:
                found[g.name] = out.support[g.start : g.stop]
                x[base.layout[g.name]] = out.c[g.start : g.stop]
            x[problem.rows.border] = out.c[problem.k :]
            iterations = out.iterations  # of the mechanics, where there are any
        if take(found, memory):  # a support differs from the last step's
            memory.past.restart()  # coefficients may have jumped: the past is no guide
        return StepOutcome(x, Status.DONE, iterations, rates=step.at(x - step.free)[1:])

    def _first(self, name: str, memory: SparseMemory) -> BoolArray:
        """Initial support of the selection in a block."""
        support = memory.supports[name]
        return support if name in self.carried else np.zeros_like(support)

    def _heat(self, name: str, step: StepFormula) -> HeatProblem:
        at = self.steps.base.layout[name]
        return HeatProblem.at(self.steps.heat[name], step.r1[at], step.t)

    def _mechanics(
        self, step: StepFormula, x: FloatArray, supports: SupportOf, memory: SparseMemory
    ) -> tuple[MechanicsProblem, SparseStart]:
        """Problem of all elastic blocks together, and its start: first guess from the state x (n,),
        and these supports; rigid coordinates and joint forces, the last group, are always active.
        Its residual is that of all sampled rows of mechanics, at the temperatures in x."""
        problem = MechanicsProblem(self.steps.mechanics.working(memory).rows.rows,
                                   list(self.steps.elastic.values()), step, x)
        c = problem.start()
        support = np.ones(len(c), dtype=np.bool_)
        for g in problem.groups[:-1]:
            support[g.start : g.stop] = supports[g.name]
        return problem, SparseStart(c, support)

    def _sparse_solution(
        self, problem: HeatProblem | MechanicsProblem, start: SparseStart
    ) -> SparseOutcome:
        """Result of the sparse solver. Raises SolveFailed where it fails."""
        out = checked_return(self.solver.solve(problem, start), SparseOutcome, self.solver,
                             "solve", "reducer.solver")
        if not out.status.ok:
            raise no_selection(
                problem.groups[0].name, out.status, f"residual {out.residual_norm:.1e}")
        return out
