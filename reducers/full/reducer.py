"""Full-order reducer: constant matrices factorized once, Schur complement for rigid coordinates and
multipliers."""

from dataclasses import replace
from typing import Literal

from sparsemor.core import AssembledModel, ReducedProblem, StepSolver
from sparsemor.reducers.block_counts import coupling, elements
from sparsemor.reducers.reducer_notes import local_heat_notes, whole_step_notes
from sparsemor.reducers.reducer_options import StepOptions
from sparsemor.reducers.step.blockwise_solver import stepper
from sparsemor.reducers.step.compiled.compiled_stepper import compilable
from sparsemor.reducers.step.coupled_reduced import (
    ProjectedModel,
    dense_equations,
    reduced_general,
)
from sparsemor.reducers.step.frame_step import PrescribedFactors
from sparsemor.reducers.step.monolithic_step import WholeNewton, WholeStepper
from sparsemor.reducers.step.newton_loop import Loop
from sparsemor.reducers.step.reduced_equations import positions
from sparsemor.reducers.step.reduced_mechanics import LoopMechanics
from sparsemor.reducers.step.thermal_groups import group_name

PRICE = 6
"""Cost of a new Jacobian of all unknowns in iterations."""


class Full(StepOptions):
    """Full-order model: all unknowns and all equations, the reference of every comparison."""

    method: Literal["bordered", "newton"] = "bordered"
    """`bordered`: constant blocks factorized once, or, where a term such as a contact couples them,
    one Jacobian of all unknowns, reused while convergence is fast. `newton`: the whole Jacobian
    factorized again in each iteration, the textbook method, kept as a check."""

    def restart_refusal(self) -> str:
        return ""

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        """Step solver of the full-order model: for all unknowns together (`newton`, or terms that
        couple blocks), for rigid bodies alone, or block by block with factorized operators."""
        # imported by full-order runs, not by each scene whose training run is one by default
        from sparsemor.reducers.full.heat import full_heat
        from sparsemor.reducers.full.mechanics import FullBody, FullMechanics
        from sparsemor.reducers.full.monolithic import Summed

        model, integrator, h = problem.model, problem.integrator, problem.step
        tol = self.tolerances
        if self.method == "newton":  # 0: a new Jacobian in each iteration
            return self._whole(model, 0, "method: newton solves for all unknowns together")
        if not model.reducible():  # rigid bodies only: a few unknowns
            rigid = ProjectedModel(model)
            if model.separated.other:
                return reduced_general(rigid, tol, self.predictor)
            made = stepper(model, model.layout, dictionaries={}, rows={}, heat={}, tol=tol,
                           points=self.predictor, factorizations=0)
            return compilable(made.with_equations(dense_equations(rigid)), self.compiled)
        if model.separated.other:
            names = ", ".join(sorted({n for n, _ in coupling(model) if n})) or "a term"
            return self._whole(model, PRICE, f"{names} couples blocks inside the step")
        c1, c2, c1_first = integrator.rules(h).factors
        heat = {group_name(group): full_heat(model, group, c1_first)
                for group in model.separated.heat_groups}
        done = len(heat)  # number of factorizations
        visited = {b.thermal: sum(t.elements for t in b.local) for b in model.separated.heat}
        visited |= {m.elastic: sum(part.term.elements for part in m.operators.local)
                    for m in model.separated.moving if m.operators is not None}
        made = stepper(model, model.layout, dictionaries={}, rows={}, heat={}, tol=tol,
                       points=self.predictor, factorizations=done, notes=local_heat_notes(model),
                       visited=visited)
        bodies = []
        for m, step in zip(model.separated.moving, made.system.bodies, strict=True):
            if (o := m.operators) is None:
                bodies.append(FullBody(step))
                continue
            D = o.stiffness + c1 * o.damping + c2 * o.mass
            driven = not m.to_border.any()  # its motion is prescribed
            bodies.append(FullBody.from_operators(
                step, o, model.factorize(m.elastic, D),
                PrescribedFactors.table(step, m) if driven else None))
            done += 1
        equations = FullMechanics(model.layout, bodies, model.separated.border_targets,
                                  positions(model.layout))
        made = replace(made, mechanics=LoopMechanics(equations, tol), factorizations=done,
                       full_heat=heat, loop=Loop(model.layout, tol), iterative=equations.iterates)
        # newton: for steps where the iterations by blocks fail. Not with iterative solvers, which
        # are chosen where the factor of one body is too large, so that the model's would be, too
        if not made.iterative:
            made = replace(made, newton=WholeNewton(lambda: Summed.from_model(model, PRICE), tol))
        return compilable(made, self.compiled)

    def _whole(self, model: AssembledModel, price: int, why: str) -> WholeStepper:
        """Newton solver for all unknowns together; price: see `StepEquations`; why: the reason, for
        notes."""
        from sparsemor.reducers.full.monolithic import Summed

        return WholeStepper(
            Summed.from_model(model, price), Loop(model.layout, self.tolerances),
            elements(model, model.terms, [t.rows for t in model.terms]), self.predictor,
            notes=whole_step_notes(model, why))
