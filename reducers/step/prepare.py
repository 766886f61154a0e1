"""Assembly of the block-wise step solver, common to all reducers."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    IntArray,
    Integrator,
    Layout,
    Note,
)
from sparsemor.core.protocols import MovingBody
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.blocks.thermal_block import HeatBlock
from sparsemor.reducers.step.blocks.thermal_groups import group_name
from sparsemor.reducers.step.frame_step import BodyStep, PrescribedFactors
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.reduced_mechanics import Mechanics
from sparsemor.reducers.step.solver import Facts, Stepper, bodies
from sparsemor.reducers.step.time_tables import TimeTable


def constants(integrator: Integrator, h: float) -> tuple[float, float, float]:
    """Integrator constants c1, c2, and c1 of first-order unknowns, for steps of size h, s."""
    return integrator.rules(h).factors


def stepper(
    model: AssembledModel, layout: Layout, dictionaries: Mapping[str, Dictionary],
    rows: Mapping[str, IntArray], heat: Mapping[str, HeatBlock], tol: Tolerances, points: int,
    factorizations: int, limits: Mapping[str, float] | None = None,
    notes: tuple[Note, ...] = (), tested: Mapping[str, TestedElastic] | None = None,
    facts: Facts | None = None, visited: Mapping[str, int] | None = None,
) -> Stepper:
    """Block-wise step solver from reduced or full-order blocks, with the elements that one step
    visits.

    points: number of past states to extrapolate; tested: projected elastic operators, for
    consistent initial rates; visited: elements of each thermal block's local terms, where these are
    not those of `heat`, whose keys are groups of coupled blocks.
    """
    # constant matrices were assembled once: only local terms visit elements in a step
    elements = {name: 0 for name in model.reducible()}
    elements |= visited or {name: block.elements for name, block in heat.items()}
    elements |= {n: sum(part.term.elements for part in t.local)
                 for n, t in (tested or {}).items() if t.local}
    # unknowns over their limits; those without one are scaled to be caught when not finite only
    sanity = np.full(layout.size, 1e-150)
    for name, limit in (limits or {}).items():
        sanity[layout[name]] = 1.0 / limit
    frames = {m.name: tested[m.elastic].frame for m in model.separated.moving
              if tested and m.elastic in tested}
    s = Stepper(layout, dictionaries, rows, elements, model.separated, heat, frames, tol, points,
                factorizations, limits or {}, sanity, notes, facts or {}, tested or {},
                hot=_hot(model, layout))
    return replace(s, mechanics=Mechanics(
        bodies(s), layout.frames.stop, layout.algebraic, model.separated.border_targets, tol))


def _hot(model: AssembledModel, layout: Layout) -> tuple[tuple[str, slice | IntArray], ...]:
    """Name and unknowns of each group of coupled thermal blocks."""
    at = np.arange(layout.size)
    return tuple((group_name(g), layout[g[0].thermal] if len(g) == 1 else np.concatenate(
        [at[layout[b.thermal]] for b in g])) for g in model.separated.heat_groups)


def time_table(step: BodyStep, body: MovingBody, ahead: bool = True) -> TimeTable:
    """Factors of a frame without unknowns as functions of time, tabulated if `ahead`."""
    return TimeTable.of(PrescribedFactors(step), _times(body) if ahead else np.zeros(0))


def _times(body: MovingBody) -> FloatArray:
    """Times (T,) at which a body's prescribed motion or its loads are tabulated, s."""
    if body.guide is not None:
        return body.guide.times
    loads = () if body.operators is None else body.operators.tables
    return loads[0].table.times if loads else np.zeros(0)
