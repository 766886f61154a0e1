"""Base class of projection-based reducers: trial basis and test map of each block, all atoms
active.

A subclass returns the test maps of a block (`Maps`); Galerkin, DEIM, GNAT and LSPG differ only in
these and share the reduced operators and the step solver.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Basis,
    BlockBases,
    Dictionary,
    Fault,
    InputError,
    Note,
    OfflineProducts,
    ReducedProblem,
    Slot,
    StepFactors,
    slot_default,
)
from sparsemor.core.model.block_patterns import unmatched_patterns
from sparsemor.core.protocols.separable import HeatBody, MovingBody
from sparsemor.reducers.linalg.left_inverse import left_inverse
from sparsemor.reducers.projection.operators_and_test_maps import (
    Approximation,
    LinearOperators,
    Maps,
    Reducible,
)
from sparsemor.reducers.reducer_notes import shadowed_basis
from sparsemor.reducers.reducer_options import BASES, ReducedStepOptions
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver, Facts, stepper
from sparsemor.reducers.step.compiled.compiled_stepper import compilable
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.coupled_reduced import (
    ProjectedBlock,
    ProjectedModel,
    ReducedGeneral,
    reduced_general,
)
from sparsemor.reducers.step.projected_operators import ProjectedElastic, ProjectedHeat
from sparsemor.reducers.step.thermal_block import CompressedHeat
from sparsemor.reducers.step.thermal_groups import heat_groups
from sparsemor.reducers.trial_bases import local_terms, spanned, trial_bases


class ProjectionReducer(ReducedStepOptions, ABC):
    """Base class of projection-based reducers: their common options and the assembly of reduced
    blocks.

    A subclass defines `maps`; `approximation`, `in_modes` and `notes_on` may stay as they are.
    """

    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block; one that it does not fit takes `pod`, with a
    note."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    shared_options: ClassVar[tuple[str, ...]] = BASES

    @property
    def stored_classes(self) -> Sequence[object]:
        """Classes of the step solvers of a kept model."""
        from sparsemor.reducers.stored_classes import CLASSES

        return CLASSES

    @abstractmethod
    def maps(self, block: Reducible) -> Maps:
        """Test maps of one block. Raises InputError or SolveFailed where they do not exist."""

    def approximation(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
        offline: OfflineProducts, h: float
    ) -> Approximation:
        """The model whose equations are projected, by default the full one; a subclass may replace
        operators by cheaper ones. dictionaries: trial bases by block; h: step, s."""
        return Approximation(model)

    def in_modes(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary]
    ) -> Mapping[str, tuple[Dictionary, float]]:
        """Block -> dictionary of the same span in which the block's operators are diagonal (modal
        coordinates), and the factor by which coefficients can grow in this change of basis."""
        return {}

    def notes_on(self, projection: "Projection") -> Sequence[Note]:
        """Notes on the accuracy of a model before it runs, from known states; by default none."""
        return ()

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults of the options found by counting, before any training; keys relative to the
        reducer."""
        return unmatched_patterns(model.layout, "bases", self.bases)

    def trial_bases(self) -> BlockBases:
        return BlockBases(self.basis, self.bases)

    def restart_refusal(self) -> str:
        return ""

    def project(self, problem: ReducedProblem) -> "Projection":
        """The problem on the trial bases of this reducer, from which step solvers are made. Raises
        InputError where the reducer does not apply to the scene."""
        model, h, offline = problem.model, problem.step, problem.offline
        bases, limits, notes = spanned(trial_bases(
            offline, model, self, StepFactors(h, *problem.integrator.rules(h).factors)), offline)
        return Projection(
            self, problem, dictionaries=bases, limits=limits,
            approximation=self.approximation(model, bases, offline, h),
            generators=dict(zip(bases, problem.rng.spawn(len(bases)), strict=True)), notes=notes)

    def prepare(self, problem: ReducedProblem) -> BlockwiseSolver | ReducedGeneral:
        """Step solver of the reduced model. Raises InputError where the reducer does not apply to
        the scene, SolveFailed for linearly dependent atoms."""
        projection = self.project(problem)
        notes = (*projection.notes, *self.notes_on(projection))
        return replace(projection, notes=notes).solver()


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """A problem on trial bases `dictionaries`, with the cheaper operators that replace its own.

    limits: largest permitted |coefficient| by block; generators: random numbers of each block;
    notes: on the trial bases.
    """

    reducer: ProjectionReducer
    problem: ReducedProblem
    dictionaries: Mapping[str, Dictionary]
    limits: Mapping[str, float]
    approximation: Approximation
    generators: Mapping[str, np.random.Generator]
    notes: tuple[Note, ...] = ()

    def leading(self, counts: int | Mapping[str, int]) -> "Projection":
        """The sub-model of the first `counts` atoms of each block, or of the blocks that are named.

        Nothing is trained again: bases, force modes and the weights of elements (`ecsw`) are those
        of the whole model. Raises InputError for a number that a block does not have.
        """
        wanted = dict.fromkeys(self.dictionaries, counts) if isinstance(counts, int) else counts
        for name, k in wanted.items():
            if name not in self.dictionaries:
                raise InputError(f"no reduced block is called {name!r}: "
                                 f"blocks: {', '.join(self.dictionaries) or 'none'}", "counts")
            most = self.dictionaries[name].atoms.shape[1]
            if not 1 <= k <= most:
                raise InputError(f"{k} leading atoms of {name}: allowed: 1 to {most}", "counts")
        return replace(self, dictionaries={
            n: d.leading(wanted[n]) if n in wanted else d for n, d in self.dictionaries.items()})

    def solver(self) -> BlockwiseSolver | ReducedGeneral:
        """Step solver: the operators of each block on its trial basis and under its test maps,
        times the left inverse of the block's own operator. Raises InputError where test maps do not
        exist, SolveFailed for linearly dependent atoms."""
        reducer, problem, model = self.reducer, self.problem, self.approximation.model
        integrator, h, offline = problem.integrator, problem.step, problem.offline
        c1, c2, c1_first = integrator.rules(h).factors
        # blocks in modal coordinates have other atoms of the same span, and other limits
        modes = reducer.in_modes(problem.model, self.dictionaries)
        dictionaries = {**self.dictionaries, **{n: d for n, (d, _) in modes.items()}}
        limits = {n: top * modes[n][1] if n in modes else top for n, top in self.limits.items()}
        maps: dict[str, Maps] = {}
        heat, elastic = {}, {}

        def mapped(name: str, source: HeatBody | MovingBody) -> Maps:
            """Test maps of a block, stored in `maps`; a copy of its random generator each time."""
            linear = LinearOperators.of(source, c1, c2, c1_first)
            maps[name] = reducer.maps(Reducible(
                name, dictionaries[name], linear, model, offline, integrator, h=h,
                rng=deepcopy(self.generators[name])))
            return maps[name]

        for b in model.separated.heat:
            m = mapped(b.thermal, b)
            th = ProjectedHeat.from_operators(b, dictionaries[b.thermal], m.test, m.force)
            th = th.in_modes() if b.thermal in modes else th
            left = left_inverse(b.thermal, th.block(c1_first))
            heat[b.thermal] = ProjectedBlock(operators=th, left=left, forces=m.forces)
        for body in model.separated.moving:
            if body.operators is None:
                continue
            n, m = body.elastic, mapped(body.elastic, body)
            te = ProjectedElastic.from_operators(
                body.operators, body.frame, dictionaries[n], dictionaries.get(body.thermal),
                m.test, m.force, rigid=model.separated.rigid_equations)
            te = te.in_modes() if n in modes else te
            left = left_inverse(n, te.block(c1, c2))
            elastic[n] = ProjectedBlock(operators=te, left=left, forces=m.forces)
        rows = {n: m.rows for n, m in maps.items() if m.rows is not None}
        notes = (*self.notes, *shadowed_basis(reducer, model, reducer.bases),
                 *(note for m in maps.values() for note in m.notes), *self.approximation.notes)
        known = self.approximation.facts
        facts = {n: {**(maps[n].facts if n in maps else {}), **known.get(n, {})}
                 for n in {**known, **maps}}
        projected = ProjectedModel(
            model, dictionaries, rows=rows, heat=heat, elastic=elastic)
        made = reduced_general if model.separated.other else partial(block_wise, (c1, c2, c1_first))
        solver = made(projected, reducer.tolerances, reducer.predictor, limits, notes, facts)
        if isinstance(solver, BlockwiseSolver):
            solver = compilable(solver, reducer.compiled)
        touched = solver.elements_touched
        return replace(solver, elements_touched={
            **touched, **{n: touched[n] + e for n, e in self.approximation.elements.items()}})


