"""Linear buckling: factors lambda of loads at which the stiffness of a structure is singular,

    (K + lambda K_g) phi + G^T mu = 0,    G phi = 0.

K is the tangent about the equilibrium without the scaled loads, K_g its derivative along the linear
solution under them: by a central difference of the model's own tangents (joint forces, nonlinear
strains), with the geometric stiffness of the stress of bodies with linear strains, and the tangents
of the loads themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from sparsemor.core import Csr, FloatArray, InputError, Model, Note, State
from sparsemor.core.model.assembly import assemble
from sparsemor.core.registry.registry import suggestions
from sparsemor.plugins.analyses.analysed_equations import System, Tangents
from sparsemor.plugins.analyses.analysed_model import Prepared, equilibrium, time_of
from sparsemor.plugins.analyses.equilibrium import Solver, free_motions, neutral
from sparsemor.plugins.analyses.modes import DENSE, Constrained
from sparsemor.plugins.analyses.steady_motion import body_axes, kept_rows

CHANGE = 1e-4
"""Largest motion, relative to large ones, over which tangents are differentiated."""
LIKE = 1e-6
"""Relative asymmetry of tangents that is rounding."""
NONE = 1e-10
"""1 / lambda relative to the largest one below which nothing buckles."""


@dataclass(frozen=True, slots=True, eq=False)
class Buckled:
    """Factors (k,), increasing, above 0, and shapes: changes (N, k) of the model's unknowns."""

    state: State
    factors: FloatArray
    changes: FloatArray
    notes: tuple[Note, ...]


def buckling(
    p: Prepared, *, at: float | None = None, count: int = 3, scaled: Sequence[str] | None = None
) -> Buckled:
    """The lowest factors of the loads `scaled` (default: all, with the change of temperature of a
    stored initial state) at a time, s. Raises InputError for a structure that moves freely."""
    t, names = time_of(p.scene, at), list(p.scene.loads if scaled is None else scaled)
    for name in names:
        if name not in p.scene.loads:
            raise InputError(f"no load is called {name!r}: "
                             f"{suggestions(name, p.scene.loads, 'loads')}", "scaled")
    if not names and p.scene.initial is None:
        raise InputError("the scene has no loads that could buckle it", "loads")
    without = {f"loads.{n}": None for n in names}
    if scaled is None and p.scene.initial is not None:
        without["initial"] = None
    scene = p.scene.using(without, label="scaled")
    system = System.from_model(assemble(scene, body_cache=p.bodies), p.system.bases)
    start = system.start(t)
    free = free_motions(system, start)
    if free.shape[1] and neutral(system, start, free).shape[1]:
        raise InputError("the structure moves freely: buckling needs one that joints and "
                         "springs hold",
                         "joints")
    s = equilibrium(replace(p, scene=scene, system=system), t, False).state
    for body in system.model.separated.moving:
        ops = body.operators
        if ops is not None and ops.stress_stiffness is None:
            raise InputError("the geometric stiffness of this body is not known: its matrices, or "
                             "its section, are all that there is", f"bodies.{body.name}")
    return _about(p, system, s, count)


def _about(p: Prepared, system: System, s: State, count: int) -> Buckled:
    """Buckling factors lambda and shapes phi about the state s of `system`, the equations without
    the scaled loads (those of p contain them),

        (K + K_s + lambda K_g) phi = 0,    on the constraints

    K: tangent, K_s: stiffness by the stress of s; K_g: their change along the linear step to full
    load, by central differences of K, with that of the tangent by the loads themselves. T: of
    `body_axes`, its changes `second` of displacements and `held` of multipliers; motion: of a
    change of the model's unknowns, which `direction` makes of the system's, the size relative to
    large motions. Raises InputError where these are not symmetric.
    """
    step, K = _linear(p, system, s), system.jacobian(s)
    scale = CHANGE / max(system.motion(system.direction(step)), 1e-300)
    ahead, behind = (system.jacobian(replace(s, x=s.x + k * step)) for k in (scale, -scale))
    tangent_change = (ahead - behind) / (2.0 * scale) + p.system.jacobian(s) - K
    K_s, K_s_loaded = (_stress_stiffness(p.model, system, x, s.t) for x in (s.x, s.x + step))
    T, (second, held) = body_axes(system.layout, s)[0], kept_rows(system.layout)
    left = csc_array(T.T)
    z = csc_array(left @ (K + K_s) @ T)
    c = Constrained.from_tangents(Tangents(z, 0.0 * z, 0.0 * z), second, held)
    K_g = csc_array(left @ (tangent_change + K_s_loaded - K_s) @ T)[second][:, second]
    for X in (c.K, K_g):
        if abs(X - X.T).max() > LIKE * abs(X).max():
            raise InputError("a load or term has tangents that are not symmetric, as one that "
                             "turns with the body: it has no buckling factor", "loads")
    factors, shapes = _factors(c, csc_array(0.5 * (K_g + K_g.T)), count)
    changes = np.zeros((T.shape[1], len(factors)))
    changes[second] = shapes
    notes = () if len(factors) else (Note(
        "these loads do not buckle the structure: no factor above 0", "no_buckling"),)
    return Buckled(system.state(s), factors, system.direction(np.asarray(T @ changes)), notes)


