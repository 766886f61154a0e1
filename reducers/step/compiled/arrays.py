"""Arrays of a reduced model for compiled steps: constants of the model, of its thermal blocks and
bodies, and working arrays. They have no behaviour (kernel.py has)."""

from typing import NamedTuple

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray
from sparsemor.reducers.step.compiled.local import NO_LOCAL, LocalArrays


class HeatArrays(NamedTuple):
    """Constants of a reduced thermal block (thermal_block.py).

    at (k,), active (s,), idle (k - s,): numbers of its unknowns, of active and of inactive ones;
    by_rate, by_value: (s, k), or (1, k) for a diagonal; base (s,), loads (s, j): constant terms and
    factors of the amplitudes, the first of which is number `amplitude`; table: number of the first
    tabulated value, -1 for none. local: terms that depend on temperature, iterated at most
    `iterations` times until the relative change is `rtol`.
    """

    at: IntArray
    active: IntArray
    idle: IntArray
    by_rate: FloatArray
    by_value: FloatArray
    base: FloatArray
    loads: FloatArray
    amplitude: int
    table: int
    local: LocalArrays
    rtol: float
    iterations: int


_NONE, _EMPTY = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
NO_HEAT = HeatArrays(_NONE, _NONE, _NONE, _EMPTY, _EMPTY, np.zeros(0), _EMPTY, -1, -1, NO_LOCAL,
                     0.0, 0)
"""An empty thermal block, of the type of all."""


class KeptHeat(NamedTuple):
    """Kept Jacobian of a thermal block with local terms (`HeatJacobian`): J (s, s), pivots (s,):
    its factors; at (3, k), timed (q,): temperatures, rates and second differences, and functions of
    time, at which it was evaluated. state (2,): 0 for none, 1 where factors are to be computed, 2
    where they are there; then the number of the step of this call in which it was evaluated, -1 for
    earlier.
    """

    J: FloatArray
    pivots: IntArray
    at: FloatArray
    timed: FloatArray
    state: IntArray


NO_KEPT = KeptHeat(_EMPTY, _NONE, _EMPTY, np.zeros(0), _NONE)
"""No Jacobian, of the type of all."""


