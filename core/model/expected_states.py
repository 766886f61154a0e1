"""Estimated states of a run without training: coarse transient heat conduction and static
displacements."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import coo_array, csr_array

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.model.factorizations import BlockSolvers, solve_or_fail
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.reducer import AssembledModel, StepFactors
from sparsemor.core.protocols.separable import (
    Amplitude,
    ElasticOperators,
    HeatBody,
    MovingBody,
    amplitudes_along,
)

COUNT = 24
"""Number of coarse time steps over the run."""
SAMPLES = 8
"""Number of times in a coarse step at which loads are evaluated."""
ROUND_OFF = 1e-12
"""Ratio of a sum of forces to one of its terms below which the sum is round-off."""


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedStates:
    """Estimated states (n, M) of one block: the initial state, then estimates at M - 1 later times.

    responses (n, j): displacements of norm 1 or less that the loads can cause, and names (j,) of
    these. Static ones are K^-1 f for unit loads f whose size is not known before the run (inertia
    and joint forces). Impulse responses are inertial, where u = K^-1 f is static:

        v = K^-1 M u,    scaled to the norm min(1, |v| / (h^2 |u|))

    the first term in which motion differs from the static one, (K + s^2 M)^-1 f = u - s^2 v + ..,
    with the size that it has at s = 1/h, the fastest change that steps of h resolve. forces (n, M -
    1): the forces (or heat) of the loads that lead to each later state, averaged over its step.
    """

    states: FloatArray
    responses: FloatArray
    names: tuple[str, ...]
    forces: FloatArray


def expected_states(
    model: AssembledModel, name: str, step: StepFactors, end: float
) -> ExpectedStates:
    """Estimated states of block `name` under the prescribed loads, for a run with step size
    `step.h` up to `end`, s:

        (K_T + C / H) T_i = C / H T_(i-1) + q_i      K u_i = f_i + K_fT T_i

    with conductivity K_T, capacity C, heat loads q, stiffness K, forces f and thermal coupling
    K_fT. Loads are averaged over coarse steps H = end / COUNT. Loads that move are elsewhere after
    such a step: for their heat H = step.h, and their forces are averaged over the last step.h.
    Radiation and properties over temperature are linearised at the start; contacts that are
    evaluated in the step, and inertia, are neglected. Raises SolveFailed where a matrix is
    singular.
    """
    times = np.linspace(0.0, end, min(COUNT, max(1, round(end / step.h))) + 1)
    for heat in model.separated.heat:
        if heat.thermal == name:
            none = np.zeros((heat.capacity.shape[0], 0))
            temperatures, q = _temperatures_once(model, heat, times, step.h)
            return ExpectedStates(temperatures, none, (), q)
    for body in model.separated.moving:
        if body.elastic == name and body.operators is not None:
            return _displacements(model, body, body.operators, times, step.h)
    raise KeyError(name)


def _temperatures_once(
    model: AssembledModel, heat: HeatBody, times: FloatArray, h: float
) -> tuple[FloatArray, FloatArray]:
    """The same as `_temperatures`, kept with the model: displacements need them, too."""
    return model.once(("expected temperatures", heat.thermal, len(times), float(times[-1]), h),
                      partial(_temperatures, model, heat, times, h))


def _temperatures(
    model: AssembledModel, heat: HeatBody, times: FloatArray, h: float
) -> tuple[FloatArray, FloatArray]:
    """Estimated temperatures (n, M), K, at times (M,), s, for a run with steps of h, s, and heat of
    the loads before each of the later times (n, M - 1), W. Implicit Euler steps of H, linearised at
    the initial temperatures T_0 (`expected_states`):

        (K_T + K + (C_0 + C) / H) T_i = (C_0 + C) / H T_(i-1) + q_i + K T_0 - r(T_0)

    with conductivity K_T and capacity C_0 of the block, and K, C, r of its local terms.
    """
    coarse = float(times[1] - times[0])
    steps = max(1, round(coarse / h)) if heat.tables else 1  # steps of H in a coarse one
    H = coarse / steps
    K, C, residual = _linearised(model, heat)
    C_over_H = (heat.capacity + C) / H
    data = model.block_data(heat.thermal)
    factor = BlockSolvers(model.linear_solver(heat.thermal)).factorize(
        heat.thermal, heat.conductivity + K + C_over_H, data.places, "expected states")
    states = [model.x0[model.layout[heat.thermal]]]
    constant_heat, loads = heat.constant + K @ states[0] - residual, list[FloatArray]()
    fine_times = np.linspace(times[0], times[-1], steps * (len(times) - 1) + 1)
    means = _means(heat.amplitudes, fine_times)
    for before, after, mean in zip(fine_times[:-1], fine_times[1:], means, strict=True):
        q = constant_heat + heat.loads @ mean
        q = q + _moving(heat.tables, before, after, len(q))
        loads.append(q)
        states.append(solve_or_fail(factor, np.asarray(C_over_H @ states[-1] + q), heat.thermal))
    return np.stack(states[::steps], axis=1), np.stack(loads[steps - 1::steps], axis=1)


def _linearised(model: AssembledModel, heat: HeatBody) -> tuple[Csr, Csr, FloatArray]:
    """Terms of a temperature block that are evaluated element by element (k(T), c(T), radiation),
    linearised at the initial temperatures: conductivity K and capacity C (n, n), and residual (n,)
    there."""
    part = model.layout[heat.thermal]
    n = part.stop - part.start
    with_rates, K, r = csr_array((n, n)), csr_array((n, n)), np.zeros(n)
    for term in heat.local:
        rows, columns = term.rows - part.start, term.columns - part.start
        x, zero = model.x0[term.columns], np.zeros(len(columns))
        # Jacobians with dv = c dx: K for c = 0, K + C for c = 1
        at_rest, with_rate = (coo_array(term.jacobian(x, zero, zero, 0.0, zero + c, zero))
                         for c in (0.0, 1.0))
        K = K + csr_array((at_rest.data, (rows[at_rest.row], columns[at_rest.col])), shape=(n, n))
        with_rates = with_rates + csr_array(
            (with_rate.data, (rows[with_rate.row], columns[with_rate.col])), shape=(n, n))
        np.add.at(r, rows, term.residual(x, zero, zero, 0.0))
    return K, csr_array(with_rates - K), r


def _displacements(
    model: AssembledModel, body: MovingBody, ops: ElasticOperators, times: FloatArray, h: float,
) -> ExpectedStates:
    """Estimated displacements of an elastic block (`ExpectedStates`): static ones x = K^-1 f under
    the mean loads of each coarse step, then the responses of norm 1 to unit forces of joints and
    frame, and to impulses, v = K^-1 M x. times (M,): ends of the coarse steps, s; h: time step, s.
    """
    name, thermal = body.elastic, body.thermal
    data = model.block_data(name)
    heat = next((h for h in model.separated.heat if h.thermal == thermal), None)
    thermal_forces = np.zeros((data.size, len(times)))
    if heat is not None and ops.coupling is not None:
        thermal_forces = np.asarray(ops.coupling @ _temperatures_once(model, heat, times, h)[0])
    forces = []
    by_frame, means = _frame_forces(model, body, times), _means(ops.amplitudes, times)
    for i, after in enumerate(times[1:]):
        f = ops.constant + ops.loads @ means[i]
        f = f + _moving(ops.tables, after - h, after, len(f)) + thermal_forces[:, i + 1]
        # minus: directions stand on the left-hand side of the elastic equations
        f = f - ops.directions @ by_frame[i]
        # a uniform temperature of no stress: thermal forces cancel to round-off
        cancelled = np.linalg.norm(f) <= ROUND_OFF * np.linalg.norm(ops.constant)
        forces.append(np.zeros_like(f) if cancelled else f)
    named_columns = [i for i, column in enumerate(ops.columns)
             if column.name and ops.directions[:, i].any()]  # loads of unknown size
    factor = BlockSolvers(model.linear_solver(name)).factorize(
        name, ops.stiffness, data.places, "expected states")
    load_columns = np.column_stack([*forces, ops.directions[:, named_columns]])
    displaced = solve_or_fail(factor, np.ascontiguousarray(load_columns), name)
    impulse_shapes = solve_or_fail(factor, np.ascontiguousarray(ops.mass @ displaced), name)
    displaced_size = np.linalg.norm(displaced, axis=0)
    impulse_size = np.linalg.norm(impulse_shapes, axis=0)
    moved = np.flatnonzero(displaced_size)  # columns with a response that is not zero
    unit_loads = moved[moved >= len(forces)]
    loads = ["the loads"] * len(forces) + [ops.columns[i].name for i in named_columns]
    start = model.x0[model.layout[name]]
    impulse_scale = np.maximum(impulse_size, h**2 * displaced_size)
    return ExpectedStates(
        np.column_stack([start, displaced[:, : len(forces)]]),
        np.column_stack([displaced[:, unit_loads] / displaced_size[unit_loads],
                         impulse_shapes[:, moved] / impulse_scale[moved]]),
        (*(f"the static response to {loads[i]}" for i in unit_loads),
         *(f"the impulse response to {loads[i]}" for i in moved)),
        load_columns[:, : len(forces)])


def _means(amplitudes: Sequence[Amplitude], times: FloatArray) -> FloatArray:
    """Averages (M - 1, j) of the load amplitudes over each of the steps between times (M,), s."""
    at = _samples(times)
    values = amplitudes_along(amplitudes, at.ravel()).reshape(*at.shape, -1)
    return np.asarray(values.mean(axis=1))


def _samples(times: FloatArray) -> FloatArray:
    """Times (M - 1, SAMPLES) within the steps between times (M,), s, at which loads are
    evaluated."""
    before, after = times[:-1, None], times[1:, None]
    return before + (np.arange(SAMPLES) + 0.5) / SAMPLES * (after - before)


def _frame_forces(model: AssembledModel, body: MovingBody, times: FloatArray) -> FloatArray:
    """Averages (M - 1, p), over each of the steps between times (M,), of the factors of a body's
    directions (`ElasticOperators`) in its initial pose: loads that act through the floating frame.
    For a body that moves (its inertia acts through the frame), their change since the start: loads
    at the start, such as gravity, are balanced by inertia and joint forces, which are not known
    here. A frame whose amplitudes are constant, as that of gravity, is evaluated once."""
    frame, samples, arrays = body.frame, _samples(times), body.frame.arrays()
    if arrays is not None:
        gains = amplitudes_along(
            [f for f in arrays.amplitudes if f is not None], samples.ravel())
        # samples (M - 1, SAMPLES): times in each step; one of them for constant amplitudes
        samples = samples[:1, :1] if (gains == gains[0]).all() else samples
    rigid = model.layout.frames
    y = body.origin + body.to_border[:, rigid] @ model.x0[rigid]
    # at rest and without displacements: rates, functionals s and quadratic forms are zero
    zero, s, forms = np.zeros(frame.border), np.zeros((3, frame.p)), np.zeros(3 * frame.generators)
    work = FrameWork(frame.p, frame.border, frame.generators)
    total = np.zeros((len(samples), frame.p))
    for one, at in zip(total, samples.tolist(), strict=True):
        for t in at:
            frame.evaluate(y, zero, zero, 0.0, 0.0, s, forms, t, work)
            one += work.sigma[-1] / len(at)  # the last row: factors of the directions
    if body.frame.shape_columns:
        frame.evaluate(y, zero, zero, 0.0, 0.0, s, forms, 0.0, work)
        total -= work.sigma[-1]
    return np.broadcast_to(total, (len(times) - 1, frame.p))


def _moving(tables: Sequence[LoadTable], before: float, after: float, n: int) -> FloatArray:
    """Average (n,) of the moving loads over the times from `before` to `after`, s: of their
    tabulated times there, else their value at the end."""
    total = np.zeros(n)
    for load in tables:
        t = load.table.times
        inside = (t > before) & (t <= after)
        row = load.table.values[inside].mean(axis=0) if inside.any() else load.table.at(after)
        total += load.columns @ row
    return total
