"""Assembly of the error model of a reduced run from the full model and the trial bases."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sparsemor.core import (
    Dictionary,
    FloatArray,
    HeatBody,
    MovingBody,
    Note,
    ReducedProblem,
    StepFactors,
    StepSolver,
    information,
    least_squares_coefficients,
)
from sparsemor.reducers.estimation.coupled_errors import CoupledErrors, ReducedBlock
from sparsemor.reducers.estimation.error_space import (
    PROPORTIONAL,
    ErrorSpace,
    Operators,
    error_space,
    residual_columns,
)
from sparsemor.reducers.estimation.estimator import BlockErrors, ErrorModel
from sparsemor.reducers.estimation.local_forces import LocalForces
from sparsemor.reducers.estimation.residuals import ElasticResidual, HeatResidual
from sparsemor.reducers.step.coupled_reduced import ProjectedBlock, ProjectedModel, dense_equations
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.operators import TestedElastic, TestedHeat, TestMap


def error_model(
    problem: ReducedProblem, solver: StepSolver, every: int
) -> ErrorModel | CoupledErrors:
    """Error model of the runs of `solver`, for every `every`-th step: by blocks where the motion of
    frames is prescribed and all terms are linear, else of the whole model.

    Raises SolveFailed where an operator of a block cannot be factorized.
    """
    separated = problem.model.separated
    local = separated.elastic_local or any(b.local for b in separated.heat)
    whole = bool(local or separated.border_size or separated.between)
    build = _Builder(problem, solver, every, whole)
    return build.coupled() if whole else build.by_blocks()


class _Builder:
    """Error spaces and equations of all blocks, one after the other: those of heat first, whose
    errors act on displacements."""

    def __init__(
        self, problem: ReducedProblem, solver: StepSolver, every: int, whole: bool
    ) -> None:
        self.problem, self.solver, self.every, self.whole = problem, solver, every, whole
        self.model = problem.model
        self.h = every * problem.step
        self.step = StepFactors(self.h, *problem.integrator.rules(self.h).factors)
        self.notes: list[Note] = []
        self.local = LocalForces(problem)

    def by_blocks(self) -> ErrorModel:
        heat = {b.thermal: self._heat(b) for b in self.model.separated.heat
                if b.thermal in self.solver.dictionaries}
        elastic = [self._elastic(m, heat) for m in self.model.separated.moving
                   if m.elastic in self.solver.dictionaries]
        return ErrorModel.of(
            self.every, self.problem.step, list(heat.values()), elastic, self.model.layout,
            self.problem.integrator, self.notes)

    def coupled(self) -> CoupledErrors:
        heat, elastic, spaces = {}, {}, dict[str, ErrorSpace]()
        dictionaries = {}

        def add(name: str, space: ErrorSpace) -> TestMap:
            spaces[name] = space
            dictionaries[name] = Dictionary(space.modes, self._dictionary(name).offset, ())
            return TestMap(left=np.ascontiguousarray(space.modes.T))

        for b in self.model.separated.heat:
            test = add(b.thermal, self._heat_space(b))
            heat[b.thermal] = ProjectedBlock(
                TestedHeat.of(b, dictionaries[b.thermal], test),
                np.eye(spaces[b.thermal].size), test)
        for m in self.model.separated.moving:
            if m.operators is None:
                continue
            warm = spaces.get(m.thermal)
            test = add(m.elastic, self._elastic_space(
                m, np.zeros((0, 0)) if warm is None else warm.modes))
            tested = TestedElastic.of(
                replace(m.operators, local=()), m.frame, dictionaries[m.elastic],
                dictionaries.get(m.thermal), test)
            elastic[m.elastic] = ProjectedBlock(tested, np.eye(spaces[m.elastic].size), test)
        projected = ProjectedModel(self.model, dictionaries, {}, heat, elastic)
        blocks = [ReducedBlock(
            name, space, dictionaries[name].offset,
            least_squares_coefficients(space.modes, self._dictionary(name).atoms))
            for name, space in spaces.items()]
        integrator = self.problem.integrator
        return CoupledErrors(
            self.every, self.h, tuple(blocks), dense_equations(projected, True),
            self.model.layout, self.solver.layout, integrator, integrator.rules(self.h),
            tuple(self.notes))

    def _dictionary(self, name: str) -> Dictionary:
        """Trial basis of a block; all its unknowns where it is not reduced."""
        n = self.model.block_data(name).size
        return self.solver.dictionaries.get(name) or Dictionary(np.eye(n), np.zeros(n), ())

    def _heat_space(self, b: HeatBody) -> ErrorSpace:
        d = self._dictionary(b.thermal)
        columns = [*residual_columns(b, d.atoms, d.offset, d.atoms), self.local.of_heat(b, d)]
        return self._space(b.thermal, self.local.tangent_of_heat(b), d, columns)

    def _elastic_space(self, m: MovingBody, errors: FloatArray) -> ErrorSpace:
        """errors (nT, q): modes of the errors of the body's temperatures."""
        assert m.operators is not None
        d, o = self._dictionary(m.elastic), m.operators
        hot = self._dictionary(m.thermal) if m.thermal in self.model.layout else None
        spanned = errors if hot is None else np.column_stack([errors, hot.offset])
        columns = [*residual_columns(o, d.atoms, d.offset, spanned), self.local.of_elastic(m, d)]
        return self._space(m.elastic, self.local.tangent_of_elastic(m), d, columns)

    def _heat(self, b: HeatBody) -> BlockErrors:
        name, d, space = b.thermal, self._dictionary(b.thermal), self._heat_space(b)
        tested = TestedHeat.of(b, d, TestMap(left=space.modes.T))
        residual = HeatResidual.of(self.solver.layout[name], tested)
        return self._block(name, space, residual, d)

    def _elastic(self, m: MovingBody, heat: Mapping[str, BlockErrors]) -> BlockErrors:
        assert m.operators is not None
        name, o, layout = m.elastic, m.operators, self.solver.layout
        d, warm = self.solver.dictionaries[name], heat.get(m.thermal)
        errors = warm.space.modes if warm is not None else np.zeros((0, 0))
        space = self._elastic_space(m, errors)
        test = TestMap(left=space.modes.T)
        tested = TestedElastic.of(o, m.frame, d, self.solver.dictionaries.get(m.thermal), test)
        step = BodyStep(
            m.name, tested.frame, m.to_border, m.origin, None, layout[name],
            layout[m.thermal] if m.thermal in layout else slice(0, 0), name, m.guide)
        warmth = None
        if o.coupling is not None and warm is not None:
            warmth = np.ascontiguousarray((test(o.coupling) @ errors).T)
        if space.coupled > PROPORTIONAL:
            self.notes.append(information(
                f"the damping of {name} couples its eigenmodes, by {space.coupled:.1e} of its "
                "size, which the estimate of its error leaves out", "estimate_damping"))
        return self._block(name, space, ElasticResidual.of(step, tested), d, m.thermal, warmth)

    def _space(
        self, name: str, operators: Operators, d: Dictionary, columns: Sequence[FloatArray]
    ) -> ErrorSpace:
        model, at = self.model, self.model.layout[name]
        starts = np.column_stack([model.x0[at] - d.offset, model.v0[at]])
        return error_space(name, model, operators, d.atoms, columns, starts, self.step,
                           self.problem.offline, self.whole)

    def _block(
        self, name: str, space: ErrorSpace, residual: HeatResidual | ElasticResidual,
        d: Dictionary, heat: str = "", warmth: FloatArray | None = None
    ) -> BlockErrors:
        return BlockErrors(name, space, residual, d.atoms, d.offset, self.model.layout[name],
                           self.solver.layout[name], heat, warmth)
