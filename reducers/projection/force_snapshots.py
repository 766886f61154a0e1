"""Force modes of one block and the points that determine them: what DEIM and GNAT are built on.

The force is all that is not linear in the block's own unknowns, f = K x + D x' + M x'' (for heat
K T + C T'). Training snapshots hold x; its rates follow by replaying the integrator, whose formula
is linear and acts on each unknown alone, so no force has to be stored.
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
    Recording,
    Sampler,
    State,
    built_dictionary,
    consistent_state,
    sampled_rows,
    svd,
)
from sparsemor.reducers.projection.base import Reducible
from sparsemor.reducers.step.left_inverse import deficient

FROM_ZERO = "their modes are counted from zero: take centred: false"
DETERMINED = 1e-12
"""Least singular value of the modes at the points, relative to the modes' own largest, below which
the points do not determine them."""



Numbers = dict[str, float | int | str]


def force_snapshots(block: Reducible) -> tuple[FloatArray, float]:
    """(n, M) forces of a block over the training run, and the singular value that their round-off
    alone can reach: they are what is left of terms that cancel."""
    taken = recording(block)
    X = states(block, np.asarray(block.offline.snapshots(block.name), dtype=np.float64), taken)
    if replayable(block, X, taken):
        V, A = replayed(block, X, taken)
    else:
        V, A = differences(X, taken.step * taken.every)
    n, M = X.shape
    size = np.linalg.norm(abs(block.linear.operator) @ np.abs(X)) / np.sqrt(n * M)
    # a matrix of random entries of size 1 has singular values up to sqrt n + sqrt M
    noise = 4.0 * float(np.finfo(np.float64).eps) * (np.sqrt(n) + np.sqrt(M)) * size
    return block.linear.force(X, V, A), float(noise)


def recording(block: Reducible) -> Recording:
    """Provenance of the snapshots; snapshots passed in count as every step of the run itself."""
    return block.offline.recording or Recording(block.integrator, block.h, 1)


def states(block: Reducible, X: FloatArray, taken: Recording) -> FloatArray:
    """X (n, M) without what `train` adds for second-order rules: x + h^2 a of the start."""
    if taken.integrator.order == 1 or X.shape[1] < 2:
        return X
    added = block.offline.recording is not None
    if not added:
        at, first = block.model.layout[block.name], consistent_state(block.model)
        want = (first.x + block.h**2 * first.a)[at]
        added = bool(np.abs(X[:, -1] - want).max() <= 1e-12 * np.abs(want).max())
    return X[:, :-1] if added else X


def replayable(block: Reducible, X: FloatArray, taken: Recording) -> bool:
    """True if every step was kept, from a start that is this model's own."""
    start = block.model.x0[block.model.layout[block.name]]
    top = float(np.abs(start).max(initial=0.0))
    return taken.every == 1 and bool(np.abs(X[:, 0] - start).max(initial=0.0) <= 1e-12 * top)


def replayed(block: Reducible, X: FloatArray, taken: Recording) -> tuple[FloatArray, FloatArray]:
    """Rates (n, M) that the integrator gave to X (n, M), bit by bit the same."""
    model, at = block.model, block.model.layout[block.name]
    own = model.layout.block(block.name)
    layout = Layout([own])
    first = consistent_state(model)
    state = State(0.0, X[:, 0], first.v[at], first.a[at], np.zeros((own.size, 0)))
    state = taken.integrator.start(layout, state)
    V, A = np.empty_like(X), np.empty_like(X)
    V[:, 0], A[:, 0] = state.v, state.a
    for j in range(1, X.shape[1]):
        formula = taken.integrator.formula(layout, state, taken.step)
        state = taken.integrator.advance(layout, state, formula, X[:, j], taken.step)
        V[:, j], A[:, j] = state.v, state.a
    return V, A


def differences(X: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Rates by central differences of snapshots `spacing` s apart."""
    if X.shape[1] < 2:
        return np.zeros_like(X), np.zeros_like(X)
    V = np.gradient(X, spacing, axis=1)
    return V, np.gradient(V, spacing, axis=1)


def force_modes(block: Reducible, basis: Basis) -> Dictionary:
    """Modes (n, f) of the block's force, cached. None (f = 0) where nothing acts on it."""
    taken = recording(block)
    depends = (block.name, basis, taken.integrator, taken.step, taken.every)

    def make() -> Mapping[str, FloatArray]:
        F, noise = force_snapshots(block)
        if basis.needs_snapshots and np.linalg.norm(F, 2) <= noise:
            return {"modes": np.zeros((block.size, 0))}
        try:
            made = built_dictionary(basis, equation_data(block, F))
        except InputError as error:
            raise InputError(f"forces of {block.name}: {error}", "reducer.force_basis") from None
        if np.any(made.offset):
            raise InputError(f"forces of {block.name}: {FROM_ZERO}", "reducer.force_basis")
        amounts = np.linalg.norm(made.atoms.T @ F, axis=1)
        real = amounts > noise if basis.needs_snapshots else np.ones(len(amounts), dtype=bool)
        return {"modes": made.atoms[:, real]}

    U = np.asarray(block.offline.remember("forces", depends, make)["modes"])
    return Dictionary(U, np.zeros(block.size), tuple(f"force {i}" for i in range(U.shape[1])))


def equation_data(block: Reducible, F: FloatArray) -> BlockData:
    """The block's rows as unknowns of their own: F (n, M) are its snapshots, operators are 1.

    Samplers and bases that apply the operators then see force modes as they are.
    """
    one = eye_array(block.size, format="csr")
    return replace(block.model.block_data(block.name), snapshots=F, mass=one, stiffness=one)


def choose_points(
    block: Reducible, modes: Dictionary, m: int, sampler: Sampler, required: bool
) -> IntArray:
    """m points by the sampler, and those of joints and loads where `required` (cached)."""
    held = block.model.required[block.name] if required else np.zeros(0, dtype=np.int64)
    f = modes.atoms.shape[1]
    drawn = max(min(m, block.size - len(held)), 0)

    def make() -> Mapping[str, IntArray]:
        data = equation_data(block, np.zeros((block.size, 0)))
        return {"rows": sampled_rows(sampler, data, drawn, modes, block.rng, held)}

    if not f:
        return held
    depends = (block.name, drawn, sampler, modes.atoms, held, repr(block.rng.bit_generator.state))
    points: IntArray = np.asarray(block.offline.remember("rows", depends, make)["rows"])
    if len(points) < f:
        raise InputError(
            f"{block.name}: {len(points)} points cannot determine {f} modes: take more points or "
            "fewer modes", "reducer.points")
    return points


def interpolation(name: str, U: FloatArray, points: IntArray) -> tuple[FloatArray, Numbers]:
    """(P^T U)^+ (f, m) for modes U (n, f) at m points, and what to report of it.

    condition: of P^T U; amplification: by how much what the modes leave of a force may grow,
    |(P^T U)^+| |U|. Raises SolveFailed (rank deficient) where the points cannot tell the modes
    apart, or see nothing of them.
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
