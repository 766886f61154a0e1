"""Arrays of a reduced model for compiled steps: constants of the model, of its thermal blocks and
bodies, and working arrays. They have no behaviour (kernel.py has)."""

from typing import NamedTuple

from sparsemor.core import BoolArray, FloatArray, IntArray
from sparsemor.reducers.step.compiled.local_terms import LocalArrays


class OperatorArrays(NamedTuple):
    """A `ConstantOperator` of the unknowns from number `columns` on (of 0) or of their rates (1),
    in the rows from number `rows` on; A: transposed, or (1, k) for a diagonal."""

    rows: int
    columns: int
    of: int
    A: FloatArray


class TermArrays(NamedTuple):
    """A term of the mechanical equations: `columns`, the unknowns that it depends on, and
    `rows`."""

    rows: IntArray
    columns: IntArray
    local: LocalArrays


class HeatArrays(NamedTuple):
    """Constants of a reduced thermal block (thermal_block.py) with unknowns `at` (k,).

    by_rate, by_value: (k, k), transposed, or (1, k) for a diagonal; increments without local terms
    are by_rate T' + by_value T + loads, from the prediction T, T'. local: terms that depend on
    temperature, if any block has some, iterated at most `iterations` times until the relative
    change is `rtol`, with the `inverse` (k, k) of the kept Jacobian where ready (1,) is not 0; 2: a
    new one is due after this step. Of a step, x, v, r (k,): T, T', increments.
    """

    at: IntArray
    by_rate: FloatArray
    by_value: FloatArray
    local: tuple[LocalArrays, ...]
    rtol: float
    iterations: int
    inverse: FloatArray
    ready: IntArray
    x: FloatArray
    v: FloatArray
    r: FloatArray


class StackArrays(NamedTuple):
    """Bodies of similar size (`reduced_equations.Stack`), of which the first index of an array is
    the number, where not said otherwise; all are filled up with zeros to the size of the largest
    body, b border unknowns, k displacements and p directions.

    bodies (8,): number of contributions to the frame; first of the displacements u, their number,
    and that of matrices g of the inertia; number of the first value of the prescribed motion, -1
    for none, and of rigid coordinates; first and last of its entries of the map from the model's
    unknowns to border unknowns, which are at `rows`, `columns` with these `values` (of all bodies).
    kinds (i,), numbers (i, j), starts (i, 3): contributions to the frame (`FrameArrays`); gains
    (i,): numbers of their amplitudes, -1 for none. origin (b,). P (k, p): functionals P^T u that
    the frame reads; E (p, k): directions of its forces on u; Q (k, g k): quadratic forms of the
    inertia, G (g k, k): its matrices, transposed.

    Of the evaluation of one body, as in `FrameWork`, sigma (b + 1, p): factors of the directions in
    the last row, their derivatives by border unknowns in the others; tau (b, p), H (b, b + 1):
    derivatives of the frame's rows by the functionals s, and by border unknowns, with the rows in
    the last column; coefficients (2 g + 1,) = kappa, mu, 1: factors of the inertia matrices times u
    and u'. s (3, p), forms (3 g,): functionals of u, u', u''; y (3, b): border unknowns with their
    rates; gained (i,): amplitudes; products (g k,): of u with Q, then factors of G; nothing (3, 0):
    functionals of a rigid body; sums: as in `FrameFunction`.
    """

    bodies: IntArray
    rows: IntArray
    columns: IntArray
    values: FloatArray
    kinds: IntArray
    numbers: FloatArray
    starts: IntArray
    gains: IntArray
    origin: FloatArray
    P: FloatArray
    E: FloatArray
    Q: FloatArray
    G: FloatArray
    sigma: FloatArray
    tau: FloatArray
    H: FloatArray
    coefficients: FloatArray
    s: FloatArray
    forms: FloatArray
    y: FloatArray
    gained: FloatArray
    products: FloatArray
    nothing: FloatArray
    sums: FloatArray


class PrescribedArrays(NamedTuple):
    """A body with prescribed motion (`PrescribedBody`) with displacements from number `at` on.

    G (g, k, k): matrices of the rotation, transposed; table: number of the first of its functions
    of time kappa, mu (g,); inertia (k,): kappa u + mu u' in an evaluation.
    """

    at: int
    G: FloatArray
    table: int
    inertia: FloatArray


class EquationArrays(NamedTuple):
    """Equations of the mechanics (`reduced_equations.Reduced`, with these names); identity: rows
    with a term d; solved: unknowns for which the kept Jacobian is not the identity; moves: False
    for heat alone; price: cost of a new Jacobian in iterations."""

    constants: tuple[OperatorArrays, ...]
    thermal: tuple[OperatorArrays, ...]
    stacks: tuple[StackArrays, ...]
    prescribed: tuple[PrescribedArrays, ...]
    known: tuple[TermArrays, ...]
    iterated: tuple[TermArrays, ...]
    identity: IntArray
    solved: IntArray
    moves: bool
    price: int


class ModelArrays(NamedTuple):
    """Constants of a model of n unknowns and its integrator.

    old (q, q, n), new (q, n): rows of the state after a step are old times those before, which is
    the free motion, plus new times the departure (`UpdateRule`). first (2,): first and last number
    of temperatures. starts (blocks + 1,): first unknown of each block; judged, second (blocks,):
    True for blocks whose change must converge (not multipliers), and for those of second order.
    weights (points + 1, points): extrapolation by that many states, newest first; sanity (n,):
    inverse of the largest permitted value of each unknown; quaternions (k,): first unknown of each
    unit quaternion.
    """

    old: FloatArray
    new: FloatArray
    first: IntArray
    c1: float
    c2: float
    c1_first: float
    c2_first: float
    h: float
    starts: IntArray
    judged: BoolArray
    second: BoolArray
    weights: FloatArray
    sanity: FloatArray
    remaining: float
    max_iterations: int
    quaternions: IntArray


class StepArrays(NamedTuple):
    """Working arrays of a step: free, past (q, n), X (3, n): free motion, a state, and unknowns
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
    noise (blocks,): sizes and round-off; inverse (s, s), spans (s, 2), attitudes (k, 4, 4, 4):
    inverse of the kept Jacobian, with the first and last column that is not zero in each row, and
    the turns from its attitudes (`turns_from`); effort (3,): `least` and `debt`
    of it (`newton_loop.KeptJacobian`), and 1 where a new Jacobian is due; remaining (1,): estimated
    error that the last step leaves."""

    z: FloatArray
    ring: FloatArray
    at: IntArray
    by_departure: BoolArray
    top: FloatArray
    rate: FloatArray
    noise: FloatArray
    inverse: FloatArray
    spans: IntArray
    attitudes: FloatArray
    effort: IntArray
    remaining: FloatArray
