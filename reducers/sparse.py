"""The paper's reducer: sampled rows of the full-order equations, sparse coefficients, no
projection."""

from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import (
    Basis,
    Dictionary,
    Integrator,
    Preconditioner,
    Sampler,
    SparseSolver,
    StepSolver,
)
from sparsemor.core.slot import Slot, slot_default
from sparsemor.core.status import SolveFailed, Status
from sparsemor.reducers.bordered import Tolerances
from sparsemor.reducers.checks import budget_faults, pattern_faults, preconditioner_faults
from sparsemor.reducers.choose import chosen
from sparsemor.reducers.prepare import constants, stepper
from sparsemor.reducers.represent import refuse_other, represent
from sparsemor.reducers.sampled import (
    RankDeficient,
    Sampled,
    SampledElastic,
    SampledHeat,
    choose_rows,
    weigh,
)
from sparsemor.reducers.sparse_stepper import SparseStepper
from sparsemor.reducers.test_map import TestedElastic, TestedHeat, TestMap


class Budget(Plugin):
    """How much of one block a step may use."""

    rows: int = Field(ge=0)
    """Sampled rows, on top of the required ones."""
    atoms: int | None = Field(default=None, ge=1)
    """Most atoms active at once; all of the dictionary when not given."""


class Sparse(Plugin):
    """Rows of each block are sampled once; each step recovers few coefficients from them (Eq. 25).

    Where a budget covers the whole dictionary nothing is selected and the support is all of it.
    """

    budgets: dict[str, Budget] = Field(min_length=1)
    """Rows and atoms by block pattern, such as `*.elastic`."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("lhs")
    """Chooses the rows."""
    preconditioner: Annotated[Preconditioner, Slot("preconditioner")] = slot_default("none")
    """Of the sampled thermal rows (Sec. 3.2)."""
    solver: Annotated[SparseSolver, Slot("sparse_solver")] = slot_default("greedy_gauss_newton")
    """Selects atoms where a budget is smaller than the dictionary."""
    every: int = Field(default=1, ge=1)
    """Steps between selections."""
    carried: bool = True
    """Whether a selection starts from the support of the step before, or from none."""
    polish: bool = True
    """Whether a step is solved again on the selected support, with the rigid and multiplier rows
    as exact equations. False, as published: the sparse solver's own solution is taken, in which
    those rows are part of the least squares; needs a selection in every step, and no radiation."""
    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Relative error of the unknowns that may remain in a step."""
    max_iterations: int = Field(default=30, ge=1)
    """Newton iterations before a step is given up."""

    def prepare(
        self, model: Model, integrator: Integrator, h: float,
        offline: Offline, rng: np.random.Generator,
    ) -> StepSolver:
        refuse_other(model, "sparse")
        faults = self.check(model)
        if faults:
            raise InputError(faults).under("reducer")
        none = Budget(rows=0)
        budgets = {n: chosen(n, self.budgets, none) for n in model.reducible()}
        c1, c2, c1_first = constants(model.layout, integrator, h)
        dictionaries, limits = represent(
            offline, {n: chosen(n, self.bases, self.basis) for n in model.reducible()})
        rows = {n: choose_rows(model, offline, n, b.rows, b.atoms or 10**9, self.sampler,
                               dictionaries[n], own)
                for (n, b), own in zip(budgets.items(), rng.spawn(len(budgets)), strict=True)}
        heat: dict[str, SampledHeat] = {}
        elastic: dict[str, SampledElastic] = {}
        for b in model.separated.heat:
            name = b.thermal
            tested = TestedHeat.of(b, dictionaries[name], TestMap(rows=rows[name]))
            B = tested.block(c1_first)
            block = Sampled(name, dictionaries[name], rows[name], budgets[name].atoms or B.shape[1],
                            B, weigh(offline, self.preconditioner, name, B))
            heat[name] = SampledHeat(block, tested, model, b, c1_first)
        for m in model.separated.moving:
            if m.operators is None:
                continue
            name = m.elastic
            te = TestedElastic.of(m.operators, m.frame, dictionaries[name],
                                  dictionaries.get(m.thermal), TestMap(rows=rows[name]))
            B = te.block(c1, c2)
            elastic[name] = SampledElastic(
                Sampled(name, dictionaries[name], rows[name], budgets[name].atoms or B.shape[1],
                        B, None), te)
        return self._stepper(model, dictionaries, rows, heat, elastic, limits)

    def _stepper(
        self, model: Model, dictionaries: Mapping[str, Dictionary], rows: Mapping[str, IntArray],
        heat: Mapping[str, SampledHeat], elastic: Mapping[str, SampledElastic],
        limits: Mapping[str, float],
    ) -> StepSolver:
        """Blocks without a choice to make are prepared here, once."""
        try:
            hot = {n: h.prepared(None) for n, h in heat.items() if not h.block.selects}
            bent = {n: e.prepared(None) for n, e in elastic.items() if not e.block.selects}
        except RankDeficient as error:
            raise SolveFailed(Status.RANK_DEFICIENT, 0.0, error.block, error.detail) from None
        layout = model.layout.resized({n: d.atoms.shape[1] for n, d in dictionaries.items()})
        base = stepper(
            model, layout, dictionaries, rows, hot, bent,
            Tolerances(self.remaining, self.max_iterations), self.predictor,
            len(hot) + len(bent),
            limits, missed_loads(model, rows), {n: e.tested for n, e in elastic.items()})
        if len(hot) == len(heat) and len(bent) == len(elastic):
            return base
        # elastic blocks are selected in one joint problem: all of them take part in it
        choosing = {} if len(bent) == len(elastic) else elastic
        return SparseStepper(base, {n: h for n, h in heat.items() if n not in hot}, choosing,
                             self.solver, self.every, self.carried, self.polish)

    def check(self, model: Model) -> Sequence[Fault]:
        """What can be refused by counting, before any training; keys relative to the reducer."""
        faults = budget_faults(model, self.budgets, self.sampler)
        faults += pattern_faults(model, "bases", self.bases)
        faults += preconditioner_faults(
            model, self.budgets, self.sampler, self.preconditioner, self.basis, self.bases)
        if not self.polish and self.every > 1:
            faults.append(Fault("every", "without polish each step needs its own selection: "
                                "take every: 1"))
        local = [b.thermal for b in model.separated.heat if b.local]
        if not self.polish and local:
            faults.append(Fault("polish", f"the selection in {', '.join(local)} is linear and "
                                "leaves radiation to the polish: take polish: true"))
        return faults


def missed_loads(model: Model, rows: Mapping[str, IntArray]) -> tuple[str, ...]:
    """A sentence for each load or joint none of whose rows is in the sample of a block."""
    return tuple(
        f"the sampled rows of {block} miss {name}: the model does not feel it there; "
        "keep the required rows (sampler.required: true) or take more rows"
        for block, chosen_rows in rows.items()
        for name, touched in model.loaded[block].items()
        if not np.isin(touched, chosen_rows).any())