def block_wise(
    rates: tuple[float, float, float], projected: ProjectedModel, tolerances: Tolerances,
    points: int, limits: Mapping[str, float], notes: tuple[Note, ...], facts: Facts,
) -> BlockwiseSolver:
    """Step solver of a model whose blocks are solved one after the other: heat, then mechanics.

    projected: its blocks; limits: largest permitted |coefficient| of each block; facts: to report.
    rates: c1, c2, and c1 of first-order unknowns; points: number of past states to extrapolate.
    """
    c1_first, heat, model = rates[2], {}, projected.model
    for b in model.separated.heat:
        n, p = b.thermal, projected.heat[b.thermal]
        local = local_terms(model, b, projected.dictionaries[n], projected.force_map(n)) if (
            b.local) else []
        assert p.left is not None
        heat[n] = CompressedHeat.from_operators(
            p.operators, p.left, None, c1_first, tolerances, local)  # all atoms
    force_maps = {c.rows: projected.force_map(c.rows) for c in model.separated.couplings}
    made = stepper(
        model, projected.layout, projected.dictionaries, projected.rows,
        heat=heat_groups(model, heat, projected.dictionaries, force_maps, c1_first),
        tol=tolerances, points=points, factorizations=len(heat) + len(projected.elastic),
        limits=limits, notes=notes,
        operators={n: p.operators for n, p in projected.elastic.items()}, facts=facts,
        visited={n: block.elements for n, block in heat.items()})
    # mechanics: one dense system of all projected bodies and joints
    return made.with_equations(reduced_general(projected, tolerances, points).equations)
