"""Start of a run of a kept reduced model from other rigid coordinates and rates."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.model.initial_state import broken_rates
from sparsemor.core.notes import Note
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.step_solver import StepSolver

Initial = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""Block of rigid coordinates -> their values and rates at the start."""
NEAR = 1e-8
"""Largest error of a joint's equations at the start, relative to their largest terms."""


def rigid_blocks(layout: Layout) -> tuple[str, ...]:
    """Names of the blocks of rigid coordinates."""
    return tuple(b.name for b in layout if layout[b.name].stop <= layout.frames.stop)


def block_faults(initial: Initial, layout: Layout) -> list[Fault]:
    """Faults of names that are no blocks of rigid coordinates."""
    known = rigid_blocks(layout)
    return [Fault(f"initial.{n}", "is no block of rigid coordinates: "
                  f"{', '.join(known) or 'this model has none'}")
            for n in initial if n not in known]


def started_from(start: State, initial: Initial, layout: Layout) -> State:
    """The start with other rigid coordinates and rates. Raises InputError for a wrong number."""
    x, v = start.x.copy(), start.v.copy()
    for name, (values, rates) in initial.items():
        at = layout[name]
        for series, given in ((x, values), (v, rates)):
            array = np.asarray(given, dtype=np.float64)
            if array.shape != (at.stop - at.start,) or not np.isfinite(array).all():
                raise InputError(f"give {at.stop - at.start} finite values and as many rates",
                                 f"initial.{name}")
            series[at] = array
    return replace(start, x=x, v=v)


def start_notes(
    solver: StepSolver, start: State, initial: Initial, layout: Layout
) -> tuple[Note, ...]:
    """Warnings about rates at the start that break a joint. Raises InputError for values that do,
    as for poses of a scene that do not fit its joints."""
    # (l, 2), in the order of the multipliers: value and rate of each constraint; their magnitudes
    found, sizes = solver.constraint_errors(start)
    key = f"initial.{next(iter(initial))}" if len(initial) == 1 else "initial"
    faults, most = [], float(sizes[:, 0].max(initial=0.0))
    for b in layout:
        if b.kind.order > 0:  # not the multipliers of a joint, or of a quaternion's unit length
            continue
        first, at = layout.algebraic.start, layout[b.name]
        gap = float(np.abs(found[at.start - first : at.stop - first, 0]).max(initial=0.0))
        if gap > NEAR * most:
            what = (f"the quaternion of {b.owner} is not of unit length"
                    if layout.of(b.owner, Quantity.POSE) is not None else
                    f"the two sides of joint {b.owner} do not meet at the start")
            faults.append(Fault(key, f"{what}: {gap:.3g} (m, rad, or a cosine); give rigid "
                                     "coordinates that fit all joints"))
    if faults:
        raise InputError(faults)
    return broken_rates(layout, found[:, 1], sizes[:, 1])
