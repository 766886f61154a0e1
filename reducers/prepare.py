"""What every reducer does before its first step."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.model import Model
from sparsemor.core.protocols import Dictionary, Integrator, State
from sparsemor.core.separable import Frame
from sparsemor.reducers.bordered import Tolerances
from sparsemor.reducers.elastic import ElasticBlock
from sparsemor.reducers.heat import HeatBlock
from sparsemor.reducers.stepper import Stepper


def constants(layout: Layout, integrator: Integrator, h: float) -> tuple[float, float, float]:
    """c1, c2 and c1 of first-order unknowns: the same in every step of size h."""
    zero = np.zeros(layout.size)
    state = integrator.start(layout, State(0.0, zero, zero, zero, np.zeros((layout.size, 0))))
    f = integrator.formula(layout, state, h)
    return f.c1, f.c2, f.c1_first


def stepper(
    model: Model, layout: Layout, dictionaries: Mapping[str, Dictionary],
    rows: Mapping[str, IntArray], heat: Mapping[str, HeatBlock],
    elastic: Mapping[str, ElasticBlock], frames: Mapping[str, Frame], tol: Tolerances,
    points: int, factorizations: int, limits: Mapping[str, float] | None = None,
    notes: tuple[str, ...] = (),
) -> Stepper:
    """A Stepper with its mechanics set up, and the elements that one step visits."""
    elements = {b.thermal: sum(t.elements for t in b.local) for b in model.separated.heat}
    for b in model.separated.heat:
        local = getattr(heat.get(b.thermal), "local", ())
        elements[b.thermal] = sum(getattr(t, "elements", None) or getattr(
            getattr(t, "term", None), "elements", 0) for t in local)
    elements |= {m.elastic: 0 for m in model.separated.moving if m.elastic}
    s = Stepper(layout, dictionaries, rows, elements, model.separated, heat, elastic, frames, tol,
                points, factorizations, limits or {}, notes)
    return replace(s, mechanics=s.with_mechanics())
