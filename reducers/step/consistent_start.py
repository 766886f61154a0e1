"""Consistent initial accelerations and multipliers of a reduced model.

Full-order accelerations are not in the span of a basis of displacements; their projection would
start a second-order integrator with wrong accelerations. The reduced equations are therefore solved
for their own accelerations: elastic rows, rigid rows, and the second time derivative of the
constraints. All unknowns enter linearly; the coefficients follow from evaluations of the frame
equations with c2 = 0 and c2 = 1/h^2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core import FloatArray, State
from sparsemor.core.model.constraint_rates import along_motion
from sparsemor.core.model.initial_state import AGAIN, BENT
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.time_function import time_derivatives
from sparsemor.reducers.linalg.least_norm import least
from sparsemor.reducers.step.border_matrix import BorderMatrix
from sparsemor.reducers.step.frame_step import NONE, BodyStep, buffers
from sparsemor.reducers.step.jacobian_factors import MANY
from sparsemor.reducers.step.projected_operators import ProjectedElastic
from sparsemor.reducers.step.reduced_mechanics import Mechanics
from sparsemor.reducers.step.time_tables import plus_loads


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """Linear equations of one body in its b border unknowns z (rigid accelerations, multipliers):

        accelerations of its k atoms: c'' = -(base + S z),    border rows: rows + H z + tau c'' = 0

    base (k,), S (k, b), rows (b,), H (b, b), tau (b, k).
    """

    base: FloatArray
    S: FloatArray
    rows: FloatArray
    H: FloatArray
    tau: FloatArray


def consistent_start(
    mechanics: Mechanics, operators: Sequence[ProjectedElastic | None], state: State,
    motion: float,
) -> State:
    """The state with elastic and rigid accelerations and multipliers that satisfy the reduced
    equations. operators: operators of each body, None for a rigid one; motion: step of the finite
    differences of constraint Jacobians, s (core/model/constraint_rates.py).

    Multipliers that the reduced equations do not determine (all atoms satisfy their constraint
    already) are the solution of least norm.
    """
    nr = mechanics.n_rigid
    if not mechanics.bodies:
        return state
    if not mechanics.size:  # no frame moves freely, and no joint force is unknown
        return _prescribed_start(mechanics, operators, state)
    # z: rigid accelerations, then multipliers; repeated where friction is not linear in the latter,
    # at most AGAIN times, until they change by less than BENT of the largest; NONE: no numbers yet
    forces, last = np.zeros(mechanics.size), NONE
    for _ in range(AGAIN):
        z, parts, nonlinear = _accelerations(mechanics, operators, state, motion, forces)
        forces = np.concatenate([np.zeros(nr), z[nr:]])
        change = np.abs(z[nr:] - last).max(initial=0.0) if len(last) else np.inf
        last = z[nr:]
        if not nonlinear or change <= BENT * np.abs(last).max(initial=0.0):
            break
    x, a = state.x.copy(), state.a.copy()
    a[:nr], x[mechanics.algebraic] = z[:nr], z[nr:]
    for body, p in zip(mechanics.bodies, parts, strict=True):
        if len(p.base):
            a[body.elastic] = -(p.base + p.S @ (body.to_border @ z))
    return replace(state, x=x, a=a)


def _accelerations(
    mechanics: Mechanics, operators: Sequence[ProjectedElastic | None], state: State,
    motion: float, forces: FloatArray,
) -> tuple[FloatArray, Sequence[_Body], bool]:
    """Rigid accelerations and multipliers z (n,), by equations linearised at the multipliers in
    `forces` (n,), whose leading entries, those of rigid coordinates, are zero; T (b, n),
    `to_border`, makes the border unknowns of a body of them. Returned with z are the equations of
    each body (`_Body`); True if these are not linear up to the result. operators, motion: as in
    `consistent_start`."""
    nr = mechanics.n_rigid
    parts = list[_Body]()
    for body, t in zip(mechanics.bodies, operators, strict=True):
        parts.append(_linear(mechanics, body, t, state, motion, forces))
    maps = [body.to_border for body in mechanics.bodies]
    # elastic accelerations eliminated (Schur complement): B z + r = target accelerations
    r = sum(T.T @ (p.rows - p.tau @ p.base) for T, p in zip(maps, parts, strict=True))
    border = BorderMatrix(maps)
    B = border.matrix(border.assembled(np.concatenate([
        (p.H - p.tau @ p.S).ravel() for p in parts])))
    z = -least(B if mechanics.size >= MANY else B.toarray(),
               r - _target_accelerations(mechanics, state.t))
    multipliers = np.concatenate([np.zeros(nr), z[nr:]])
    nonlinear = any(_is_nonlinear(mechanics, body, t, state, p, multipliers)
                    for body, t, p in zip(mechanics.bodies, operators, parts, strict=True))
    return z, parts, nonlinear


def constraint_errors(
    mechanics: Mechanics, operators: Sequence[ProjectedElastic | None], state: State
) -> tuple[FloatArray, FloatArray]:
    """Errors of the l constraints at a state, (l, 2): value and time derivative; and magnitudes
    (l, 2) of their terms, to compare them with."""
    # columns: value, time derivative; rows: rigid coordinates (unused), then constraints
    errors, sizes = (np.zeros((mechanics.size, 2)) for _ in range(2))
    for i, f in mechanics.targets:
        target = np.array([f(state.t), time_derivatives(f, state.t, mechanics.h)[0]])
        errors[i] -= target
        sizes[i] += np.abs(target)
    for body, t in zip(mechanics.bodies, operators, strict=True):
        origin, rate, _ = body.border_motion(state.t)
        y, v = _border(mechanics, body, state.x, origin), _border(mechanics, body, state.v, rate)
        d, w = body.frame.rigid_size, _evaluate(body, t, y, v, c2=0.0, state=state)
        # of the body's border: y are d rigid coordinates, then joint forces; in the rows from d on
        # w.border has the derivatives of the constraints by y and, in its last column, their values
        rows, size = np.zeros((len(y), 2)), np.zeros((len(y), 2))
        rows[d:, 0], rows[d:, 1] = w.border[d:, -1], _moving(body, t, y, v, state)
        of_time = body.frame.time_derivative(1, state.t, mechanics.h)
        if of_time is not None:
            rows[d:, 1] += _evaluate(
                replace(body, frame=of_time), t, y, v, c2=0.0, state=state).border[d:, -1]
        # y is the position, then the attitude, whose magnitude is at least 1
        reach, count = np.abs(y[:d]), min(3, d - 1)
        reach[count:] = np.maximum(reach[count:], 1.0)
        size[d:] = np.abs(w.border[d:, :d]) @ np.stack([reach, np.abs(v[:d])], axis=1)
        errors += body.to_border.T @ rows
        sizes += np.abs(body.to_border).T @ size
    return errors[mechanics.n_rigid :], sizes[mechanics.n_rigid :]


def _prescribed_start(
    mechanics: Mechanics, operators: Sequence[ProjectedElastic | None], state: State
) -> State:
    """Consistent accelerations where all frames are prescribed or at rest: each elastic block
    separately."""
    a = state.a.copy()
    for body, t in zip(mechanics.bodies, operators, strict=True):
        if t is not None:
            w, = buffers([body.frame])  # `drive` fills in kappa, mu, sigma of a prescribed motion
            body.frame.drive(*body.border_motion(state.t), state.t, w)
            rows = _elastic_rows(body, t, w, state)  # mass a + rows = 0
            a[body.elastic] = -np.linalg.lstsq(t.mass, rows, rcond=None)[0]
    return replace(state, a=a)


def _linear(
    mechanics: Mechanics, body: BodyStep, ops: ProjectedElastic | None, state: State, motion: float,
    forces: FloatArray,
) -> _Body:
    """Linear equations of a body in accelerations and multipliers, with the derivatives by
    multipliers taken at `forces` (n,): rigid rows by two evaluations of the frame, with c2 = 0 (w0)
    and c2 = 1/h^2 (w1), whose difference divided by c2 is the mass; constraint rows (from d on) as
    their second time derivative. Of w0, w1 (`FrameWork`): border (b, b + 1) = [H, rows], tau (b,
    p), and sigma (b + 1, p), whose last row are the factors of the p directions in the elastic
    equations and whose others are their derivatives by the border unknowns."""
    origin, rate, _ = body.border_motion(state.t)
    # y, v (b,) have rigid coordinates and zeros for joint forces, which are added here
    prescribed_forces = body.to_border @ forces  # (b,): on this body, in the entries from d on
    y, v = _border(mechanics, body, state.x, origin), _border(mechanics, body, state.v, rate)
    c2 = 1.0 / mechanics.h**2  # large enough that masses are not lost against centrifugal terms
    w0, w1 = (_evaluate(body, ops, y + prescribed_forces, v, c, state) for c in (0.0, c2))
    d = body.frame.rigid_size
    H = np.zeros_like(w0.border[:, :-1])
    H[:d, :d], H[:d, d:] = (w1.border - w0.border)[:d, :d] / c2, w0.border[:d, d:-1]
    # constraints by multipliers: a compliance, times c2 as in a second time derivative
    H[d:, :d], H[d:, d:] = w0.border[d:, :d], c2 * w0.border[d:, d:-1]
    # w0 was evaluated at these forces: extrapolated to zero
    rows = w0.border[:, -1] - H[:, d:] @ prescribed_forces[d:]
    rows[d:] = _curvature(mechanics, body, ops, y, v, state, motion)
    if ops is None:
        return _Body(NONE, np.zeros((0, len(rows))), rows, H, np.zeros((len(rows), 0)))
    sigma = np.concatenate([(w1.sigma[:d] - w0.sigma[:d]) / c2, w0.sigma[d:-1]])
    tau = np.concatenate([(w1.tau[:d] - w0.tau[:d]) / c2, w0.tau[d:]])
    elastic_rows = _elastic_rows(body, ops, w0, state) - ops.directions @ (
        w0.sigma[d:-1].T @ prescribed_forces[d:])
    right_sides = np.concatenate([elastic_rows[:, None], ops.directions @ sigma.T], axis=1)
    accelerations = np.linalg.lstsq(ops.mass, right_sides, rcond=None)[0]
    return _Body(accelerations[:, 0], accelerations[:, 1:], rows, H, tau @ ops.functional)


def _is_nonlinear(
    mechanics: Mechanics, body: BodyStep, ops: ProjectedElastic | None, state: State, p: _Body,
    forces: FloatArray,
) -> bool:
    """True if the forces on the body's frame are not linear in multipliers, up to those in `forces`
    (n,): the rigid rows there differ by more than BENT from rows + H forces of the body's linear
    equations p. Rigid rows are the first d."""
    origin, rate, _ = body.border_motion(state.t)
    y, v = (_border(mechanics, body, *of) for of in ((state.x, origin), (state.v, rate)))
    d, prescribed_forces = body.frame.rigid_size, body.to_border @ forces
    frame_rows = _evaluate(
        body, ops, y + prescribed_forces, v, c2=0.0, state=state).border[:d, -1]
    by_joints = p.H[:d, d:] @ prescribed_forces[d:]
    return bool(np.abs(frame_rows - p.rows[:d] - by_joints).max(initial=0.0) > BENT * (
        np.abs(by_joints).max(initial=0.0) + np.abs(p.rows[:d]).max(initial=0.0)))


def _border(
    mechanics: Mechanics, body: BodyStep, x: FloatArray, right: FloatArray
) -> FloatArray:
    """Border unknowns of one body with all multipliers zero, plus their prescribed part."""
    whole = np.zeros(mechanics.size)
    whole[: mechanics.n_rigid] = x[: mechanics.n_rigid]
    return np.asarray(body.to_border @ whole + right)


def _evaluate(
    body: BodyStep, ops: ProjectedElastic | None, y: FloatArray, v: FloatArray, c2: float,
    state: State,
) -> FrameWork:
    """Frame equations at border unknowns y with rates v (b,) and zero unknown accelerations, with
    derivatives for dv = 0 and da = c2 dx."""
    frame, c = body.frame, state.x[body.elastic]
    w = FrameWork(frame.p, frame.border, frame.generators)
    body.evaluate(
        y, v, a=body.border_motion(state.t)[2], c1=0.0, c2=c2, operators=ops, c=c,
        cv=state.v[body.elastic], ca=np.zeros(len(c)), t=state.t, work=w)
    return w


def _elastic_rows(
    body: BodyStep, ops: ProjectedElastic, w: FrameWork, state: State
) -> FloatArray:
    """Projected elastic rows (m,) without the inertia of elastic accelerations, for coefficients c
    and temperature coefficients cT of the state, with the factors kappa, mu, sigma of the frame in
    `w`:

        K c + D c' + E sigma + sum_g (kappa_g G_g c + mu_g G_g c') - C_T cT + constant - loads(t)
        + local terms,    E: `directions`, G_g: `generators`, C_T: `coupling`.
    """
    c, cv = state.x[body.elastic], state.v[body.elastic]
    kappa, mu = w.coefficients[:-1].reshape(2, -1)  # the last is 1, the factor of mass a
    r = ops.stiffness @ c + ops.damping @ cv + ops.constant + ops.directions @ w.sigma[-1]
    r = r + np.tensordot(kappa, ops.generators, 1) @ c + np.tensordot(mu, ops.generators, 1) @ cv
    if ops.coupling.size:
        r = r - ops.coupling @ state.x[body.thermal]
    r = plus_loads(r, ops, state.t, -1.0)  # - loads(t)
    if ops.local:
        x, v = (np.concatenate((s[body.elastic], s[body.thermal])) for s in (state.x, state.v))
        r = r + sum(part.rows(x, v, np.zeros(len(x)), state.t) for part in ops.local)
    return np.asarray(r)


def _curvature(
    mechanics: Mechanics, body: BodyStep, ops: ProjectedElastic | None, y: FloatArray,
    v: FloatArray, state: State, motion: float,
) -> FloatArray:
    """Second time derivative of the constraint rows g of the body's attachments at zero
    accelerations, (d/ds G(y + s v)) v + 2 (dG/dt) v + d2g/dt2 (core/model/constraint_rates.py).

    G: Jacobian of g by border unknowns y (b,), with rates v, and displacements; `_moving` is G v.
    motion: step s of the finite difference along the motion, s.
    """
    found = np.zeros(body.frame.border - body.frame.rigid_size)
    # derivative along the motion: sum of weight times value at s, a central difference
    for s, weight in along_motion(motion):
        moved = replace(state, x=state.x + s * state.v)
        found += weight * _moving(body, ops, y + s * v, v, moved)
    first, second = (body.frame.time_derivative(n, state.t, mechanics.h) for n in (1, 2))
    if first is not None:
        found = found + 2.0 * _moving(replace(body, frame=first), ops, y, v, state)
    if second is not None:
        w = _evaluate(replace(body, frame=second), ops, y, v, c2=0.0, state=state)
        found = found + w.border[body.frame.rigid_size :, -1]
    return found


def _moving(
    body: BodyStep, ops: ProjectedElastic | None, y: FloatArray, v: FloatArray, state: State
) -> FloatArray:
    """Jacobian of the constraint rows of the body's attachments times the velocities."""
    d, w = body.frame.rigid_size, _evaluate(body, ops, y, v, c2=0.0, state=state)
    found = w.border[d:, :d] @ v[:d]
    return found if ops is None else found + w.tau[d:] @ (ops.functional @ state.v[body.elastic])


def _target_accelerations(mechanics: Mechanics, t: float) -> FloatArray:
    """Second time derivative of prescribed joint motion."""
    found = np.zeros(mechanics.size)
    for i, f in mechanics.targets:
        found[i] = time_derivatives(f, t, mechanics.h)[1]
    return found
