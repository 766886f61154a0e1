"""Base class of projection-based reducers: trial basis and test map of each block, all atoms
active.

A subclass returns the test maps of a block (`Maps`); Galerkin, DEIM, GNAT and LSPG differ only in
these and share the reduced operators and the step solver.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, ClassVar

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Basis,
    Csr,
    Dictionary,
    Fault,
    FloatArray,
    HeatBody,
    IntArray,
    Integrator,
    MovingBody,
    Note,
    OfflineProducts,
    ReducedProblem,
    Slot,
    StepFactors,
    matched_option,
    slot_default,
)
from sparsemor.reducers.checks import pattern_faults
from sparsemor.reducers.field_options import BASES
from sparsemor.reducers.linalg.left_inverse import left_inverse
from sparsemor.reducers.notes import shadowed_basis
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.blocks.compressed_elastic import CompressedElastic
from sparsemor.reducers.step.blocks.compressed_prescribed import CompressedPrescribed
from sparsemor.reducers.step.blocks.thermal_block import CompressedHeat
from sparsemor.reducers.step.blocks.thermal_groups import heat_groups
from sparsemor.reducers.step.compiled.stepper import compilable
from sparsemor.reducers.step.coupled_reduced import (
    ProjectedBlock,
    ProjectedModel,
    ReducedGeneral,
    reduced_general,
)
from sparsemor.reducers.step.newton.equations import Equations
from sparsemor.reducers.step.newton.fallback import FullNewton
from sparsemor.reducers.step.operators import TestedElastic, TestedHeat, TestMap
from sparsemor.reducers.step.prepare import constants, stepper
from sparsemor.reducers.step.solver import Facts, Stepper
from sparsemor.reducers.step_options import ReducedStepOptions
from sparsemor.reducers.trial_bases import local_terms, trial_bases


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Linear operators of one block: stiffness x + damping v + mass a, (n, n) each.

    For heat, `stiffness` is the conductivity, `damping` the capacity, and there is no mass.
    `operator`: D = stiffness + c1 damping + c2 mass, where v = c1 x + r1 and a = c2 x + r2 in a
    step.
    """

    stiffness: Csr
    damping: Csr
    mass: Csr | None
    operator: Csr

    @classmethod
    def of(cls, source: HeatBody | MovingBody, c1: float, c2: float, c1_first: float) -> "Linear":
        if isinstance(source, HeatBody):
            K, C = source.conductivity, source.capacity
            return cls(K, C, None, K + c1_first * C)
        assert source.operators is not None
        o = source.operators
        return cls(o.stiffness, o.damping, o.mass, o.stiffness + c1 * o.damping + c2 * o.mass)

    def force(self, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Residual of the linear operators, stiffness x + damping v + mass a, for (n,) or (n, M)
        arrays."""
        f = self.stiffness @ x + self.damping @ v
        return np.asarray(f if self.mass is None else f + self.mass @ a)


@dataclass(frozen=True, slots=True, eq=False)
class Reducible:
    """One block of unknowns with the data its test maps are computed from: dictionary (trial
    basis), linear operators, model, integrator, step h (s), and a random generator of its own."""

    name: str
    dictionary: Dictionary
    linear: Linear
    model: AssembledModel
    offline: OfflineProducts
    integrator: Integrator
    h: float
    rng: np.random.Generator

    @property
    def size(self) -> int:
        return int(self.dictionary.atoms.shape[0])


@dataclass(frozen=True, slots=True, eq=False)
class Maps:
    """Test maps (left projections) of one block.

    test: map of the block's linear operators; force: map of all other terms in its rows (None: the
    same map). rows: sampled rows, None for all; facts: numbers to report.
    """

    test: TestMap
    force: TestMap | None = None
    rows: IntArray | None = None
    facts: Mapping[str, float | int | str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    @property
    def forces(self) -> TestMap:
        return self.test if self.force is None else self.force


@dataclass(frozen=True, slots=True, eq=False)
class Approximation:
    """Model whose operators are projected, where some of them may be replaced by cheaper ones
    (hyper-reduction).

    facts: numbers to report, by block; elements: number of elements by block that the replaced
    operators contain; notes: warnings about the replacement.
    """

    model: AssembledModel
    facts: Mapping[str, Mapping[str, float | int | str]] = field(default_factory=dict)
    elements: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()


class ProjectionReducer(ReducedStepOptions, ABC):
    """Base class of projection-based reducers: their common options and the assembly of reduced
    blocks.

    A subclass defines `maps`; `approximation` and `in_modes` may stay as they are.
    """

    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    shared_options: ClassVar[tuple[str, ...]] = BASES

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

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults of the options found by counting, before any training; keys relative to the
        reducer."""
        return pattern_faults(model, "bases", self.bases)

    def restart_refusal(self) -> str:
        return ""

    def prepare(self, problem: ReducedProblem) -> Stepper | ReducedGeneral:
        """Step solver of the reduced model. Raises InputError where the reducer does not apply to
        the scene, SolveFailed for linearly dependent atoms."""
        model, integrator, h = problem.model, problem.integrator, problem.step
        offline, rng = problem.offline, problem.rng
        c1, c2, c1_first = constants(integrator, h)
        dictionaries, limits = trial_bases(
            offline, {n: matched_option(n, self.bases, self.basis) for n in model.reducible()},
            StepFactors(h, c1, c2, c1_first))
        modes = self.in_modes(model, dictionaries)
        dictionaries |= {n: d for n, (d, _) in modes.items()}
        limits = {n: top * modes[n][1] if n in modes else top for n, top in limits.items()}
        approximation = self.approximation(model, dictionaries, offline, h)
        model = approximation.model
        own = dict(zip(dictionaries, rng.spawn(len(dictionaries)), strict=True))
        maps: dict[str, Maps] = {}
        heat, elastic = {}, {}

        def mapped(name: str, source: HeatBody | MovingBody) -> Maps:
            linear = Linear.of(source, c1, c2, c1_first)
            maps[name] = self.maps(Reducible(
                name, dictionaries[name], linear, model, offline, integrator, h, own[name]))
            return maps[name]

        for b in model.separated.heat:
            m = mapped(b.thermal, b)
            th = TestedHeat.of(b, dictionaries[b.thermal], m.test, m.force)
            th = th.in_modes() if b.thermal in modes else th
            left = left_inverse(b.thermal, th.block(c1_first))
            heat[b.thermal] = ProjectedBlock(th, left, m.forces)
        for body in model.separated.moving:
            if body.operators is None:
                continue
            n, m = body.elastic, mapped(body.elastic, body)
            te = TestedElastic.of(body.operators, body.frame, dictionaries[n],
                                  dictionaries.get(body.thermal), m.test, m.force,
                                  model.separated.rigid_equations)
            te = te.in_modes() if n in modes else te
            elastic[n] = ProjectedBlock(te, left_inverse(n, te.block(c1, c2)), m.forces)
        rows = {n: m.rows for n, m in maps.items() if m.rows is not None}
        notes = (*shadowed_basis(self, model, self.bases),
                 *(note for m in maps.values() for note in m.notes), *approximation.notes)
        facts = {**approximation.facts, **{n: m.facts for n, m in maps.items() if m.facts}}
        projected = ProjectedModel(model, dictionaries, rows, heat, elastic)
        made = reduced_general if model.separated.other else partial(fast, (c1, c2, c1_first))
        solver = made(projected, self.tolerances, self.predictor,
                      limits, notes, facts)
        if isinstance(solver, Stepper):
            solver = compilable(solver, self.compiled)
        touched = solver.elements_touched
        return replace(solver, elements_touched={
            **touched, **{n: touched[n] + e for n, e in approximation.elements.items()}})


