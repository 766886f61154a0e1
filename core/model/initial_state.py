"""Consistent initial accelerations, temperature rates and multipliers: the equations of motion and
the second time derivative of the constraints hold at t = 0. Without them, second-order integrators
lose an order.

The linear system of the whole model is solved by Schur complement: large symmetric positive
definite blocks are eliminated first. Where it is singular, groups of joints are sought whose
constraints depend linearly on each other.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, csc_array, csr_array, hstack
from scipy.sparse.linalg import splu

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.constraint_rates import Constraints
from sparsemor.core.model.equations import system_jacobian, system_residual
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.core.model.model import Model
from sparsemor.core.model.redundancy import dependent_joints, in_words
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.integrator import Integrator, State
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.reducer import AssembledModel
from sparsemor.core.status import SolveFailed, Status

FEW = 3000
"""Number of unknowns up to which a block is not eliminated separately."""
BORDER = 300
"""Largest number of columns that couple a block to other unknowns for which elimination pays: each
costs one solve and n numbers."""


def solve_by_blocks(model: AssembledModel, A: Csr, r: FloatArray) -> FloatArray:
    """Solution A^-1 r of a system of the whole model, A (n, n) csr.

    Large blocks e of A (mass or capacity matrices) are eliminated by the linear solvers that the
    user chose. The Schur complement of the remaining unknowns b (rigid coordinates, multipliers,
    small or strongly coupled blocks) is solved as one sparse system:

        (A_bb - sum_e A_be A_ee^-1 A_eb) z_b = r_b - sum_e A_be A_ee^-1 r_e
        z_e = A_ee^-1 (r_e - A_eb z_b)

    Raises RuntimeError if it is singular.
    """
    n = A.shape[0]
    border = np.ones(n, dtype=np.bool_)  # unknowns that are not eliminated
    # of each eliminated block: its unknowns, A_eb and its columns, A_be and its rows
    parts = []
    for name in model.reducible():
        at = model.layout[name]
        if at.stop - at.start <= FEW:
            continue
        own = np.arange(at.start, at.stop)
        right = csc_array(A[at])
        coupled = np.setdiff1d(np.flatnonzero(np.diff(right.indptr)), own)
        below = csc_array(A[:, at]).tocsr()
        coupled_rows = np.setdiff1d(np.flatnonzero(np.diff(below.indptr)), own)
        # two eliminated blocks must not be coupled: A_ee would not be block diagonal
        if len(coupled) > BORDER or not border[coupled].all() or not border[coupled_rows].all():
            continue
        border[own] = False
        parts.append((name, own, coupled, right[:, coupled].toarray(), below[coupled_rows],
                      coupled_rows))
    rest = np.flatnonzero(border)
    position = np.full(n, -1)
    position[rest] = np.arange(len(rest))
    S, b, answers = A[rest][:, rest].tolil(), r[rest].copy(), []
    for name, own, coupled, right, below, coupled_rows in parts:
        factor = model.factorize(name, A[own][:, own].tocsr(), "start")
        x = solve_or_fail(factor, np.column_stack([r[own], right]), name)  # A_ee^-1 [r_e, A_eb]
        answers.append(x)
        changed = below @ x
        b[position[coupled_rows]] -= changed[:, 0]
        _subtract(S, position[coupled_rows], position[coupled], changed[:, 1:])
    z = np.zeros(n)
    z[rest] = _scaled(S.tocsc(), b)
    for (_, own, coupled, *_), x in zip(parts, answers, strict=True):
        z[own] = x[:, 0] - x[:, 1:] @ z[coupled]
    return z


def _subtract(S: Csr, rows: IntArray, columns: IntArray, values: FloatArray) -> None:
    """Subtracts values (m, n) from S at these rows and columns."""
    if len(rows) and len(columns):
        S[np.ix_(rows, columns)] = S[np.ix_(rows, columns)].toarray() - values


def _scaled(A: Csr, r: FloatArray) -> FloatArray:
    """Solution of A x = r by sparse LU after symmetric scaling, because rows and columns have very
    different units (forces, heat, lengths)."""
    if not len(r):
        return r
    size = np.sqrt(np.maximum(abs(A).max(axis=0).toarray().ravel(), 1e-300))
    S = A.copy()
    S.data = S.data / (size[S.indices] * np.repeat(size, np.diff(S.indptr)))
    return np.asarray(splu(S).solve(r / size) / size)


LOST = 1.0
"""Largest ratio of stiffness to mass of a row at which the mass is computed accurately as a
difference of two Jacobians; with the factor c = 1, elastic bodies retain only four digits of it."""
START = "start"
"""Identifier of warnings about the velocities at the start."""
BROKEN, NEXT_TO = 1e-4, 1e-6
"""Tolerances for the rate of a violated constraint, relative to the velocities at its own joint
(BROKEN) and at all joints (NEXT_TO)."""
OPEN = 1e-5
"""Tolerance for the value of a constraint, relative to the largest terms of all constraints."""


def consistent_state(model: AssembledModel) -> State:
    """Consistent initial state: accelerations, temperature rates and multipliers that satisfy the
    equations at t = 0.

    The unknowns are a of second-order, v of first-order fields, and the multipliers; all enter
    linearly. Solved once per model; the arrays are read-only. Raises SolveFailed if the system is
    singular, with the names of redundant joints.
    """
    if not model.starts:
        model.starts.append(_solved(model, 0.0))
    return model.starts[0]


def euler_state(model: AssembledModel, h: float) -> State:
    """Initial state with the accelerations of one linearly implicit Euler step of h (s),

        (M + h D + h^2 K) a = -r(x + h v, v, 0),

    with the second derivative of the constraints as in `consistent_state`. Motion that the step
    resolves has the consistent accelerations, but for O(h); vibrations that it does not resolve
    have next to none (Hairer and Wanner 1996, doi 10.1007/978-3-642-05221-7, Sec. IV.7).
    """
    return _solved(model, 0.0, h)


BENT, AGAIN = 1e-9, 20
"""Share of forces that are not linear in the multipliers, such as friction of joint forces, up to
which they count as linear, and largest number of Newton iterations with them."""


def _solved(model: AssembledModel, t: float, h: float = 0.0) -> State:
    """State at t (s) with consistent accelerations (h = 0), or with those of an implicit Euler step
    of h (s). Where forces are not linear in the multipliers, such as friction of joint forces, the
    linear solution is repeated from the multipliers of the last one (Newton's method), at most
    AGAIN times, until they change by less than BENT of their largest."""
    state, is_nonlinear = _linear(model, t, h, model.x0)
    for _ in range(AGAIN if is_nonlinear else 0):
        before = state.x[model.layout.algebraic]
        state, _ = _linear(model, t, h, state.x)
        change = np.abs(state.x[model.layout.algebraic] - before).max(initial=0.0)
        if change <= BENT * np.abs(before).max(initial=0.0):
            break
    return state


def _linear(model: AssembledModel, t: float, h: float, at: FloatArray) -> tuple[State, bool]:
    """The state by equations that are linearised at the multipliers of `at` (n,), and True where
    they are not linear from there to those of the state. With the residual r of x, v and a = 0,

        [ M  0  F ]  [ a       ]       [ r of second-order rows      ]
        [ 0  C  H ]  [ T'      ]   = - [ r of first-order rows       ]
        [ G  0  S ]  [ dlambda ]       [ g'' with zero accelerations ]

    M: mass (h = 0), or h^2 (M / h^2 + D / h + K) (`euler_state`); C: capacity; F, H, S: derivatives
    of r by the multipliers; G: derivative of the constraints g by second-order unknowns.
    """
    layout, n = model.layout, model.layout.size
    x, v, a = at.copy(), model.v0.copy(), np.zeros(n)
    algebraic, first, second = layout.algebraic, layout.first, layout.second
    K = system_jacobian(layout, model.terms, x, v, a, t, np.zeros(n), np.zeros(n))
    M, C = (_derivative(model, K, State(t, x, v, a, x), rate)[part][:, part]
            for rate, part in ((2, second), (1, first)))
    by_multipliers, constraint_rows = K[:, algebraic], K[algebraic][:, second]
    ahead = x.copy()
    if h > 0.0:  # dv = dx / h, da = dx / h^2: the Jacobian is M / h^2 + D / h + K
        one = np.ones(n)
        M = h * h * csr_array(system_jacobian(
            layout, model.terms, x, v, a, t, one / h, one / (h * h)))[second][:, second]
        ahead[second] += h * v[second]
    del K  # next to A: as large as all operators of the model
    A = block_array([
        [M, None, by_multipliers[second]],
        [None, C, by_multipliers[first]],
        [constraint_rows, None, by_multipliers[algebraic]]], format="csr")
    r = system_residual(layout, model.terms, ahead, v, a, t)
    forces = r[second].copy()
    r[algebraic] = _constraints(model).curvature(x, v, t)
    _check_finite(layout, r, t, "forces or heat at the start")
    if not np.isfinite(A.data).all():
        raise SolveFailed(Status.NOT_FINITE, t, "", "forces or heat at the start")
    try:
        z = -solve_by_blocks(model, A, r)
    except RuntimeError:
        redundant = in_words(dependent_joints(
            layout, hstack([constraint_rows, by_multipliers[algebraic]]).tocsr()))
        what = "accelerations at the start" + (f": {redundant}" if redundant else "")
        raise SolveFailed(Status.SINGULAR, t, "", what) from None
    _check_finite(layout, z, t, "accelerations and joint forces at the start")
    x[algebraic] += z[algebraic]
    ahead[algebraic] = x[algebraic]
    by_joints = by_multipliers[second] @ z[algebraic]
    # forces with the new multipliers, beyond those that are linear in them
    whole = system_residual(layout, model.terms, ahead, v, a, t)[second]
    beyond_linear = whole - forces - by_joints
    a[second], v[first] = z[second], z[first]
    for array in (x, v, a):
        array.flags.writeable = False
    largest_force = np.abs(by_joints).max(initial=0.0) + np.abs(forces).max(initial=0.0)
    return State(t, x, v, a, np.zeros((n, 0))), bool(
        np.abs(beyond_linear).max(initial=0.0) > BENT * largest_force)


def _check_finite(layout: Layout, values: FloatArray, t: float, what: str) -> None:
    """Raises SolveFailed for values (n,) that are not finite, with the name of the first such
    block."""
    broken = [b.name for b in layout if not np.isfinite(values[layout[b.name]]).all()]
    if broken:
        raise SolveFailed(Status.NOT_FINITE, t, broken[0], what)


def _derivative(model: AssembledModel, K: Csr, s: State, rate: int) -> Csr:
    """Derivative (n, n) of the residual by v (rate 1) or a (rate 2), as a difference of Jacobians:

        (J(c) - K) / c,    J(c): Jacobian with dv = c dx or da = c dx,    K = J(0)

    s: state at which they are evaluated. J is affine in c, which is increased until the mass is not
    lost to round-off against the stiffness in any row with a mass (ratio of both up to LOST).
    """
    layout, part = model.layout, model.layout.second if rate == 2 else model.layout.first
    factors, c, difference = np.zeros((3, layout.size)), 1.0, K
    if part.start == part.stop:
        return 0.0 * K
    stiff = _largest(K, part)
    for _ in range(8):
        factors[rate] = c
        difference = system_jacobian(
            layout, model.terms, s.x, s.v, s.a, s.t, c1=factors[1], c2=factors[2]) - K
        mass = _largest(difference, part)
        has_mass = mass > 0
        lost = float((stiff[has_mass] / mass[has_mass]).max(initial=0.0))
        if lost <= LOST:
            break
        c *= max(1e4, min(lost, 1e16))
    return difference / c


def _largest(A: Csr, part: slice) -> FloatArray:
    """Largest absolute value in each row of the diagonal block A[part, part]."""
    return np.asarray(abs(csr_array(A[part][:, part])).max(axis=1).toarray()).ravel()


def start_notes(model: AssembledModel, t: float = 0.0) -> tuple[Note, ...]:
    """Warnings for the joints whose constraints are violated by the initial velocities."""
    rows = model.layout.algebraic
    if rows.start == rows.stop:
        return ()
    return broken_rates(model.layout, *_constraints(model).rate(model.x0, model.v0, t))


def open_joints(model: AssembledModel, t: float = 0.0) -> dict[str, float]:
    """Joints that the initial positions do not satisfy, and by how much (m, rad or a cosine): by
    more than OPEN times the largest term of all constraints."""
    rows, found = model.layout.algebraic, {}
    if rows.start == rows.stop:
        return {}
    values, sizes = _constraints(model).values(model.x0, t)  # sizes: magnitudes of their terms
    limit = OPEN * float(sizes.max(initial=0.0))
    for b in model.layout:
        if b.kind.order == 0:
            at = slice(model.layout[b.name].start - rows.start,
                       model.layout[b.name].stop - rows.start)
            gap = float(np.abs(values[at]).max(initial=0.0))
            if gap > limit:
                found[b.owner] = gap
    return found


def broken_rates(layout: Layout, rates: FloatArray, sizes: FloatArray) -> tuple[Note, ...]:
    """Warnings for the joints whose constraints have rates (l,) of notable size; sizes (l,):
    magnitudes of their terms. BROKEN, NEXT_TO: tolerances relative to those of the joint and of all
    joints."""
    rows, most, notes = layout.algebraic, float(sizes.max(initial=0.0)), []
    for b in layout:
        if b.kind.order == 0:
            at = slice(layout[b.name].start - rows.start, layout[b.name].stop - rows.start)
            rate = float(np.abs(rates[at]).max())
            if rate > BROKEN * float(sizes[at].max()) + NEXT_TO * most:
                notes.append(Note(
                    f"the velocities at the start break joint {b.owner} by {rate:.3g} m/s or "
                    "rad/s: the first steps jump, and a second-order integrator loses its order; "
                    "give the bodies fitting velocities, or let the motion begin smoothly",
                    START))
    return tuple(notes)


def _constraints(model: AssembledModel) -> Constraints:
    """Constraint equations of all joints, with their time derivatives."""
    return Constraints.from_terms(model.layout, model.terms, model.separated.step)


# ------------------------------------------------------------------ start of the first step

FAR = 0.1
"""Displacement by constant acceleration over one step, relative to the diagonal of the body, from
which the step does not resolve the acceleration."""


class ResolvedStart(NamedTuple):
    """Initial state, and the largest acceleration that was set to zero, m/s2 or rad/s2 (0: none).
    shaken: body with vibrations that the step does not resolve, whose accelerations are those of an
    implicit Euler step ("": none), and `far`, the displacement that they would have made, m."""

    state: State
    dropped: float
    shaken: str = ""
    far: float = 0.0

    def notes(self, h: float) -> tuple[Note, ...]:
        """Note on accelerations that a step of h (s) does not resolve; none where there are none.
        """
        if self.shaken:
            return (information(
                f"the vibrations of {self.shaken} at the start are much faster than the step of "
                f"{h:g} s: their accelerations over one step would displace it by {self.far:.2g} "
                "m; the first step begins with those of an implicit Euler step, which damps them. "
                "To resolve them take smaller steps; to avoid them let loads begin from zero (a "
                "ramp) and initial temperatures fit the reference temperature", "start"),)
        return () if self.dropped == 0.0 else (information(
            f"the accelerations at the start, up to {self.dropped:.3g} m/s2 or rad/s2, last only "
            f"until a contact is compressed, much less than the step of {h:g} s: the first step "
            "begins without them. To resolve that motion take smaller steps, or let the load begin "
            "from zero (a ramp)", "start"),)


def resolved_start(model: Model, integrator: Integrator, h: float) -> ResolvedStart:
    """The consistent initial state, with zero accelerations where x + h v + h^2 a / 2 takes a
    surface through another one and x + h v does not, here or in the rigid-body pre-simulation.

    A load that presses touching surfaces together gives them the acceleration of free flight, which
    lasts until the contact is compressed, a small part of a step of h (s). An integrator of order
    two would assume it for the whole step. Without it the first step has an error of O(h^2), so
    that the order is kept, and ends near the compressed contact.

    Elastic vibrations that the step does not resolve, such as those of a body that is hot at the
    start, are damped by stiffly stable integrators. Their accelerations, constant over a long step,
    are no motion: a multiple of the size of the body, with velocities at which the nonlinear terms
    of frames and joints blow up. Then the state has the accelerations of an implicit Euler step.
    """
    start = consistent_state(model)
    if integrator.order < 2:
        return ResolvedStart(start, dropped=0.0)
    still = replace(start, a=np.zeros_like(start.a))
    if model.stage is not None and model.stage.dropped:  # as the pre-simulation did that it follows
        return ResolvedStart(still, dropped=model.stage.dropped)
    if _passes(model, start, h) and not _passes(model, still, h):
        return ResolvedStart(still, float(np.abs(start.a[model.layout.second]).max()))
    shaken, far = _farthest(model, start, h)
    if shaken:
        return ResolvedStart(euler_state(model, h), dropped=0.0, shaken=shaken, far=far)
    return ResolvedStart(start, dropped=0.0)


def _farthest(model: Model, start: State, h: float) -> tuple[str, float]:
    """Body that h^2 a / 2 displaces by more than `FAR` of its size, the farthest, and that
    displacement, m; "", 0 if there is none."""
    found, name, most = 0.0, "", FAR  # most: largest displacement so far, over the size
    for b in model.layout:
        if b.kind.quantity is Quantity.DISPLACEMENT and b.name in model.geometry:
            points = model.geometry[b.name][0]
            size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
            far = 0.5 * h * h * float(np.abs(start.a[model.layout[b.name]]).max(initial=0.0))
            if far > most * size > 0.0:
                found, name, most = far, b.owner, far / size
    return name, found


def _passes(model: Model, start: State, h: float) -> bool:
    """True if a term rejects the state after h (s) at constant acceleration."""
    second = np.zeros(model.layout.size)
    second[model.layout.second] = 1.0  # only second-order unknowns move
    x = start.x + second * (h * start.v + 0.5 * h * h * start.a)
    v = start.v + h * start.a
    return any(term.check_step(x[term.columns], v[term.columns], start.t + h, h)
               for term in model.terms if term.rejects)
