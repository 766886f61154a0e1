"""Steady motion of a state, and changes of it in the axes of the moving bodies.

A body that spins at a constant rate has constant equations in its own axes only. Changes of its
rigid coordinates are written there: with the rotation matrix A of the frame and its attitude q,

    dR = A r,    dq = L(q) w,

r (d,) a translation and w a rotation in body axes. With z = (r, w, u) for all bodies the change of
the state is T z, and its rates are T z' + T' z and T z'' + 2 T' z' + T'' z, T' and T'' the rates of
T along the steady motion. They give the constant stiffness, damping (with gyroscopic matrix) and
mass in z,

    K' = T^T (K T + D T' + M T''),    D' = T^T (D T + 2 M T'),    M' = T^T M T.

The quaternion of a body in space has three such changes: its multiplier drops out.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.sparse import block_diag, csc_array, diags_array, eye_array

from sparsemor.core import Block, BoolArray, Csr, FloatArray, IntArray, State
from sparsemor.core.model.constraint_rates import Constraints
from sparsemor.core.protocols.layout import Layout, Quantity, joints_with_forces
from sparsemor.core.protocols.poses import FREE_POSE, PLANAR_POSE, turns, vectors_in_space
from sparsemor.plugins.analyses.analysed_equations import System, Tangents

TRIES, CLOSED, LONGEST = 200, 1e-13, 1e3
"""Largest number of steps of `assembled`, last change (m, rad), and longest step."""
ROUNDING = 1e-13
"""Of rates by differences, relative to the largest."""
STEP = 1e-3
"""Rotation, rad, between the attitudes whose differences are T' and T''."""


def spinning(system: System, at: State, h: float) -> tuple[FloatArray, FloatArray]:
    """Rates and second derivatives (n,) of the rigid coordinates in steady motion through a state:
    the initial rates, turned with the bodies and changed such that all joints and drives hold,
    rates of positions before those of attitudes; h: time step, s."""
    layout, model = system.layout, system.model
    frames, rows = layout.frames, layout.algebraic
    constraints = Constraints.from_terms(layout, system.terms, h)
    G = system.jacobian(at)[rows][:, frames].toarray()
    v, a, positions = np.zeros(layout.size), np.zeros(layout.size), np.zeros(frames.stop, np.bool_)
    v[frames] = model.v0[frames]
    for b in layout:
        if b.kind.quantity is Quantity.POSE:
            own = layout[b.name]
            positions[own.start : own.start + (2 if b.size == PLANAR_POSE else 3)] = True
            if b.size == FREE_POSE:
                # rate of the quaternion for the same angular velocity in body axes
                p, q = at.x[own][3:], model.x0[own][3:]
                v[own][3:] = turns(p[None], q[None])[0] @ v[own][3:]
    # first positions alone are changed, then what is left is taken from all rigid coordinates, so
    # that the first and second time derivatives of the constraints are zero (v, a: in place)
    for changed in (positions, np.ones_like(positions)):
        _correct(v[frames], G, changed, constraints.rate(at.x, v, at.t)[0])
    for changed in (positions, np.ones_like(positions)):
        # second time derivative of the constraints: at zero accelerations, and by these
        curvature = constraints.curvature(at.x, v, at.t) + G @ a[frames]
        _correct(a[frames], G, changed, curvature)
    return v, a


def _correct(values: FloatArray, G: FloatArray, changed: BoolArray, error: FloatArray) -> None:
    """Changes the values (f,) at `changed` (f,) in place, as little as possible, such that
    G values, G (l, f), changes by -error (l,)."""
    if G.size and changed.any():
        values[changed] -= np.linalg.lstsq(G[:, changed], error, rcond=1e-10)[0]


def assembled(system: System, at: State) -> State:
    """The state with rigid coordinates changed least such that joints and drives hold, as far as
    rigid motion can: the start of an equilibrium, or a step of the drives."""
    frames, rows, x = system.layout.frames, system.layout.algebraic, at.x.copy()
    for _ in range(TRIES):
        now = replace(at, x=x)
        # constraints g (l,) and their Jacobian G (l, f) by rigid coordinates
        g, G = system.residual(now)[rows], system.jacobian(now)[rows][:, frames].toarray()
        change = np.linalg.lstsq(G, g, rcond=1e-10)[0] if len(g) and G.shape[1] else np.zeros(0)
        if float(np.abs(change).max(initial=0.0)) <= CLOSED:
            return now
        x = x.copy()
        x[frames] -= change * min(1.0, LONGEST / float(np.abs(change).max()))
    return at  # left to the solver


def body_axes(layout: Layout, at: State) -> tuple[Csr, Csr, Csr]:
    """T, T' and T'' (n, m) in a state: changes T z of all unknowns but the multipliers of
    quaternions, with the rates T' and T'' of T along the motion. z: translations and rotations of
    each body in its own axes, and all other unknowns as they are."""
    parts_of_each: list[list[Csr]] = [[], [], []]
    joints = set(joints_with_forces(layout))
    for b in layout:
        if b.kind.quantity is Quantity.POSE:
            for parts, M in zip(parts_of_each, _of_pose(b, *(
                    s[layout[b.name]] for s in (at.x, at.v, at.a))), strict=True):
                parts.append(csc_array(M))
        elif b.kind.order == 0 and b.owner not in joints:
            for parts in parts_of_each:
                parts.append(csc_array((b.size, 0)))
        else:
            unit = csc_array(eye_array(b.size, format="csc"))
            for i, parts in enumerate(parts_of_each):
                parts.append(unit if i == 0 else csc_array((b.size, b.size)))
    T, rate, second = (csc_array(block_diag(p, format="csc")) for p in parts_of_each)
    return T, rate, second


