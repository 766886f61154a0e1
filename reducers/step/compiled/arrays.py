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


class BodyArrays(NamedTuple):
    """Constants of a body: frame, map to the border, and its reduced displacements
    (elastic_block.py; empty for a rigid body).

    kinds (i,), numbers (i, j), starts (i, 3): contributions to the frame (`FrameArrays`); gains
    (i,): numbers of their amplitudes, -1 for none. rows, columns, values: entries of the map from
    the model's border unknowns; origin (b,). guide: number of the first value of its prescribed
    motion, -1 for none; rigid: number of rigid coordinates, positions: of those of its position.

    u: first displacement; active (s,), idle: numbers of active and inactive ones; T: first
    temperature; H (w, 3 k + kt), base (w,), loads (w, j): factors of h, w = s + p; products_t (k, g
    w + g s + p): transposed D^-1 M_g, M_g and P^T, and step_products (g w + g s + p, s) those of
    the active atoms; E (s, p), Gt (p, p): transposed G; amplitude, table: as in HeatArrays. still,
    local: terms that depend on temperatures alone, and on displacements.
    """

    kinds: IntArray
    numbers: FloatArray
    starts: IntArray
    gains: IntArray
    rows: IntArray
    columns: IntArray
    values: FloatArray
    origin: FloatArray
    guide: int
    rigid: int
    positions: int
    u: int
    k: int
    active: IntArray
    idle: IntArray
    T: int
    kt: int
    g: int
    H: FloatArray
    base: FloatArray
    loads: FloatArray
    products_t: FloatArray
    step_products: FloatArray
    E: FloatArray
    Gt: FloatArray
    amplitude: int
    table: int
    still: LocalArrays
    local: LocalArrays


class PrescribedArrays(NamedTuple):
    """Constants of the reduced displacements of a body with prescribed motion
    (prescribed_frame_block.py).

    number: of the body; u, k, active (s,), idle, T, kt: as in BodyArrays; inertia, stiffness,
    damping: (s, k), or (1, k) for a diagonal, damping (0, k) for none; coupling (s, kt); G (g, k,
    s), leading (g r, r). table, width: number of the first value and of all values of its functions
    of time: kappa, mu (g,), sigma, the bound of the contraction factor, and s loads. still, local:
    as in BodyArrays.
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


NO_BODY = BodyArrays(
    _NONE, _EMPTY, np.zeros((0, 3), dtype=np.int64), _NONE, _NONE, _NONE, np.zeros(0), np.zeros(0),
    -1, 0, 0, 0, 0, _NONE, _NONE, 0, 0, 0, _EMPTY, np.zeros(0), _EMPTY, _EMPTY, _EMPTY, _EMPTY,
    _EMPTY, -1, -1, NO_LOCAL, NO_LOCAL)
NO_PRESCRIBED = PrescribedArrays(
    0, 0, 0, _NONE, _NONE, 0, 0, _EMPTY, _EMPTY, _EMPTY, _EMPTY, np.zeros((0, 0, 0)), _EMPTY, -1,
    0, NO_LOCAL, NO_LOCAL)
"""Empty bodies, of the types of all."""


class BodyWork(NamedTuple):
    """Working arrays of a body.

    sigma (b + 1, p), tau (b, p), border (b, b + 1), coefficients (2 g + 1,): as in `FrameWork`; s
    (3, p), forms (3 g,): functionals of u, u', u''; gains (i,): present amplitudes; pose, now
    (3, b): border unknowns and their rates at the prediction, and in an iteration; inputs (3 k +
    kt,): prediction with rates and temperatures; past (3, g w + g s + p), change (g w + g s + p,):
    products with the prediction and its rates, and with the increment; h, z (w,); u (s,): active
    displacements predicted; d (s,): increments; values, rates (p,): variables of the local terms
    predicted, and their rates.
    """

    sigma: FloatArray
    tau: FloatArray
    border: FloatArray
    coefficients: FloatArray
    s: FloatArray
    forms: FloatArray
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
    values: FloatArray
    rates: FloatArray


class ModelArrays(NamedTuple):
    """Constants of a model and its integrator. second, first, algebraic: first and last number of
    the unknowns of each kind; displacements (bodies, 2): of those of each body with unknown motion;
    second_new, second_old, first_new, first_old: update rules
    (`UpdateRule`); rigid: number of rigid coordinates; starts (blocks + 1,): first unknown of each
    block; weights (points + 1, points): extrapolation by that many states, newest first; sanity
    (n,): inverse of the largest permitted value of each unknown."""

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
    rigid: int
    starts: IntArray
    weights: FloatArray
    sanity: FloatArray
    remaining: float
    max_iterations: int


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
