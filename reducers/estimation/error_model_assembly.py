"""Assembly of the error model of a reduced run from the full model and the trial bases."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    Note,
    ReducedProblem,
    StepFactors,
    StepSolver,
    information,
)
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.separable import HeatBody, MovingBody
from sparsemor.reducers.estimation.coupled_errors import CoupledErrors, ReducedBlock
from sparsemor.reducers.estimation.error_space import (
    PROPORTIONAL,
    ErrorSpace,
    Operators,
    error_space,
    residual_columns,
)
from sparsemor.reducers.estimation.estimator import BlockErrors, ErrorModel
from sparsemor.reducers.estimation.local_forces import ElementForces
from sparsemor.reducers.estimation.reduced_states import (
    InAtoms,
    InModes,
    Projected,
    StateMap,
)
from sparsemor.reducers.estimation.residuals import ElasticResidual, HeatResidual
from sparsemor.reducers.step.coupled_reduced import ProjectedBlock, ProjectedModel, dense_equations
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat, TestMap

ESTIMATE_STEPS, TOO_SMALL = "estimate_steps", 18
"""Kind of the note on estimates by long steps, and the largest ratio of an error to its estimate
that such steps have had (tests/physics/elements/test_nonlinear_strains.py)."""
TURN = 0.1
"""Largest rotation of a frame in one step of the error equation, rad, unless the run's own steps
turn it further, or estimates are few."""
SUDDEN = 2.0
"""Factor of few estimates: the largest displacement under a load that acts suddenly, relative to
the static one, which is what long steps find. Of linear blocks with prescribed frames, whose errors
take the run's own steps, it covers what residuals do between two estimates."""
Active: TypeAlias = Callable[[str, int], int]
"""Largest number of active atoms of a block, by its name and the number of its atoms."""


def error_model(
    problem: ReducedProblem, solver: StepSolver, every: int,
    active: Active = lambda _, atoms: atoms, at_few_steps: bool = False, first: int = 0,
) -> ErrorModel | CoupledErrors:
    """Error model of the runs of `solver`, for every `every`-th step: by blocks where the motion of
    frames is prescribed and all terms are linear, else of the whole model. active: largest number
    of active atoms of a block with so many atoms; at_few_steps: True for estimates that are as few
    as their cost permits, between which frames may turn far and loads act suddenly; first: number
    of first steps with an estimate each.

    Raises SolveFailed where an operator of a block cannot be factorized.
    """
    whole = is_whole(problem.model)
    build = _ErrorSystems(problem, solver, every, whole, active, at_few_steps, first)
    return build.coupled() if whole else build.by_blocks()


def is_whole(model: AssembledModel) -> bool:
    """True if the errors of all blocks are solved together: frames or joint forces are unknowns, or
    terms are not linear or act between bodies."""
    s = model.separated
    return bool(s.elastic_local or any(b.local for b in s.heat) or s.border_size or s.between)


def iterations(model: AssembledModel) -> int:
    """Newton iterations of a long step of the errors of the whole model: 2 where its linearisation
    is far from them, as frames turn far in such a step, or terms that are not linear read
    temperatures and act on displacements."""
    return 2 if model.separated.elastic_local or model.separated.border_size else 1


