"""What every reducer does before its first step."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.model import Model
from sparsemor.core.protocols import Dictionary, Integrator, State
from sparsemor.reducers.bordered import Tolerances
from sparsemor.reducers.driven_block import DrivenBlock, FullDriven
from sparsemor.reducers.elastic import ElasticBlock, FullElastic
from sparsemor.reducers.heat import HeatBlock
from sparsemor.reducers.stepper import Facts, Stepper
from sparsemor.reducers.test_map import TestedElastic


def constants(layout: Layout, integrator: Integrator, h: float) -> tuple[float, float, float]:
    """c1, c2 and c1 of first-order unknowns: the same in every step of size h."""
    zero = np.zeros(layout.size)
    state = integrator.start(layout, State(0.0, zero, zero, zero, np.zeros((layout.size, 0))))
    f = integrator.formula(layout, state, h)
    return f.c1, f.c2, f.c1_first


def stepper(
    model: Model, layout: Layout, dictionaries: Mapping[str, Dictionary],
    rows: Mapping[str, IntArray], heat: Mapping[str, HeatBlock],
    elastic: Mapping[str, ElasticBlock | DrivenBlock], tol: Tolerances,
    points: int, factorizations: int, limits: Mapping[str, float] | None = None,
    notes: tuple[str, ...] = (), tested: Mapping[str, TestedElastic] | None = None,
    facts: Facts | None = None,
) -> Stepper:
    """A Stepper with its mechanics set up, and the elements that one step visits.

    tested: the elastic blocks under their maps, for consistent rates at the start.
    """
    # constant matrices were assembled once: only local terms visit elements in a step
    elements = {name: 0 for name in model.reducible()}
    elements |= {name: block.elements for name, block in heat.items()}
    # unknowns over their limits; those without one are scaled to be caught when not finite only
    sanity = np.full(layout.size, 1e-150)
    for name, limit in (limits or {}).items():
        sanity[layout[name]] = 1.0 / limit
    frames = {m.name: tested[m.elastic].frame for m in model.separated.moving
              if tested and m.elastic in tested}
    s = Stepper(layout, dictionaries, rows, elements, model.separated, heat, elastic, frames, tol,
                points, factorizations, limits or {}, sanity, notes, facts or {},
                tested or {}, iterating=any(
                    isinstance(b, FullElastic | FullDriven) and b.factor.iterative
                    for b in elastic.values()))
    return replace(s, mechanics=s.with_mechanics())
