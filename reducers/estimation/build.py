"""Assembly of the error model of a reduced run from the full model and the trial bases."""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core import (
    Dictionary,
    FloatArray,
    MovingBody,
    Note,
    ReducedProblem,
    StepFactors,
    StepSolver,
    information,
)
from sparsemor.reducers.estimation.error_space import (
    PROPORTIONAL,
    ErrorSpace,
    Operators,
    error_space,
    residual_columns,
)
from sparsemor.reducers.estimation.estimator import BlockErrors, ErrorModel
from sparsemor.reducers.estimation.residuals import ElasticResidual, HeatResidual
from sparsemor.reducers.step.coupled_reduced import border_positions
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.operators import TestedElastic, TestedHeat, TestMap


def error_model(problem: ReducedProblem, solver: StepSolver, every: int) -> ErrorModel:
    """Error model of the runs of `solver`, for every `every`-th step. Blocks with terms that are
    not linear have none; a note names each with the reason.

    Raises SolveFailed where an operator of a block cannot be factorized.
    """
    return _Builder(problem, solver, every).built()


class _Builder:
    """Error equations of all blocks, one after the other: those of heat first, whose errors act on
    displacements."""

    def __init__(self, problem: ReducedProblem, solver: StepSolver, every: int) -> None:
        self.problem, self.solver, self.every = problem, solver, every
        self.model = problem.model
        h = every * problem.step
        self.step = StepFactors(h, *problem.integrator.rules(h).factors)
        self.notes: list[Note] = []
        self.missing = self._missing()

    def built(self) -> ErrorModel:
        heat = {b.thermal: self._heat(b.thermal) for b in self.model.separated.heat
                if self._estimated(b.thermal)}
        elastic = [self._elastic(m, heat) for m in self.model.separated.moving
                   if m.operators is not None and self._estimated(m.elastic)]
        return ErrorModel.of(
            self.every, self.problem.step, list(heat.values()), elastic, self.model.layout,
            self.problem.integrator, self.notes)

    def _missing(self) -> dict[str, str]:
        """Reduced block -> reason why it has no estimate."""
        separated, layout, found = self.model.separated, self.model.layout, dict[str, str]()
        for term in separated.other:
            for block in layout.containing(term.rows):
                found[block] = "a contact or another term between bodies acts on it in each step"
        for c in separated.couplings:
            found |= {n: "it exchanges heat with another body" for n in (c.rows, c.columns)}
        for b in separated.heat:
            if b.local:
                found[b.thermal] = "some of its terms are nonlinear, and evaluated by elements"
        for m in separated.moving:
            if m.operators is None:
                continue
            if m.operators.local:
                found[m.elastic] = "some of its terms are nonlinear, and evaluated by elements"
            elif m.operators.coupling is not None and m.thermal in found:
                found.setdefault(m.elastic, f"it depends on {m.thermal}, which has none")
        return found

    def _estimated(self, name: str) -> bool:
        """True if a block is reduced and linear; notes why a reduced block has no estimate."""
        if name not in self.solver.dictionaries:
            return False
        if name in self.missing:
            self.notes.append(information(
                f"the error of {name} is not estimated: {self.missing[name]}", "no_estimate"))
        return name not in self.missing

    def _heat(self, name: str) -> BlockErrors:
        b = next(b for b in self.model.separated.heat if b.thermal == name)
        d = self.solver.dictionaries[name]
        columns = residual_columns(b, d.atoms, d.offset, d.atoms)
        space = self._space(name, Operators.of(b), d, columns)
        tested = TestedHeat.of(b, d, TestMap(left=space.modes.T))
        residual = HeatResidual.of(self.solver.layout[name], tested)
        return self._block(name, space, residual, d)

    def _elastic(self, m: MovingBody, heat: Mapping[str, BlockErrors]) -> BlockErrors:
        assert m.operators is not None
        name, o, layout = m.elastic, m.operators, self.solver.layout
        d, warm = self.solver.dictionaries[name], heat.get(m.thermal)
        hot = self.solver.dictionaries.get(m.thermal)
        errors = warm.space.modes if warm is not None else np.zeros((0, 0))
        spanned = errors if hot is None else np.column_stack([errors, hot.offset])
        space = self._space(name, Operators.of(o), d, residual_columns(
            o, d.atoms, d.offset, spanned))
        test = TestMap(left=space.modes.T)
        tested = TestedElastic.of(o, m.frame, d, hot, test)
        step = BodyStep(
            m.name, tested.frame, m.to_border, m.origin, None, layout[name],
            layout[m.thermal] if m.thermal in layout else slice(0, 0), name, m.guide)
        free = bool(self.model.separated.border_size)
        border = border_positions(layout) if free else np.zeros(0, dtype=np.int64)
        warmth = None
        if o.coupling is not None and warm is not None:
            warmth = np.ascontiguousarray((test(o.coupling) @ errors).T)
        residual = ElasticResidual.of(step, tested, border)
        return self._block(name, space, residual, d, m.thermal, warmth)

    def _space(
        self, name: str, operators: Operators, d: Dictionary, columns: Sequence[FloatArray]
    ) -> ErrorSpace:
        model, at = self.model, self.model.layout[name]
        starts = np.column_stack([model.x0[at] - d.offset, model.v0[at]])
        space = error_space(name, model, operators, d.atoms, columns, starts, self.step,
                            self.problem.offline)
        if space.coupled > PROPORTIONAL:
            self.notes.append(information(
                f"the damping of {name} couples its eigenmodes, by {space.coupled:.1e} of its "
                "size, which the estimate of its error leaves out", "estimate_damping"))
        return space

    def _block(
        self, name: str, space: ErrorSpace, residual: HeatResidual | ElasticResidual,
        d: Dictionary, heat: str = "", warmth: FloatArray | None = None
    ) -> BlockErrors:
        return BlockErrors(name, space, residual, d.atoms, d.offset, self.model.layout[name],
                           self.solver.layout[name], heat, warmth)