class _ErrorSystems:
    """Error spaces and equations of all blocks, one after the other: those of heat first, whose
    errors act on displacements. h: `every` steps of the run, s, which the error equation of the
    whole model takes at once; step: factors of the steps of the error equations; turn, margin: see
    `CoupledErrors`."""

    def __init__(
        self, problem: ReducedProblem, solver: StepSolver, every: int, whole: bool,
        active: Active, at_few_steps: bool, first: int,
    ) -> None:
        """every: steps of the run from one estimate to the next; whole: True if the errors of all
        blocks are solved together; active: largest number of active atoms, by block name and number
        of atoms; at_few_steps: frames may turn at will between two estimates, and loads act
        suddenly. turn: largest rotation of a frame in a step, rad; margin: factor of estimates;
        first: number of first steps with an estimate each."""
        self.few, self.first = at_few_steps, first
        self.turn, self.margin = (np.inf, SUDDEN) if at_few_steps else (TURN, 1.0)
        self.problem, self.solver, self.every, self.whole = problem, solver, every, whole
        self.model = problem.model
        self.h = every * problem.step
        step = self.h if whole else problem.step
        self.step = StepFactors(step, *problem.integrator.rules(step).factors)
        assert isinstance(problem.model, Model)
        self.start = resolved_start(problem.model, problem.integrator, problem.step).state
        self.notes: list[Note] = []
        self.local = ElementForces(problem)
        self.active = active

    def by_blocks(self) -> ErrorModel:
        """The error equation of each block alone, for prescribed motion and linear terms."""
        known, spaces = self.solver.dictionaries, dict[str, ErrorSpace]()
        warm = [b for b in self.model.separated.heat if b.thermal in known]
        moving = [m for m in self.model.separated.moving if m.elastic in known]
        for b in warm:
            spaces[b.thermal] = self._heat_space(b)
        for m in moving:
            hot = spaces.get(m.thermal)
            spaces[m.elastic] = self._elastic_space(
                m, np.zeros((0, 0)) if hot is None else hot.modes)
        blocks = _Coordinates(self, spaces)  # bases in which the residuals are evaluated
        return ErrorModel.of(
            self.every, self.first, self.margin, self.problem.step, [blocks.heat(b) for b in warm],
            [blocks.elastic(m) for m in moving], self.model.layout, self.solver.layout,
            blocks.layout, self.problem.integrator, self.notes)

    def coupled(self) -> CoupledErrors:
        """The error equation of the whole model, with each block projected on its error space: the
        modes of the errors are its trial basis (`dictionaries`) and its test basis."""
        heat, elastic, spaces = {}, {}, dict[str, ErrorSpace]()
        dictionaries = {}

        def add(name: str, space: ErrorSpace) -> TestMap:
            """Takes the error space of a block as its basis; returns the test map of its modes."""
            spaces[name] = space
            dictionaries[name] = Dictionary(space.modes, self.dictionary(name).offset, ())
            return TestMap(left=np.ascontiguousarray(space.modes.T))

        for b in self.model.separated.heat:
            test = add(b.thermal, self._heat_space(b))
            heat[b.thermal] = ProjectedBlock(
                operators=ProjectedHeat.from_operators(b, dictionaries[b.thermal], test),
                left=np.eye(spaces[b.thermal].size), forces=test)  # rows as they are
        for m in self.model.separated.moving:
            if m.operators is None:
                continue
            warm = spaces.get(m.thermal)
            if self.every > 1 and self.local.has_nonlinear_stiffness(m):
                # estimates that nobody asked for are no reason for a warning
                note = information if self.few else Note
                self.notes.append(note(
                    f"the error of {m.elastic} is estimated by one step for {self.every} of the "
                    "run, which misses fast residuals: with a stiffness that depends on the "
                    f"displacements it has been {TOO_SMALL} times too small, where estimates of "
                    "every step were within 1 %; take reducer.error_estimate: 1",
                    ESTIMATE_STEPS))
            test = add(m.elastic, self._elastic_space(
                m, np.zeros((0, 0)) if warm is None else warm.modes))
            operators = ProjectedElastic.from_operators(
                replace(m.operators, local=()), m.frame, dictionaries[m.elastic],
                dictionaries.get(m.thermal), test)
            elastic[m.elastic] = ProjectedBlock(
                operators=operators, left=np.eye(spaces[m.elastic].size), forces=test)
        projected = ProjectedModel(
            self.model, dictionaries, rows={}, heat=heat, elastic=elastic)
        blocks = []
        for name, space in spaces.items():
            states = self.projected(name, space) or InModes(
                least_squares_coefficients(space.modes, self.dictionary(name).atoms))
            blocks.append(ReducedBlock(name, space, dictionaries[name].offset, states))
        separated = self.model.separated
        varying = bool(separated.between) or any(
            map(self.local.has_nonlinear_stiffness, separated.moving))
        return CoupledErrors(
            every=self.every, h=self.h, spaces=tuple(blocks),
            equations=dense_equations(projected, by_elements=True), full=self.model.layout,
            reduced=self.solver.layout, integrator=self.problem.integrator, turn=self.turn,
            first=self.first, margin=self.margin, varying=varying,
            passes=iterations(self.model), notes=tuple(self.notes))

    def dictionary(self, name: str) -> Dictionary:
        """Trial basis of a block; all its unknowns where it is not reduced."""
        n = self.model.block_data(name).size
        return self.solver.dictionaries.get(name) or Dictionary(np.eye(n), np.zeros(n), ())

    def _spanned(self, name: str) -> Dictionary:
        """Atoms that the space of errors contains: all of them, or as many leading ones as can be
        active, of a basis from which few are and which has more than half as many as unknowns."""
        d = self.dictionary(name)
        n, k = d.atoms.shape
        return d.leading(self.active(name, k)) if 2 * k > n else d

    def projected(self, name: str, space: ErrorSpace) -> Projected | None:
        """Projection of the states of a block whose space of errors has the leading atoms only."""
        d = self.dictionary(name)
        if self._spanned(name).atoms.shape == d.atoms.shape:
            return None
        return Projected.from_atoms(d.atoms, space)

    def _heat_space(self, b: HeatBody) -> ErrorSpace:
        """Space of the errors of temperatures."""
        d = self._spanned(b.thermal)
        columns = [*residual_columns(b, d.atoms, d.offset, d.atoms), self.local.of_heat(b, d)]
        return self._space(b.thermal, self.local.tangent_of_heat(b), d, columns)

    def _elastic_space(self, m: MovingBody, errors: FloatArray) -> ErrorSpace:
        """Space of the errors of displacements; errors (nT, q): modes of those of the body's
        temperatures."""
        assert m.operators is not None
        d, o = self._spanned(m.elastic), m.operators
        hot = self.dictionary(m.thermal) if m.thermal in self.model.layout else None
        spanned = errors if hot is None else np.column_stack([errors, hot.offset])
        columns = [*residual_columns(o, d.atoms, d.offset, spanned), self.local.of_elastic(m, d)]
        return self._space(m.elastic, self.local.tangent_of_elastic(m), d, columns)

    def _space(
        self, name: str, operators: Operators, d: Dictionary, columns: Sequence[FloatArray]
    ) -> ErrorSpace:
        """Space of the errors of a block with atoms d; columns (n, j): what its residual consists
        of."""
        model, at = self.model, self.model.layout[name]
        starts = np.column_stack([model.x0[at] - d.offset, model.v0[at], self.start.a[at]])
        return error_space(
            name, model, operators, atoms=d.atoms, sources=columns, starts=starts, step=self.step,
            offline=self.problem.offline, coupled=self.whole)


