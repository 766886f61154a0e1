"""Force modes of one block and their interpolation points, for DEIM and GNAT.

The force consists of all terms that are not linear in the block's own unknowns, f = K x + D x' + M
x'' (for heat K T + C T'). The training snapshots contain x; its rates are recomputed with the
integrator, whose formula is linear and acts on each unknown separately, so forces need not be
stored.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.sparse import eye_array

from sparsemor.core import (
    Basis,
    BlockData,
    Dictionary,
    FloatArray,
    InputError,
    IntArray,
    Layout,
    Sampler,
    State,
    Status,
    StepOutcome,
    advanced,
    step_formula,
)
from sparsemor.core.linalg.dense import svd
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.reducer import Recording
from sparsemor.core.registry.returned_values import built_dictionary, sampled_rows
from sparsemor.reducers.linalg.left_inverse import deficient
from sparsemor.reducers.projection.operators_and_test_maps import Reducible

FROM_ZERO = "their modes are counted from zero: take centred: false"
DETERMINED = 1e-12
"""Smallest singular value of the modes' rows at the points, relative to the largest one of the
modes, for which the points determine the coefficients of the modes."""



Numbers = dict[str, float | int | str]


def force_snapshots(block: Reducible) -> tuple[FloatArray, float]:
    """Forces M a + D v + K x (n, M) of a block in the training run, which its loads and nonlinear
    terms balance, and an upper bound of the singular values that round-off causes in them, since
    they are small differences of large terms: those of operator |x|, operator = K + c1 D + c2 M."""
    taken = recording(block)
    # taken.runs: number of training runs, with equally many snapshots (n, M / runs) each
    runs = np.split(
        np.asarray(block.offline.snapshots(block.name), dtype=np.float64), taken.runs, axis=1)
    # without the state x + h^2 a of the start that second-order runs add as the last column
    runs = [states(block, X, taken) for X in runs]
    # rates and accelerations of each run
    rates = [replayed(block, X, taken) if replayable(block, X, taken)
             else differences(X, taken.step * taken.every) for X in runs]
    X = np.concatenate(runs, axis=1)
    V, A = (np.concatenate(parts, axis=1) for parts in zip(*rates, strict=True))
    n, M = X.shape
    size = np.linalg.norm(abs(block.linear.operator) @ np.abs(X)) / np.sqrt(n * M)
    # a matrix of random entries of size 1 has singular values up to sqrt n + sqrt M
    noise = 4.0 * float(np.finfo(np.float64).eps) * (np.sqrt(n) + np.sqrt(M)) * size
    return block.linear.force(X, V, A), float(noise)


def recording(block: Reducible) -> Recording:
    """Integrator and step of the snapshots; snapshots passed in directly count as one per step of
    the run."""
    return block.offline.recording or Recording(block.integrator, block.h, 1)


def states(block: Reducible, X: FloatArray, taken: Recording) -> FloatArray:
    """Snapshots X (n, M) without the last column x + h^2 a of the initial state, which the training
    run adds for second-order equations."""
    if taken.integrator.order == 1 or X.shape[1] < 2:
        return X
    added = block.offline.recording is not None
    if not added:
        at, first = block.model.layout[block.name], consistent_state(block.model)
        want = (first.x + block.h**2 * first.a)[at]
        added = bool(np.abs(X[:, -1] - want).max() <= 1e-12 * np.abs(want).max())
    return X[:, :-1] if added else X


def replayable(block: Reducible, X: FloatArray, taken: Recording) -> bool:
    """True if the snapshots contain every step and begin at the initial state of this model, whose
    accelerations those of several runs need not share."""
    if (taken.runs > 1 and taken.integrator.order > 1) or not taken.integrator.one_solve:
        return False
    start = block.model.x0[block.model.layout[block.name]]
    top = float(np.abs(start).max(initial=0.0))
    return taken.every == 1 and bool(np.abs(X[:, 0] - start).max(initial=0.0) <= 1e-12 * top)


def replayed(
    block: Reducible, X: FloatArray, recording: Recording
) -> tuple[FloatArray, FloatArray]:
    """Rates and accelerations (n, M) that the integrator computed for X (n, M), up to the
    rounding of c2 X."""
    model, at = block.model, block.model.layout[block.name]
    unknowns = model.layout.block(block.name)
    layout = Layout([unknowns])
    first = consistent_state(model)
    state = State(0.0, X[:, 0], first.v[at], first.a[at], np.zeros((unknowns.size, 0)))
    integrator, rules = recording.integrator, recording.integrator.rules(recording.step)
    state = integrator.start(layout, state)
    V, A = np.empty_like(X), np.empty_like(X)
    V[:, 0], A[:, 0] = state.v, state.a
    for j in range(1, X.shape[1]):  # each step ends at the next snapshot, without a solve
        formula = step_formula(rules, layout, state, recording.step)
        state = advanced(
            rules, layout, state, formula, StepOutcome(X[:, j], Status.DONE, 1))
        V[:, j], A[:, j] = state.v, state.a
    return V, A


def differences(X: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Rates and accelerations by central differences of snapshots that are `spacing` s apart."""
    if X.shape[1] < 2:
        return np.zeros_like(X), np.zeros_like(X)
    V = np.gradient(X, spacing, axis=1)
    return V, np.gradient(V, spacing, axis=1)


