"""Arrays of a reduced model for compiled steps: constants of the model, of its thermal blocks and
bodies, and working arrays. They have no behaviour (kernel.py has)."""

from typing import NamedTuple

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray
from sparsemor.reducers.step.compiled.local_terms import NO_LOCAL, LocalArrays


class TermArrays(NamedTuple):
    """A term of the mechanical equations: `columns`, the unknowns that it depends on, and `rows`.
    known: True if it depends on temperatures alone."""

    known: bool
    rows: IntArray
    columns: IntArray
    local: LocalArrays


class HeatArrays(NamedTuple):
    """Constants of a reduced thermal block (thermal_block.py) with unknowns `at` (k,).

    by_rate, by_value: (k, k), or (1, k) for a diagonal; increments without local terms are by_rate
    T' + by_value T + loads, from the prediction T, T'. local: terms that depend on temperature,
    iterated at most `iterations` times until the relative change is `rtol`, with the `inverse` (k,
    k) of the kept Jacobian where ready (1,) is not 0; 2: a new one is due after this step.
    """

    at: IntArray
    by_rate: FloatArray
    by_value: FloatArray
    local: LocalArrays
    rtol: float
    iterations: int
    inverse: FloatArray
    ready: IntArray


class BodyArrays(NamedTuple):
    """Constants of bodies (`reduced_equations.Stack`). The first index of each array, not given
    here, is the number of the body; all are filled up with zeros to the size of the largest body, b
    border unknowns and p directions.

    items: number of contributions to the frame; kinds (i,), numbers (i, j), starts (i, 3): these
    (`FrameArrays`); gains (i,): numbers of their amplitudes, -1 for none. entries: number of rows,
    columns, values: entries of the map from the model's unknowns to border unknowns; origin (b,).
    guide: number of the first value of its prescribed motion, -1 for none; rigid: number of rigid
    coordinates. e: first of k displacements u; g: number of matrices of the inertia; P (k, p):
    functionals P^T u that the frame reads; E (p, k): directions of its forces on u; Q (k, g k):
    quadratic forms of the inertia, G (g k, k): its matrices, transposed, both filled up to a
    multiple of 4 rows.
    """

    items: IntArray
    kinds: IntArray
    numbers: FloatArray
    starts: IntArray
    gains: IntArray
    entries: IntArray
    rows: IntArray
    columns: IntArray
    values: FloatArray
    origin: FloatArray
    guide: IntArray
    rigid: IntArray
    e: IntArray
    k: IntArray
    g: IntArray
    P: FloatArray
    E: FloatArray
    Q: FloatArray
    G: FloatArray


class BodyWork(NamedTuple):
    """Working arrays of all bodies; first index: number of the body. As in `FrameWork`, sigma (b +
    1, p): factors of the directions in the last row, their derivatives by border unknowns in the
    others; tau (b, p), H (b, b + 1): derivatives of the frame's rows by the functionals s, and by
    border unknowns, with the rows in the last column; coefficients (2 g + 1,) = kappa, mu, 1:
    factors of the inertia matrices times u and u'. s (3, p), forms (3 g,): functionals of
    u, u', u''; y (3, b): border unknowns with their rates; gains (i,); back (g k,): products of u
    with Q; turned (g k,): factors of G. nothing (3, 0): functionals of a rigid body; sums: as in
    `FrameFunction`."""

    sigma: FloatArray
    tau: FloatArray
    H: FloatArray
    coefficients: FloatArray
    s: FloatArray
    forms: FloatArray
    y: FloatArray
    gains: FloatArray
    back: FloatArray
    turned: FloatArray
    nothing: FloatArray
    sums: FloatArray


class PrescribedArrays(NamedTuple):
    """Constants of the reduced displacements of a body with prescribed motion
    (prescribed_body.py).

    block: number of its block; u, k: first and number of its displacements; T, kt: of its
    temperatures; inertia, stiffness, damping: (k, k), or (1, k) for a diagonal, damping (0, k) for
    none, all with the sign of the right-hand side, as coupling (kt, k), transposed; G (g, k, k):
    matrices of the rotation, transposed; leading (g r, r): these in the r leading modes, not
    transposed, one below the other. table, width: number of the
    first value and of all values of its functions of time: kappa, mu (g,), the bound of the
    contraction factor, and k loads. of_temperature, local: terms that depend on temperatures alone,
    and on displacements.
    """

    block: int
    u: int
    k: int
    T: int
    kt: int
    inertia: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    coupling: FloatArray
    G: FloatArray
    leading: FloatArray
    table: int
    width: int
    of_temperature: LocalArrays
    local: LocalArrays