def fast(
    rates: tuple[float, float, float], projected: ProjectedModel, tolerances: Tolerances,
    points: int, limits: Mapping[str, float], notes: tuple[Note, ...], facts: Facts,
) -> Stepper:
    """Step solver of a model whose blocks are solved one after the other: heat, then mechanics.

    rates: c1, c2, and c1 of first-order unknowns; points: number of past states to extrapolate.
    """
    (c1, c2, c1_first), heat, model = rates, {}, projected.model
    for b in model.separated.heat:
        n, p = b.thermal, projected.heat[b.thermal]
        local = local_terms(model, b, projected.dictionaries[n], projected.wide(n)) if (
            b.local) else []
        heat[n] = CompressedHeat.of(p.tested, p.left, None, c1_first, local)
    kind = CompressedElastic if model.separated.border_size else CompressedPrescribed
    elastic = {n: kind.of(p.tested, p.left, None, c1, c2) for n, p in projected.elastic.items()}
    wide = {c.rows: projected.wide(c.rows) for c in model.separated.couplings}
    made = stepper(
        model, projected.layout, projected.dictionaries, projected.rows,
        heat_groups(model, heat, projected.dictionaries, wide, c1_first), elastic, tolerances,
        points, len(heat) + len(elastic), True, limits, notes,
        {n: p.tested for n, p in projected.elastic.items()}, facts,
        {n: block.elements for n, block in heat.items()})
    # made here, so that what steps does not hold the model
    whole: Equations = reduced_general(projected, tolerances, points).equations
    return replace(made, newton=FullNewton(lambda: whole, tolerances))
