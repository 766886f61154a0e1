"""POD-Galerkin (or any basis): trial and test map are the same atoms, compressed offline."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from sparsemor.core.errors import Fault
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Basis, Integrator, StepSolver
from sparsemor.core.slot import Slot, slot_default
from sparsemor.reducers.bordered import Tolerances
from sparsemor.reducers.checks import pattern_faults
from sparsemor.reducers.choose import chosen
from sparsemor.reducers.elastic import CompressedElastic, ElasticBlock
from sparsemor.reducers.heat import CompressedHeat, HeatBlock
from sparsemor.reducers.prepare import constants, inverse, stepper
from sparsemor.reducers.represent import local_terms, refuse_other, represent
from sparsemor.reducers.test_map import TestedElastic, TestedHeat, TestMap


class Galerkin(Plugin):
    """Online cost does not grow with the mesh, except for local terms, which are all visited."""

    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Relative error of the unknowns that may remain in a step."""
    max_iterations: int = Field(default=30, ge=1)
    """Newton iterations before a step is given up."""

    def check(self, model: Model) -> Sequence[Fault]:
        """What can be refused by counting, before any training; keys relative to the reducer."""
        return pattern_faults(model, "bases", self.bases)

    def prepare(
        self, model: Model, integrator: Integrator, h: float,
        offline: Offline, rng: np.random.Generator,
    ) -> StepSolver:
        refuse_other(model, "galerkin")
        c1, c2, c1_first = constants(model.layout, integrator, h)
        dictionaries, limits = represent(
            offline, {n: chosen(n, self.bases, self.basis) for n in model.reducible()})
        heat: dict[str, HeatBlock] = {}
        elastic: dict[str, ElasticBlock] = {}
        tested: dict[str, TestedElastic] = {}
        done = 0
        for b in model.separated.heat:
            d = dictionaries[b.thermal]
            tested_h = TestedHeat.of(b, d, TestMap(left=d.atoms.T))
            left = inverse(tested_h.block(c1_first))
            local = local_terms(model, b, d, left @ d.atoms.T)
            heat[b.thermal] = CompressedHeat.of(tested_h, left, None, c1_first, local)
            done += 1
        for m in model.separated.moving:
            if m.operators is None:
                continue
            d = dictionaries[m.elastic]
            tested_e = TestedElastic.of(
                m.operators, m.frame, d, dictionaries.get(m.thermal), TestMap(left=d.atoms.T))
            left = inverse(tested_e.block(c1, c2))
            elastic[m.elastic] = CompressedElastic.of(tested_e, left, None)
            tested[m.elastic] = tested_e
            done += 1
        layout = model.layout.resized({n: d.atoms.shape[1] for n, d in dictionaries.items()})
        return stepper(
            model, layout, dictionaries, {}, heat, elastic,
            Tolerances(self.remaining, self.max_iterations), self.predictor, done,
            limits, tested=tested)