_NONE, _EMPTY = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
NO_TERM = TermArrays(False, _NONE, _NONE, NO_LOCAL)
NO_HEAT = HeatArrays(_NONE, _EMPTY, _EMPTY, NO_LOCAL, 0.0, 0, _EMPTY, _NONE)
NO_PRESCRIBED = PrescribedArrays(0, 0, 0, 0, 0, _EMPTY, _EMPTY, _EMPTY, _EMPTY, np.zeros((0, 0, 0)),
                                 _EMPTY, -1, 0, NO_LOCAL, NO_LOCAL)
"""An empty one of each, of the type of all."""


class ModelArrays(NamedTuple):
    """Constants of a model of n unknowns and its integrator.

    old (q, q, n), new (q, n): rows of the state after a step are old times those before, which is
    the free motion, plus new times the departure (`UpdateRule`). first, atoms (2,): first and last
    number of temperatures, and of all coefficients; of_motion (3, a, a), ends (3, a, 2): constant
    operators of the free motion, its rate, and final temperatures, with the first and last column
    that is not zero in each row. starts (blocks + 1,): first unknown of each block; judged, second
    (blocks,): True for blocks whose change must converge (not multipliers), and for those of second
    order; solved: unknowns of the mechanical equations. weights (points + 1,
    points): extrapolation by that many states, newest first; sanity (n,): inverse of the largest
    permitted value of each unknown; quaternions (k,): first unknown of each unit quaternion.
    """

    old: FloatArray
    new: FloatArray
    first: IntArray
    atoms: IntArray
    of_motion: FloatArray
    ends: IntArray
    c1: float
    c2: float
    c1_first: float
    c2_first: float
    h: float
    starts: IntArray
    judged: BoolArray
    second: BoolArray
    solved: IntArray
    weights: FloatArray
    sanity: FloatArray
    remaining: float
    max_iterations: int
    quaternions: IntArray


class StepArrays(NamedTuple):
    """Working arrays of a step: free, past (q, n), X (3, n + 4): free motion, a state, and unknowns
    with their rates; d, base, r, own, dx (n,): departure, constants, residual, its part in the
    unknowns `solved`, change; guess (2 n,): extrapolated unknowns and departures; size, absolute,
    relative (blocks,): reference magnitudes, and sizes of changes in units of the unknowns and
    relative to `size`; earlier, before (blocks,): those one iteration earlier; L (k, 4, 4): turns
    of attitudes since the kept Jacobian."""

    free: FloatArray
    past: FloatArray
    X: FloatArray
    d: FloatArray
    base: FloatArray
    r: FloatArray
    own: FloatArray
    dx: FloatArray
    guess: FloatArray
    size: FloatArray
    absolute: FloatArray
    relative: FloatArray
    earlier: FloatArray
    before: FloatArray
    L: FloatArray


class RunArrays(NamedTuple):
    """State of a run: z (q, n), unknowns with rates and the integrator's memory; ring (points, 2
    n), at (2,): newest row and number of filled ones, by_departure (n,) (predictor.py); top, rate,
    noise (blocks,): sizes and round-off; inverse (s, s), attitudes (k, 4, 4, 4): inverse of the
    kept Jacobian, and the turns from its attitudes (`turns_from`); effort (3,): `least` and `debt`
    of it (`newton_loop.Kept`), and 1 where a new Jacobian is due; remaining (1,): estimated error
    that the last step leaves."""

    z: FloatArray
    ring: FloatArray
    at: IntArray
    by_departure: BoolArray
    top: FloatArray
    rate: FloatArray
    noise: FloatArray
    inverse: FloatArray
    attitudes: FloatArray
    effort: IntArray
    remaining: FloatArray