class _Coordinates:
    """Error equations of blocks whose frames are prescribed. bases: block -> basis of the
    coordinates that its residual is evaluated in: its atoms, or the modes of its errors where these
    do not span them; layout: of these coordinates; states: block -> map of its coefficients to
    them."""

    def __init__(self, build: _ErrorSystems, spaces: Mapping[str, ErrorSpace]) -> None:
        self.build, self.spaces = build, spaces
        self.states: dict[str, StateMap] = {}
        self.bases: dict[str, Dictionary] = {}
        for name, space in spaces.items():
            d, projected = build.dictionary(name), build.projected(name, space)
            self.states[name] = projected or InAtoms()
            self.bases[name] = Dictionary(space.modes, d.offset, ()) if projected else d
        self.layout = build.solver.layout.resized(
            {n: d.atoms.shape[1] for n, d in self.bases.items()})

    def heat(self, b: HeatBody) -> BlockErrors:
        """Error equation of temperatures."""
        name = b.thermal
        operators = ProjectedHeat.from_operators(
            b, self.bases[name], TestMap(left=self.spaces[name].modes.T))
        return self._block(name, HeatResidual.from_operators(self.layout[name], operators))

    def elastic(self, m: MovingBody) -> BlockErrors:
        """Error equation of displacements, loaded by the errors of the body's temperatures. bases:
        block -> basis of the coordinates in which its residual is evaluated; the residual is tested
        by the modes of its errors."""
        assert m.operators is not None
        name, o, layout = m.elastic, m.operators, self.layout
        space, warm = self.spaces[name], self.spaces.get(m.thermal)
        test = TestMap(left=space.modes.T)
        operators = ProjectedElastic.from_operators(
            o, m.frame, self.bases[name], self.bases.get(m.thermal), test, rigid=False)
        step = BodyStep(
            m.name, operators.frame, m.to_border, m.origin, elastic=layout[name],
            thermal=layout[m.thermal] if m.thermal in layout else slice(0, 0), elastic_name=name,
            guide=m.guide)
        warmth = None  # loads of the modes by errors of temperatures, (qT, q)
        if o.coupling is not None and warm is not None:
            warmth = np.ascontiguousarray((test(o.coupling) @ warm.modes).T)
        if space.coupled > PROPORTIONAL:
            self.build.notes.append(information(
                f"the damping of {name} couples its eigenmodes, by {space.coupled:.1e} of its "
                "size, which the estimate of its error leaves out", "estimate_damping"))
        return self._block(name, ElasticResidual.from_operators(step, operators), m.thermal, warmth)

    def _block(
        self, name: str, residual: HeatResidual | ElasticResidual, heat: str = "",
        warmth: FloatArray | None = None
    ) -> BlockErrors:
        """Error equation of a block; heat, warmth: of the temperatures that load it."""
        build, d = self.build, self.build.dictionary(name)
        return BlockErrors(
            name, self.spaces[name], residual, atoms=d.atoms, offset=d.offset,
            full=build.model.layout[name], reduced=build.solver.layout[name],
            states=self.states[name], heat=heat, warmth=warmth)
