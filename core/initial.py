"""Consistent rates at the start: the equations of motion and the second derivative of the
constraints hold at t = 0 (second-order integrators lose their order without this)."""

import numpy as np
from scipy.sparse import block_array

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.eliminated import solve_by_blocks
from sparsemor.core.equations import jacobian, residual
from sparsemor.core.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import State
from sparsemor.core.status import SolveFailed, Status

LOST = 1.0
"""Share of the stiffness below which a mass is lost in the difference of two Jacobians: with
c = 1 it is known to four digits only beside elastic bodies, and accelerations to one or two."""


def consistent_state(model: Model) -> State:
    """The start with accelerations, temperature rates and multipliers that satisfy the equations.

    Unknown are a (second-order), v (first-order) and the multipliers; all enter linearly. Found
    once a model, whose other users get the same arrays, which cannot be written to. Raises
    SolveFailed (singular) when they are not determined.
    """
    if not model.starts:
        model.starts.append(_solved(model, 0.0))
    return model.starts[0]


def _solved(model: Model, t: float) -> State:
    layout, n = model.layout, model.layout.size
    x, v, a = model.x0.copy(), model.v0.copy(), np.zeros(n)
    algebraic, first, second = layout.algebraic, layout.first, layout.second
    K = jacobian(layout, model.terms, x, v, a, t, np.zeros(n), np.zeros(n))
    M, C = (_derivative(model, K, State(t, x, v, a, x), rate)[part][:, part]
            for rate, part in ((2, second), (1, first)))
    held, across = K[:, algebraic], K[algebraic][:, second]
    del K  # beside A: as large as all operators of the model
    A = block_array([
        [M, None, held[second]], [None, C, held[first]], [across, None, held[algebraic]]],
        format="csr")
    r = residual(layout, model.terms, x, v, a, t)
    r[algebraic] = _curvature(model, x, v, t)
    if not (np.isfinite(r).all() and np.isfinite(A.data).all()):
        broken = [b.name for b in layout if not np.isfinite(r[layout[b.name]]).all()]
        raise SolveFailed(Status.NOT_FINITE, t, broken[0] if broken else "",
                          "forces or heat at the start")
    try:
        z = -solve_by_blocks(model, A, r)
    except RuntimeError:
        raise SolveFailed(Status.SINGULAR, t, "", "accelerations at the start") from None
    a[second], v[first], x[algebraic] = z[second], z[first], x[algebraic] + z[algebraic]
    for series in (x, v, a):
        series.flags.writeable = False
    return State(t, x, v, a, np.zeros((n, 0)))


def _derivative(model: Model, K: Csr, s: State, rate: int) -> Csr:
    """(n, n) derivative of the residual by v (rate 1) or a (rate 2), from Jacobians: they are
    affine in c1 and c2, which are taken so large that mass is not lost beside stiffness."""
    layout, c = model.layout, 1.0
    factors = np.zeros((3, layout.size))
    for _ in range(8):
        factors[rate] = c
        D = jacobian(layout, model.terms, s.x, s.v, s.a, s.t, factors[1], factors[2]) - K
        if abs(D).max() >= LOST * abs(K).max():
            break
        c *= 1e4
    return D / c


def start_notes(model: Model, t: float = 0.0) -> tuple[Note, ...]:
    """A sentence for each joint whose constraint the velocities at the start break."""
    layout, eps = model.layout, 1e-7
    moved = model.x0.copy()
    moved[layout.second] += eps * model.v0[layout.second]
    zero = np.zeros(layout.size)
    g0, g1 = (residual(layout, model.terms, x, model.v0, zero, s)
              for x, s in ((model.x0, t), (moved, t + eps)))
    speed = max(float(np.abs(model.v0[layout.second]).max(initial=0.0)), 1e-3)
    notes = []
    for b in layout:
        if b.field == "multiplier":
            rate = float(np.abs((g1 - g0)[layout[b.name]]).max()) / eps
            if rate > 1e-4 * speed + 1e-6:
                notes.append(Note(
                    f"the velocities at the start break joint {b.owner} by {rate:.3g} m/s or "
                    "rad/s: the first steps jump, and a second-order integrator loses its order; "
                    "give the bodies fitting velocities, or let the motion begin smoothly",
                    "start"))
    return tuple(notes)


def _curvature(model: Model, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
    """g'' with zero accelerations: second directional derivative of the constraints along v."""
    layout, zero = model.layout, np.zeros(len(x))
    speed = float(np.abs(v[layout.second]).max(initial=0.0))
    eps = 1e-4 / max(speed, 1.0)  # s; g is smooth on this scale

    def g(s: float) -> FloatArray:
        y = x.copy()
        y[layout.second] += s * v[layout.second]
        return residual(layout, model.terms, y, v, zero, t + s)[layout.algebraic]

    # one-sided: a prescribed motion may have a kink at the start
    return (2 * g(0.0) - 5 * g(eps) + 4 * g(2 * eps) - g(3 * eps)) / eps**2
