"""Equilibrium r(x) = 0 of a system at rest, or in steady motion, by Newton's method.

Without free motions each step dx = -J^-1 r is damped by the natural monotonicity test (Deuflhard
2011, doi 10.1007/978-3-642-23899-4, Sec. 3.3): the simplified correction at the new point must be
smaller than dx. Where joints leave rigid motions free, J may be singular away from the equilibrium
and the equilibrium unstable. Then pseudo-transient continuation (Kelley and Keyes 1998, doi
10.1137/S0036142996304796),

    (J + sigma M) dx = -r,    sigma in proportion to |r|,

follows the gradient flow M dx/ds = -r down to a stable equilibrium; sigma tends to zero, and the
last steps are Newton's.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core import Csr, FloatArray, IntArray, SolveFailed, State, Status
from sparsemor.plugins.analyses.analysed_equations import System, stiffness_to_mass
from sparsemor.plugins.analyses.steady_motion import carried_jacobian

TOLERANCE = 1e-10
"""Largest last change of an unknown, relative to the largest one of its block and, of rigid
coordinates, to the size of the body."""
ROUNDING = 1e-14
"""Residual relative to the magnitudes of its terms that is rounding: in slender bodies it moves
more than TOLERANCE."""
PIVOTS = 0.01
"""Smallest size of a diagonal pivot relative to the largest of its column."""
STEPS, FLOW = 20, 400
"""Largest numbers of steps of Newton's method and of the continuation."""
SHORTEST, LEAST = 1e-2, 1e-3
"""Smallest damping factor, and smallest step of the loads."""
TURN = 0.2
"""Largest step of the continuation relative to large motions (`System.sizes`)."""
LOST = 1e3
"""Motion, relative to large motions, after which there is no equilibrium."""
FLOOR = 1e-12
"""Smallest sigma relative to the mean ratio of stiffness to mass."""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedState:
    """A state that satisfies the equations, and the number of steps that it took."""

    state: State
    iterations: int


class Solver:
    """Solution of A y = b, A (n, n), b (n,) or (n, k), by sparse LU of S_ij = A_ij / (s_i s_j),
    because units of rows and columns differ; s_i^2: largest entry of row and column i. Raises
    SolveFailed, at time t (s) and with the words `what`, if A is singular or not finite."""

    def __init__(self, A: Csr, t: float = 0.0, what: str = "") -> None:
        A = csc_array(A)
        # S_ij = A_ij / (s_i s_j), s = `size`: s_i^2 is the largest entry of row and column i
        biggest = np.maximum(*(np.asarray(abs(A).max(axis=i).toarray()).ravel() for i in (0, 1)))
        self.size = np.sqrt(np.where(biggest > 0.0, biggest, 1.0))
        S = A.copy()
        S.data = S.data / (self.size[S.indices] * np.repeat(self.size, np.diff(S.indptr)))
        if not np.isfinite(S.data).all():
            raise SolveFailed(Status.NOT_FINITE, t, "", what)
        try:
            # half the fill of A^T A orderings and less; the pattern is nearly symmetric
            self._lu = splu(S, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOTS,
                            options={"SymmetricMode": True})
        except RuntimeError:
            raise SolveFailed(Status.SINGULAR, t, "", what) from None

    def __call__(self, b: FloatArray) -> FloatArray:
        size = self.size if b.ndim == 1 else self.size[:, None]
        return np.asarray(self._lu.solve(np.ascontiguousarray(b / size)) / size)


def newton(
    system: System, start: State, at: IntArray, moving: Callable[[State], State] | None = None
) -> SolvedState:
    """State with r = 0 in the equations `at`, by changes of the unknowns `at` of the start.

    Where Newton's method does not converge from the start x0, the loads are applied in steps: r(x)
    = (1 - s) r(x0) for s from 0, where x0 is the solution, to 1, with steps that are halved where
    it fails. moving: gives a state its rates, of steady rotation, which change with its positions;
    tangent: Jacobian with these changes, and rounding of inertia forces. Raises SolveFailed where
    this ends, too.
    """
    tangent = partial(_at_rest if moving is None else carried_jacobian, system)
    moving = moving or (lambda s: s)
    iterate = partial(_newton, system, at=at, moving=moving, tangent=tangent)
    try:
        return iterate(moving(start), wanted=np.zeros(len(at)))
    except SolveFailed:
        s, done, step, count = moving(start), 0.0, 0.25, 0
    first = system.residual(s)[at]
    while done < 1.0:
        ahead = min(done + step, 1.0)
        try:
            found = iterate(s, wanted=(1.0 - ahead) * first,
                            tolerance=TOLERANCE if ahead == 1.0 else 1e-4)
        except SolveFailed:
            step *= 0.5
            if step < LEAST:
                raise
            continue
        s, done, step, count = found.state, ahead, 1.5 * step, count + found.iterations
    return SolvedState(s, count)