def _linear(p: Prepared, system: System, s: State) -> FloatArray:
    """Linear change (n,) of the unknowns by the scaled loads, dx = -K^-1 r with the residual r of
    the whole scene (p), and of temperatures by that of the stored initial state."""
    at, step = system.mechanical, np.zeros(system.layout.size)
    first = system.thermal
    step[first] = p.system.start(s.t).x[first] - s.x[first]
    r = p.system.residual(replace(s, x=s.x + step))[at]
    step[at] = -Solver(system.jacobian(s)[at][:, at], s.t, "stiffness")(r)
    if not step.any():
        raise InputError("the scaled loads are zero at this time", "at")
    return step


def _stress_stiffness(model: Model, system: System, x: FloatArray, t: float) -> Csr:
    """Geometric stiffness (n, n), N/m, that the terms of bodies with linear strains leave out, of
    the stress at unknowns x (n,) of the system and at t, s."""
    n, full, shapes = system.layout.size, system.full(x), model.shapes()
    found = csr_array((n, n))
    for body in system.model.separated.moving:
        ops, shape = body.operators, shapes.get(body.name)
        if ops is None or ops.stress_stiffness is None or ops.stress_stiffness.nonlinear or (
                shape is None or shape.elastic_dofs is None):
            continue
        u, T = np.zeros(shape.points.shape), None
        u.ravel()[shape.elastic_dofs] = full[model.layout[body.elastic]]
        if shape.thermal_nodes is not None:
            T = shape.given_shapes @ shape.given_at(np.array([t]))[0]
            T[shape.thermal_nodes] = full[model.layout[body.thermal]]
        K_s, rows = ops.stress_stiffness.matrices(u, T)[1], system.layout.numbers(body.elastic)
        if body.elastic in system.bases:
            atoms = system.bases[body.elastic].atoms
            K_s = csr_array(atoms.T @ (K_s @ atoms))
        put = csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(n, len(rows)))
        found = found + put @ K_s @ put.T
    return csc_array(found)


def _factors(c: Constrained, K_g: Csr, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest positive lambda (k,) and shapes (n, k), by the largest nu = 1 / lambda of -K_g phi =
    nu K phi. c: stiffness K and constraints; K_g: geometric stiffness (n, n)."""
    n = c.size
    inverse, K = c.inverse(c.K), csc_array(0.5 * (c.K + c.K.T))
    if n <= DENSE or 3 * count >= n:
        S = inverse(np.eye(n))
        weights, vectors = linalg.eigh(0.5 * (S + S.T))
        root = vectors * np.sqrt(np.maximum(weights, 0.0))  # S = root root^T
        nu, inner = linalg.eigh(root.T @ -(K_g @ root))
        shapes = root @ inner
    else:
        start = inverse(np.random.default_rng([n, count]).standard_normal(n))
        try:
            nu, shapes = eigsh(
                -K_g, count, M=K, which="LA", v0=start, tol=0.0,
                Minv=LinearOperator((n, n), lambda b: inverse(np.ravel(b)), dtype=np.float64))
        except ArpackNoConvergence as error:
            raise InputError(f"{len(error.eigenvalues)} of {count} factors converged: ask for "
                             "fewer", "count") from None
    most = float(np.abs(nu).max(initial=0.0))
    order = [int(i) for i in np.argsort(-nu) if nu[i] > NONE * most][:count]
    return 1.0 / nu[order], shapes[:, order]