class BodyArrays(NamedTuple):
    """Constants of bodies: frames, maps to the border, and their reduced displacements
    (elastic_block.py; k = 0 for a rigid body). The first index of each array, not given here, is
    the number of the body; all are filled up with zeros to the size of the largest body, b border
    unknowns and p directions.

    items: number of contributions to the frame; kinds (i,), numbers (i, j), starts (i, 3): these
    (`FrameArrays`); gains (i,): numbers of their amplitudes, -1 for none. entries: number of rows,
    columns, values: entries of the map from the model's border unknowns; origin (b,). guide: number
    of the first value of its prescribed motion, -1 for none; rigid: number of rigid coordinates,
    positions: of those of its position.

    u: first of k displacements; active (s,), idle (k - s,): numbers of active and inactive ones; T:
    first of kt temperatures; inputs: number of rows of H, whose columns are the factors of h (w,),
    w = s + p, for u0, a0, temperatures, j amplitudes and, with damping, v0; base (w,): constant
    part of h; products (k, q), q = g w + g s + p: D^-1 M_g, M_g and P^T, and step_products (s, q)
    those of the active atoms, all transposed and filled up to a multiple of 4 rows; E (p, s), G (p,
    p): transposed; amplitude, table: as in HeatArrays.
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
    positions: IntArray
    u: IntArray
    k: IntArray
    s: IntArray
    active: IntArray
    idle: IntArray
    T: IntArray
    kt: IntArray
    g: IntArray
    p: IntArray
    inputs: IntArray
    H: FloatArray
    base: FloatArray
    j: IntArray
    products: FloatArray
    step_products: FloatArray
    E: FloatArray
    G: FloatArray
    amplitude: IntArray
    table: IntArray


class BodyTerms(NamedTuple):
    """Local terms of a body with this number: still, local: those that depend on temperatures
    alone, and on displacements; values, rates (p,): variables of the latter at the prediction."""

    number: int
    still: LocalArrays
    local: LocalArrays
    values: FloatArray
    rates: FloatArray


NO_TERMS = BodyTerms(0, NO_LOCAL, NO_LOCAL, np.zeros(0), np.zeros(0))
"""No terms, of the type of all."""


class PrescribedArrays(NamedTuple):
    """Constants of the reduced displacements of a body with prescribed motion
    (driven.py).

    number: of the body; u, k, active (s,), idle, T, kt: as in BodyArrays; inertia, stiffness,
    damping: (s, k), or (1, k) for a diagonal, damping (0, k) for none; coupling (kt, s):
    transposed; G (g, k, s), leading (g r, r).
    table, width: number of the first value and of all values of its functions of time: kappa, mu
    (g,), the bound of the contraction factor, and s loads. still, local: as in BodyTerms.
    """

    number: int
    u: int
    k: int
    active: IntArray
    idle: IntArray
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
    still: LocalArrays
    local: LocalArrays


NO_PRESCRIBED = PrescribedArrays(
    0, 0, 0, _NONE, _NONE, 0, 0, _EMPTY, _EMPTY, _EMPTY, _EMPTY, np.zeros((0, 0, 0)), _EMPTY,
    -1, 0, NO_LOCAL, NO_LOCAL)
"""An empty body, of the type of all."""


class MechanicsWork(NamedTuple):
    """Working arrays of all bodies (first index: number of the body) and of the border.

    sigma (b + 1, p), tau (b, p), border (b, b + 1), coefficients (2 g + 1,): as in `FrameWork`; s
    (3, p), forms (3 g,): functionals of u, u', u''; nothing (3, 0): those of a rigid body; gains
    (i,): present amplitudes; pose, now (3, b): border unknowns and their rates at the prediction,
    and in an iteration; inputs (3 k + kt + j,): those of H, then v0; past (3, q), change (q,):
    products with the prediction and its rates, and with the increment; h, z (w,); u (s,): active
    displacements predicted; d (s,): increments; Gs (p, b + 1): G times transposed sigma; reduced
    (b, b + 1): border less tau Gs.

    scale, distance (bodies,): reference magnitudes; elastic (bodies,): as in RunArrays;
    changes, before (bodies + 1,): of an iteration and the one before; A (N, N), dy, delta,
    predicted (N,): border system, its solution, increments and prediction; sums: as in
    `FrameFunction`.
    """

    sigma: FloatArray
    tau: FloatArray
    border: FloatArray
    coefficients: FloatArray
    s: FloatArray
    forms: FloatArray
    nothing: FloatArray
    gains: FloatArray
    pose: FloatArray
    now: FloatArray
    inputs: FloatArray
    past: FloatArray
    change: FloatArray
    h: FloatArray
    z: FloatArray
    u: FloatArray
    d: FloatArray
    Gs: FloatArray
    reduced: FloatArray
    scale: FloatArray
    distance: FloatArray
    elastic: FloatArray
    changes: FloatArray
    before: FloatArray
    A: FloatArray
    dy: FloatArray
    delta: FloatArray
    predicted: FloatArray
    sums: FloatArray


class ModelArrays(NamedTuple):
    """Constants of a model and its integrator. second, first, algebraic: first and last number of
    the unknowns of each kind; displacements (bodies, 2): of those of each body with unknown motion;
    second_new, second_old, first_new, first_old: update rules
    (`UpdateRule`); rigid: number of rigid coordinates; starts (blocks + 1,): first unknown of each
    block; weights (points + 1, points): extrapolation by that many states, newest first; sanity
    (n,): inverse of the largest permitted value of each unknown; quaternions (k,): first unknown of
    each unit quaternion."""

    second: IntArray
    first: IntArray
    algebraic: IntArray
    displacements: IntArray
    second_new: FloatArray
    second_old: FloatArray
    first_new: FloatArray
    first_old: FloatArray
    c1: float
    c2: float
    c1_first: float
    c2_first: float
    h: float
    rigid: int
    starts: IntArray
    weights: FloatArray
    sanity: FloatArray
    remaining: float
    max_iterations: int
    quaternions: IntArray


class RunArrays(NamedTuple):
    """State of a run: z (3 + j, n), unknowns with rates and the integrator's memory; ring (points,
    2 n), at (2,): newest row and number of filled ones, by_departure (n,) (predictor.py);
    elastic, bending, floor (bodies,), acceleration (1,): reference magnitudes (acceptance.py);
    remaining (1,): estimated error that the last step leaves."""

    z: FloatArray
    ring: FloatArray
    at: IntArray
    by_departure: BoolArray
    elastic: FloatArray
    bending: FloatArray
    floor: FloatArray
    acceleration: FloatArray
    remaining: FloatArray
