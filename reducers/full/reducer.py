"""Full-order reducer: constant matrices factorized once, Schur complement for rigid coordinates and
multipliers."""

from dataclasses import replace
from typing import Literal

from sparsemor.core import AssembledModel, ReducedProblem, StepSolver
from sparsemor.core.protocols import HeatBody
from sparsemor.reducers.full.monolithic import Summed
from sparsemor.reducers.notes import local_heat_notes, whole_step_notes
from sparsemor.reducers.step.blocks.elastic_block import ElasticBlock, FullElastic
from sparsemor.reducers.step.blocks.prescribed_frame_block import FullPrescribed, PrescribedBlock
from sparsemor.reducers.step.blocks.thermal_block import FullHeat, HeatBlock, LocalAt
from sparsemor.reducers.step.blocks.thermal_groups import full_group, group_name
from sparsemor.reducers.step.compiled.stepper import compilable
from sparsemor.reducers.step.coupled_reduced import ProjectedModel, reduced_general
from sparsemor.reducers.step.loop import Loop
from sparsemor.reducers.step.prepare import constants, stepper
from sparsemor.reducers.step.whole_step import TextbookNewton, WholeStepper
from sparsemor.reducers.step_options import StepOptions
from sparsemor.reducers.touched_blocks import coupling, elements


def _alone(model: AssembledModel, b: HeatBody, c1: float) -> FullHeat:
    """Full-order thermal block that is not coupled to other thermal blocks, factorized."""
    at = model.layout[b.thermal]
    local = tuple(LocalAt(t, t.rows - at.start, t.columns - at.start) for t in b.local)
    factor = model.factorize(b.thermal, c1 * b.capacity + b.conductivity)
    return FullHeat(b, c1, factor, local)


class Full(StepOptions):
    """Full-order model: all unknowns and all equations, the reference of every comparison."""

    method: Literal["bordered", "newton"] = "bordered"
    """`bordered`: constant blocks factorized once, or, where a term such as a contact couples them,
    one Jacobian of all unknowns, reused while convergence is fast. `newton`: the whole Jacobian
    factorized again in each iteration, the textbook method, kept as a check."""

    def restart_refusal(self) -> str:
        return ""

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        """Step solver of the full-order model."""
        model, integrator, h = problem.model, problem.integrator, problem.step
        tol = self.tolerances
        if self.method == "newton":
            return self._whole(model, 0, "method: newton solves for all unknowns together")
        if model.separated.other:
            if not model.reducible():  # rigid bodies only: a few unknowns
                return reduced_general(ProjectedModel(model), tol, self.predictor)
            names = ", ".join(sorted({n for n, _ in coupling(model) if n})) or "a term"
            return self._whole(model, 6, f"{names} couples blocks inside the step")
        c1, c2, c1_first = constants(integrator, h)
        heat: dict[str, HeatBlock] = {}
        elastic: dict[str, ElasticBlock | PrescribedBlock] = {}
        kind = FullElastic if model.separated.border_size else FullPrescribed
        done = 0
        for group in model.separated.heat_groups:
            heat[group_name(group)] = (
                full_group(model, group, c1_first) if len(group) > 1 else
                _alone(model, group[0], c1_first))
            done += 1
        for m in model.separated.moving:
            if m.operators is not None:
                o = m.operators
                D = o.stiffness + c1 * o.damping + c2 * o.mass
                elastic[m.elastic] = kind.of(o, model.factorize(m.elastic, D), m.elastic)
                done += 1
        made = stepper(model, model.layout, {}, {}, heat, elastic, tol, self.predictor, done,
                       notes=local_heat_notes(model), visited={
                           b.thermal: sum(t.elements for t in b.local)
                           for b in model.separated.heat})
        made = compilable(made, self.compiled)
        if made.iterating:  # chosen where a factor is too large
            return made
        return replace(made, newton=TextbookNewton(lambda: Summed.of(model, price=0), tol))

    def _whole(self, model: AssembledModel, price: int, why: str) -> WholeStepper:
        """Newton solver for all unknowns together; price: see `Equations`; why: the reason, for
        notes."""
        return WholeStepper(
            Summed.of(model, price), Loop(model.layout, self.tolerances),
            elements(model, model.terms, [t.rows for t in model.terms]), self.predictor,
            notes=whole_step_notes(model, why))
