"""Rows of tested operators: some of them, or all of them times a small matrix."""

from dataclasses import replace

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.operators import TestedElastic, TestedHeat


def elastic_rows(t: TestedElastic, rows: IntArray) -> TestedElastic:
    """The rows number `rows` (m,): copies, so that nothing of the whole is kept alive."""
    return replace(
        t, mass=t.mass[rows], damping=t.damping[rows], stiffness=t.stiffness[rows],
        generators=t.generators[:, rows], directions=t.directions[rows],
        coupling=t.coupling[rows], loads=t.loads[rows], constant=t.constant[rows],
        tables=tuple(table.columns(rows) for table in t.tables),
        local=tuple(part.times(np.eye(len(t.mass))[rows]) for part in t.local))


def heat_rows(t: TestedHeat, rows: IntArray) -> TestedHeat:
    """The rows number `rows` (m,)."""
    return replace(t, capacity=t.capacity[rows], conductivity=t.conductivity[rows],
                   constant=t.constant[rows], loads=t.loads[rows],
                   tables=tuple(table.columns(rows) for table in t.tables))


def elastic_times(left: FloatArray | None, t: TestedElastic) -> TestedElastic:
    """left (l, m) times every row operator; None is the identity."""
    if left is None:
        return t
    return replace(
        t, mass=left @ t.mass, damping=left @ t.damping, stiffness=left @ t.stiffness,
        generators=left @ t.generators, directions=left @ t.directions,
        coupling=left @ t.coupling, loads=left @ t.loads, constant=left @ t.constant,
        tables=tuple(table.through(left) for table in t.tables),
        local=tuple(part.times(left) for part in t.local))


def heat_times(left: FloatArray | None, t: TestedHeat) -> TestedHeat:
    """left (l, m) times every row operator; None is the identity."""
    if left is None:
        return t
    return replace(t, capacity=left @ t.capacity, conductivity=left @ t.conductivity,
                   constant=left @ t.constant, loads=left @ t.loads,
                   tables=tuple(table.through(left) for table in t.tables))