def _at_rest(system: System, s: State) -> tuple[Csr, FloatArray]:
    """Jacobian (n, n), and rounding (n,) of inertia forces, of which a state at rest has none."""
    return system.jacobian(s), np.zeros(system.layout.size)


def _newton(
    system: System, s: State, at: IntArray, moving: Callable[[State], State],
    tangent: Callable[[State], tuple[Csr, FloatArray]], wanted: FloatArray,
    tolerance: float = TOLERANCE,
) -> SolvedState:
    """State with the residual `wanted` (m,) in the equations `at`, from the state s, by Newton
    iterations whose steps are halved until the natural monotonicity test is met (see the module).

    tangent: Jacobian, and rounding of inertia forces, in a state. The end is where the last change,
    or the one that would follow (`ahead`), is below the tolerance, relative to the magnitude of
    each unknown (weight), or where the residual is rounding (`exact`). Raises SolveFailed after
    `STEPS` iterations or `SHORTEST` steps.
    """
    size = _scale(system)[at]
    r = system.residual(s)[at] - wanted
    for k in range(1, STEPS + 1):
        J, inertia = tangent(s)
        J = J[at][:, at]
        solve = Solver(J, s.t, "stiffness")
        dx, f = -solve(r), 1.0  # f: damping factor
        weight = _weights(system, _moved(s, at, dx), size, at)
        exact = _by_block(system, at, ROUNDING * (abs(J) @ np.abs(s.x[at] + dx)) + inertia[at])
        length = float(np.abs(dx / weight).max(initial=0.0))
        while True:
            new = moving(_moved(s, at, f * dx))
            r_new = system.residual(new)[at] - wanted
            ahead = float(np.abs(solve(r_new) / weight).max(initial=0.0)) if np.isfinite(
                r_new).all() else np.inf
            if f == 1.0 and (np.abs(r_new) <= exact).all():
                return SolvedState(new, k)
            if ahead <= (1.0 - 0.5 * f) * length or length <= tolerance:
                break
            f *= 0.5
            if f < SHORTEST:
                raise SolveFailed(Status.NOT_CONVERGED, s.t, _worst(system, at, dx / weight),
                                  "static equilibrium", advice=ADVICE)
        s, r = new, r_new
        if f == 1.0 and (length <= tolerance or ahead <= 0.1 * tolerance):
            return SolvedState(s, k)
    raise SolveFailed(Status.NOT_CONVERGED, s.t, _worst(system, at, dx / weight),
                      "static equilibrium", advice=ADVICE)


ADVICE = ("Newton's method found no equilibrium: take smaller loads or an earlier time (--at), "
          "or check that something carries every load")


def flow(system: System, start: State, at: IntArray) -> SolvedState:
    """Stable equilibrium of a system with free rigid motions, by pseudo-transient continuation.
    Free motions without force and stiffness stay as they are. Raises SolveFailed for forces on a
    free motion that nothing balances.

        (J + sigma M) dx = -r,    sigma in proportion to |r|, at least `floor`

    _rate: the sigma of a first step of the size `TURN` (mass of the diagonal alone); _force: norm
    of r relative to the mass; _far: largest change relative to large motions, `size`; weight:
    magnitude of each unknown, to which its last change is relative (length).
    """
    s, size = start, _scale(system)[at]
    M = csc_array(system.tangents(s).M)[at][:, at]
    mass = M.diagonal()
    has_mass = mass > 0.0
    ratio = stiffness_to_mass(system.jacobian(s)[at][:, at], M)
    floor, r = FLOOR * max(ratio, 1.0), system.residual(s)[at]
    sigma, moved = max(floor, _rate(r, mass, has_mass, size)), np.zeros(len(at))
    for k in range(1, FLOW + 1):
        solve = Solver(system.jacobian(s)[at][:, at] + sigma * M, s.t, "stiffness")
        dx = -solve(r)
        weight = _weights(system, s, size, at)
        length = float(np.abs(dx / weight).max(initial=0.0))
        far = _far(dx, size)
        if far > TURN:  # too far to trust: again with a shorter step
            sigma *= 4.0 * far / TURN
            if sigma > 1e300:
                break
            continue
        new = _moved(s, at, dx)
        r_new = system.residual(new)[at]
        if length <= TOLERANCE and sigma <= 1e3 * floor:
            return SolvedState(new, k)
        # sigma follows |r| from step to step (switched evolution relaxation)
        before, after = (_force(x, mass, has_mass) for x in (r, r_new))
        change = after / before if before > 0.0 and length > TOLERANCE else 0.0
        sigma = max(floor, sigma * min(max(change, 0.01), 2.0))
        moved += dx
        if _far(moved, size) > LOST:
            break
        s, r = new, r_new
    raise SolveFailed(Status.NOT_CONVERGED, s.t, _worst(system, at, dx / weight),
                      "static equilibrium", advice=FREE)


