"""Eigenfrequencies and modes of a mechanism about a state (`modes.py`)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import lsqr

from sparsemor.core import Csr, FloatArray, InputError, IntArray, Note, State
from sparsemor.core.notes import information
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.protocols.poses import FREE_POSE, PLANAR_POSE
from sparsemor.plugins.analyses.analysed_equations import Tangents
from sparsemor.plugins.analyses.analysed_model import (
    Prepared,
    equilibrium,
    rates,
    steady_heat,
    time_of,
)
from sparsemor.plugins.analyses.modes import ComplexArray, ComplexModes, Constrained, modes_of
from sparsemor.plugins.analyses.steady_motion import body_axes, in_body_axes, kept_rows

LATER, VARIES = 0.37, 1e-6
"""Rotation, rad, after which the equations of a steady rotation are compared with those before, and
the relative difference up to which they are constant."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearisedSystem:
    """Equations about a state in the axes of its bodies. z: tangents of all unknowns there; axes:
    T, T' and T'' (n, m), changes of the system's unknowns by z; second, held: numbers among z of
    unknowns with inertia and of multipliers."""

    state: State
    z: Tangents
    axes: tuple[Csr, Csr, Csr]
    second: IntArray
    held: IntArray


def linearised(p: Prepared, at: float | None, spin: bool, about: str) -> LinearisedSystem:
    """Equations about the equilibrium under the loads at a time, or about the initial state (about:
    `equilibrium` or `start`). at: s, by default the end of the scene; spin: with the rates of
    steady rotation. Raises InputError for a rotation that is not steady."""
    t = time_of(p.scene, at)
    moving = rates(p, spin)
    if about not in ("equilibrium", "start"):
        raise InputError(f"must be equilibrium or start (got {about!r})", "about")
    if about == "equilibrium":
        state = (equilibrium(p, t, spin) if len(p.system.mechanical) else
                 steady_heat(p, at=t)).state
    else:
        state = _with_joint_forces(p, moving(p.system.start(t)))
    return about_state(p, state)


def _with_joint_forces(p: Prepared, s: State) -> State:
    """The state with the multipliers that balance it best: G^T dlambda = -r by least squares, r:
    residual of the second-order unknowns. Other unknowns stay, and all if there is no joint."""
    rows = p.system.layout.algebraic
    if rows.start == rows.stop:
        return s
    second = p.system.layout.second
    forces_of_joints = p.system.jacobian(s)[second][:, rows]  # G^T
    r = p.system.residual(s)[second]
    x = s.x.copy()
    x[rows] -= lsqr(forces_of_joints, r, atol=1e-14, btol=1e-14)[0]
    return replace(s, x=x)


def about_state(p: Prepared, state: State) -> LinearisedSystem:
    """Equations about a state in the axes of its bodies. Raises InputError where those of a moving
    state differ from those after a steady rotation by `LATER`."""
    layout = p.system.layout
    axes = body_axes(layout, state)
    z = in_body_axes(p.system.tangents(state), axes)
    second, held = kept_rows(layout)
    rate = float(np.abs(state.v[layout.frames]).max(initial=0.0))
    if rate > 0.0:
        dt = LATER / rate
        x = _later(p, state, dt)
        other = rates(p, True)(replace(state, t=state.t + dt, x=x))
        after = in_body_axes(p.system.tangents(other), body_axes(layout, other))
        most = abs(z.M).max()
        # K and D are compared with M times the square and the first power of the angular rate
        for i, (one, two) in enumerate(((z.M, after.M), (z.D, after.D), (z.K, after.K))):
            one, two = (X[second][:, second] for X in (one, two))
            if abs(one - two).max() > VARIES * max(abs(one).max(), rate**i * most):
                raise InputError("the equations vary as the bodies rotate, so that there are no "
                                 "modes: turn all coupled bodies at one constant rate, about the "
                                 "axis of what stands still, or leave out spin", "spin")
    return LinearisedSystem(state, z, axes, second, held)


def _later(p: Prepared, s: State, dt: float) -> FloatArray:
    """Unknowns of the steady motion after dt, s: rigid coordinates by its exact rotation."""
    x, layout = s.x.copy(), p.system.layout
    for b in layout:
        if b.kind.quantity is not Quantity.POSE:
            continue
        at = layout[b.name]
        q, v, a = s.x[at], s.v[at], s.a[at]
        d = 2 if b.size == PLANAR_POSE else 3
        if b.size == FREE_POSE:  # a unit quaternion turns at half the rate of the body
            w = float(np.linalg.norm(v[3:]))
            if w > 0.0:
                x[at][3:] = np.cos(w * dt) * q[3:] + np.sin(w * dt) / w * v[3:]
            w *= 2.0
        else:
            w = float(abs(v[-1]))
            x[at][d:] = q[d:] + dt * v[d:]
        # R moves on a circle at the rate w: R' = v, R'' = a, or straight
        if w > 0.0:
            x[at][:d] = q[:d] + np.sin(w * dt) / w * v[:d] + (1 - np.cos(w * dt)) / w**2 * a[:d]
        else:
            x[at][:d] = q[:d] + dt * v[:d]
    return x


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Modes about a state: changes (N, k) of the model's unknowns."""

    state: State
    modes: ComplexModes
    changes: ComplexArray
    notes: tuple[Note, ...]


def frequencies(
    p: Prepared, *, at: float | None = None, count: int = 10, spin: bool = False,
    about: str = "equilibrium",
) -> Found:
    """The lowest `count` modes of a mechanism with constraints of its joints, damping and, with
    spin, gyroscopic forces; temperatures do not change. lin.z: tangents in axes of the bodies,
    where changes are T z (lin.axes), those `second` of displacements and `held` of multipliers;
    direction: changes of the model's unknowns."""
    if not len(p.system.mechanical):
        raise InputError("no body of this scene moves or deforms: nothing can vibrate", "bodies")
    lin = linearised(p, at, spin, about)
    modes = modes_of(Constrained.from_tangents(lin.z, lin.second, lin.held), count)
    T = lin.axes[0]
    z = np.zeros((T.shape[1], len(modes.values)), np.complex128)
    z[lin.second] = modes.shapes
    changes = np.asarray(p.system.direction(np.asarray(T @ z)), np.complex128)
    return Found(p.system.state(lin.state), modes, changes, tuple(_notes(modes)))


def _notes(modes: ComplexModes) -> list[Note]:
    """Notes on modes of rigid motion and on a state that is unstable."""
    found = []
    if modes.rigid.any():
        n = int(modes.rigid.sum())
        found.append(information(f"{n} of these modes {'is' if n == 1 else 'are'} rigid motion "
                                 "that nothing holds, at 0 Hz", "rigid_motion"))
    grows = (modes.values.real > 1e-6 * np.abs(modes.values)) & ~modes.rigid
    if grows.any():
        rate = float(modes.values.real[grows].max())
        found.append(Note(f"the state is unstable: a disturbance grows at {rate:.4g} 1/s",
                          "unstable"))
    return found