def _of_pose(b: Block, q: FloatArray, v: FloatArray, a: FloatArray) -> Iterator[FloatArray]:
    """T, T' and T'' (b, m) of one body's rigid coordinates q (b,) with rates v and a, by
    differences along the motion: T gives their changes by translations and rotations in body axes
    (`_at`)."""
    angular = v[2:] if b.size == PLANAR_POSE else v[3:]
    rate = float(np.abs(angular).max(initial=0.0))
    if rate == 0.0:
        yield _at(b, q)
        yield from (np.zeros_like(_at(b, q)) for _ in range(2))
        return
    h = STEP / rate

    def along(s: float) -> FloatArray:
        moved = q + s * v + 0.5 * s * s * a
        if b.size == FREE_POSE:  # a quaternion that turns at the rate |p'|
            size, p = float(np.linalg.norm(v[3:])), q[3:]
            moved[3:] = np.cos(size * s) * p + np.sin(size * s) / size * v[3:]
        return _at(b, moved)

    ends = [along(k * h) for k in (-2, -1, 0, 1, 2)]  # central differences of fourth order
    yield ends[2]
    yield (8.0 * (ends[3] - ends[1]) - (ends[4] - ends[0])) / (12.0 * h)
    yield (16.0 * (ends[3] + ends[1]) - (ends[4] + ends[0]) - 30.0 * ends[2]) / (12.0 * h * h)


def _at(b: Block, q: FloatArray) -> FloatArray:
    """Changes (b, m) of rigid coordinates q (b,) by m translations and rotations in body axes; of a
    free body in space b is 7, with 4 coordinates of a quaternion, and m is 6."""
    d = 2 if b.size == PLANAR_POSE else 3
    turn = b.size - d if b.size != FREE_POSE else 3
    T = np.zeros((b.size, d + turn))
    T[:d, :d] = np.stack([vectors_in_space(q[None], e)[0] for e in np.eye(d)], axis=1)
    if b.size != FREE_POSE:
        T[d:, d:] = np.eye(turn)
        return T
    p0, x, y, z = q[3:]
    # p' = p o (0, w) / 2 for a rotation w in body axes
    T[3:, 3:] = 0.5 * np.array([[-x, -y, -z], [p0, -z, y], [z, p0, -x], [-y, x, p0]])
    return T


def carried_jacobian(system: System, at: State) -> tuple[Csr, FloatArray]:
    """Jacobian (n, n) of the residual of a steady rotation, whose rates change with the positions:
    a rotor off its axis has a centrifugal force there. K + (D T' + M T'') T^+. Also the rounding
    (n,) of its inertia forces, by that of the differences which give the accelerations."""
    T, rate, second = body_axes(system.layout, at)
    t = system.tangents(at)
    # the columns of T are orthogonal: T^+ = (T^T T)^-1 T^T has a diagonal to invert
    inverse = diags_array(1.0 / np.asarray(T.multiply(T).sum(axis=0)).ravel()) @ T.T
    return (csc_array(t.K + (t.D @ rate + t.M @ second) @ inverse),
            ROUNDING * (abs(t.D) @ np.full_like(at.v, np.abs(at.v).max())
                        + abs(t.M) @ np.full_like(at.a, np.abs(at.a).max())))


def in_body_axes(t: Tangents, axes: tuple[Csr, Csr, Csr]) -> Tangents:
    """Tangents in the unknowns z of `body_axes`, x = T z with T, T' and T'' along the motion:

        T^T (K T + D T' + M T''),    T^T (D T + 2 M T'),    T^T M T
    """
    T, rate, second = axes
    left = csc_array(T.T)
    return Tangents(csc_array(left @ (t.K @ T + t.D @ rate + t.M @ second)),
                    csc_array(left @ (t.D @ T + 2.0 * (t.M @ rate))),
                    csc_array(left @ (t.M @ T)))


def kept_rows(layout: Layout) -> tuple[IntArray, IntArray]:
    """Numbers among z, the changes in axes of the bodies (`body_axes`), of displacements with rigid
    changes, and of the multipliers of joints. z has 6 changes for the 7 rigid coordinates of a free
    body in space, and no multipliers of quaternions."""
    held, start = set(joints_with_forces(layout)), 0
    second, algebraic = list[IntArray](), list[IntArray]()
    for b in layout:
        size = b.size - (b.kind.quantity is Quantity.POSE and b.size == FREE_POSE)
        if b.kind.order == 0:
            size = b.size if b.owner in held else 0
        numbers = np.arange(start, start + size)
        if b.kind.order != 1:
            (second if b.kind.order == 2 else algebraic).append(numbers)
        start += size
    none = np.zeros(0, np.int64)
    return np.concatenate([none, *second]), np.concatenate([none, *algebraic])