FREE = ("a mechanism moves freely under its loads, so that it has no equilibrium near its pose: "
        "hold it by a joint or spring, or give its drives a function of time")


def free_motions(system: System, at: State) -> FloatArray:
    """Rigid motions (f, k) that all joints leave free, of the f rigid coordinates: null space of
    the constraints' Jacobian G, orthonormal relative to large motions (`System.sizes`)."""
    frames, rows = system.layout.frames, system.layout.algebraic
    if frames.stop == frames.start:
        return np.zeros((0, 0))
    J = system.jacobian(at)
    G = J[rows][:, frames].toarray()
    size = system.sizes()[:frames.stop]
    G = G * size  # by changes relative to large motions, and rows of length 1: free of units
    length = np.linalg.norm(G, axis=1, keepdims=True)
    G = G / np.where(length > 0.0, length, 1.0)
    _, values, right = np.linalg.svd(G, full_matrices=True)
    rank = int((values > 1e-9).sum())
    return np.asarray(right[rank:].T * size[:, None])


def neutral(system: System, at: State, free: FloatArray) -> FloatArray:
    """Free motions (n, k) that no force holds: directions with zero stiffness, of the combined
    inertia and stiffness of the n mechanical unknowns that follow them. free (f, k): of
    `free_motions`; the f rigid coordinates are the first unknowns."""
    # y = (K + sigma M)^-1 M N: a free motion without stiffness is multiplied by 1 / sigma
    t = system.tangents(at)
    numbers = system.mechanical
    K, M = (X[numbers][:, numbers] for X in (t.K, t.M))
    N = np.zeros((len(numbers), free.shape[1]))
    N[: len(free)] = free
    b = M @ N
    sigma = FLOOR * 1e2 * max(stiffness_to_mass(K, M), 1.0)
    y = Solver(K + sigma * M, at.t, "stiffness")(b)
    values, vectors = np.linalg.eig(np.linalg.solve(N.T @ b, b.T @ y))
    kept = np.abs(sigma * values.real - 1.0) < 1e-2
    return np.asarray(N @ vectors.real[:, kept])


def _far(change: FloatArray, size: FloatArray) -> float:
    """Largest change relative to large motions."""
    some = size > 0.0
    return float((np.abs(change[some]) / size[some]).max(initial=0.0))


def _moved(s: State, at: IntArray, dx: FloatArray) -> State:
    """The state with its unknowns `at` (m,) changed by dx (m,)."""
    x = s.x.copy()
    x[at] += dx
    return replace(s, x=x)


def _scale(system: System) -> FloatArray:
    """Magnitude (n,) of large motions of the system's unknowns; of reduced blocks 0, whose
    coefficients are compared with each other."""
    full, found = system.sizes(), np.zeros(system.layout.size)
    for b in system.layout:
        if b.name not in system.bases:
            found[system.layout[b.name]] = full[system.model.layout[b.name]]
    return found


def _weights(system: System, s: State, size: FloatArray, at: IntArray) -> FloatArray:
    """Magnitude of each unknown, for changes relative to it: the largest one of its block, of rigid
    coordinates at least the size of the body."""
    found = _by_block(system, at, np.abs(s.x[at]))
    rigid = (at >= system.layout.frames.start) & (at < system.layout.frames.stop)
    found = np.where(rigid, np.maximum(found, size), found)
    # an unknown of size zero is compared with the smallest change that has a meaning
    return np.maximum(found, np.where(size > 0.0, 1e-9 * size, 1e-30))


def _rate(r: FloatArray, mass: FloatArray, has_mass: IntArray, size: FloatArray) -> float:
    """sigma, 1/s2, with which the first step dx = -r / (sigma mass) is at most `TURN` of a large
    motion; has_mass (m,): True for unknowns with mass."""
    moves = has_mass & (size > 0.0)
    return float((np.abs(r[moves]) / (mass[moves] * size[moves])).max(initial=0.0)) / TURN


def _force(r: FloatArray, mass: FloatArray, has_mass: IntArray) -> float:
    """Norm sqrt(sum r_i^2 / mass_i) of a residual over the unknowns with mass."""
    return float(np.sqrt((r[has_mass] ** 2 / mass[has_mass]).sum()))


def _by_block(system: System, at: IntArray, values: FloatArray) -> FloatArray:
    """Largest one of positive values in each block, at each of its unknowns `at`."""
    found = np.zeros(system.layout.size)
    found[at] = values
    for b in system.layout:
        here = system.layout[b.name]
        found[here] = found[here].max(initial=0.0)
    return found[at]


def _worst(system: System, at: IntArray, change: FloatArray) -> str:
    """Block of the unknown with the largest relative change."""
    return system.layout.containing(at[[int(np.abs(change).argmax())]])[0]
