"""Full order: constant blocks factorized once, rigid coordinates and multipliers as a border."""

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Integrator, StepSolver
from sparsemor.reducers.acceptance import Tolerances
from sparsemor.reducers.contact_start import check_start
from sparsemor.reducers.driven_block import DrivenBlock, FullDriven
from sparsemor.reducers.elastic import ElasticBlock, FullElastic
from sparsemor.reducers.full_newton import FullNewton
from sparsemor.reducers.general import GeneralStepper, Summed, coupling
from sparsemor.reducers.heat import FullHeat, HeatBlock, LocalAt
from sparsemor.reducers.other_solver import local_heat_notes, whole_step_notes
from sparsemor.reducers.prepare import constants, stepper
from sparsemor.reducers.reduced_general import reduced_general


class Full(Plugin):
    """All unknowns, all equations: the reference, made as fast as its structure allows."""

    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Relative error of the unknowns that may remain in a step."""
    max_iterations: int = Field(default=30, ge=1)
    """Newton iterations before a step is given up."""
    method: Literal["bordered", "newton"] = "bordered"
    """`bordered`: constant blocks factorized once, or, where a term such as a contact couples them,
    one Jacobian of the whole that is kept while it serves. `newton`: the whole Jacobian factorized
    anew in each iteration, the textbook method, kept as a check."""

    def prepare(
        self, model: Model, integrator: Integrator, h: float,
        offline: Offline, rng: np.random.Generator,
    ) -> StepSolver:
        """Raises InputError where contact at the start does not suit the integrator."""
        tol = Tolerances(self.remaining, self.max_iterations)
        if model.separated.other:
            check_start(model, integrator, h)
        if self.method == "newton":
            return GeneralStepper(
                model, Summed.of(model, price=0), tol, self.predictor,
                notes=whole_step_notes(model, "method: newton solves for all unknowns together"))
        if model.separated.other:
            if not model.reducible():  # rigid bodies only: a few unknowns
                return reduced_general(model, {}, {}, {}, tol, self.predictor)
            names = ", ".join(sorted({n for n, _ in coupling(model) if n})) or "a term"
            return GeneralStepper(
                model, Summed.of(model, price=6), tol, self.predictor,
                notes=whole_step_notes(model, f"{names} couples blocks inside the step"))
        c1, c2, c1_first = constants(model.layout, integrator, h)
        heat: dict[str, HeatBlock] = {}
        elastic: dict[str, ElasticBlock | DrivenBlock] = {}
        kind = FullElastic if model.separated.border_size else FullDriven
        done = 0
        for b in model.separated.heat:
            at = model.layout[b.thermal]
            local = tuple(LocalAt(t, t.rows - at.start, t.columns - at.start) for t in b.local)
            factor = model.factorize(b.thermal, c1_first * b.capacity + b.conductivity)
            heat[b.thermal] = FullHeat(b, c1_first, factor, local)
            done += 1
        for m in model.separated.moving:
            if m.operators is not None:
                o = m.operators
                D = o.stiffness + c1 * o.damping + c2 * o.mass
                elastic[m.elastic] = kind.of(o, model.factorize(m.elastic, D), m.elastic)
                done += 1
        made = stepper(model, model.layout, {}, {}, heat, elastic, tol, self.predictor, done,
                       (c1, c2), notes=local_heat_notes(model))
        if made.iterating:  # chosen where a factor is too large
            return made
        return replace(made, newton=FullNewton(lambda: Summed.of(model, price=0), tol))