def force_modes(block: Reducible, basis: Basis) -> Dictionary:
    """Modes (n, f) of the block's force as a dictionary, cached; f = 0 where no force acts on the
    block."""
    taken = recording(block)  # integrator and times of the training run
    depends = (block.name, basis, taken.integrator, taken.step, taken.every)

    def make() -> Mapping[str, FloatArray]:
        """Force modes of the block as they are cached, without those that are noise: whose share in
        the forces F (n, M) of the training run is below the singular values that round-off causes
        in them."""
        F, noise = force_snapshots(block)
        if basis.needs_snapshots and np.linalg.norm(F, 2) <= noise:
            return {"modes": np.zeros((block.size, 0))}
        try:
            modes = built_dictionary(basis, equation_data(block, F))
        except InputError as error:
            raise InputError(f"forces of {block.name}: {error}", "reducer.force_basis") from None
        if np.any(modes.offset):
            raise InputError(f"forces of {block.name}: {FROM_ZERO}", "reducer.force_basis")
        amounts = np.linalg.norm(modes.atoms.T @ F, axis=1)
        real = amounts > noise if basis.needs_snapshots else np.ones(len(amounts), dtype=bool)
        return {"modes": modes.atoms[:, real]}

    U = np.asarray(block.offline.remember("forces", depends, make)["modes"])
    return Dictionary(U, np.zeros(block.size), tuple(f"force {i}" for i in range(U.shape[1])))


def equation_data(block: Reducible, F: FloatArray) -> BlockData:
    """The block's equations instead of its unknowns: F (n, M) as snapshots, identity operators, so
    that samplers and bases that multiply by the operators leave the force modes unchanged."""
    one = eye_array(block.size, format="csr")
    return replace(block.model.block_data(block.name), snapshots=F, mass=one, stiffness=one)


def choose_points(
    block: Reducible, modes: Dictionary, m: int, sampler: Sampler, required: bool
) -> IntArray:
    """m points chosen by the sampler for the modes, and with `required` the rows of joints and
    loads in addition; cached."""
    fixed = block.model.required[block.name] if required else np.zeros(0, dtype=np.int64)
    f = modes.atoms.shape[1]
    drawn = max(min(m, block.size - len(fixed)), 0)

    def make() -> Mapping[str, IntArray]:
        """Points drawn by the sampler in addition to those that are always kept."""
        data = equation_data(block, np.zeros((block.size, 0)))
        return {"rows": sampled_rows(sampler, data, drawn, modes, block.rng, fixed)}

    if not f:
        return fixed
    depends = (block.name, drawn, sampler, modes.atoms, fixed, repr(block.rng.bit_generator.state))
    points: IntArray = np.asarray(block.offline.remember("rows", depends, make)["rows"])
    if len(points) < f:
        raise InputError(
            f"{block.name}: {len(points)} points cannot determine {f} modes: take more points or "
            "fewer modes", "reducer.points")
    return points


def interpolation(name: str, U: FloatArray, points: IntArray) -> tuple[FloatArray, Numbers]:
    """Interpolation matrix (P^T U)^+ (f, m) for modes U (n, f) at m points, and numbers to report.

    condition: of P^T U; amplification: |(P^T U)^+| |U|, the factor by which the projection error of
    a force on the modes may grow. Raises SolveFailed (rank deficient) where the points do not
    distinguish the modes.
    """
    f, m = U.shape[1], len(points)
    if not f:
        return np.zeros((0, m)), {"points": m}
    W, s, Vt = svd(U[points])
    whole = float(np.linalg.norm(U, 2))
    if not s[-1] > DETERMINED * whole:
        raise deficient(name, f"its {m} points do not distinguish its {f} modes: take more "
                        "points, required: true or another sampler", sampled=True)
    facts: Numbers = {
        "points": m, "condition": float(s[0] / s[-1]),
        "amplification": whole / float(s[-1])}
    return np.asarray((Vt.T / s) @ W.T), facts
