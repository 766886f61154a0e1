"""Names of the loads of a block; load patterns of moving loads: unit loads on surface points or
patches along the path, or leading singular vectors of the load tables; and the compression of many
responses to few orthonormal atoms, their leading singular vectors."""

from collections.abc import Sequence

import numpy as np
from scipy import linalg
from scipy.sparse import csr_array

from sparsemor.core import BlockData, Csr, FloatArray, InputError, IntArray
from sparsemor.core.model.model import distinct_names
from sparsemor.core.protocols.load_tables import loaded_columns
from sparsemor.plugins.bases.orthogonalise import independent
from sparsemor.plugins.bases.snapshot_svd import left_singular, round_off_level

AXES = ("x", "y", "z", "about x", "about y", "about z", "mode")


def load_names(data: BlockData) -> tuple[str, ...]:
    """Name of each column of the loads of a block."""
    return data.load_names or tuple(f"load {i}" for i in range(data.loads.shape[1]))


def unit_loads(data: BlockData, patches: int | None) -> tuple[FloatArray, list[str]]:
    """Unit loads F (n, q) along the path of all moving loads, with a name for each column.

    A name reads "sole, node 12, x". The columns are those of the moving loads that act at some time
    or, with `patches`, that many combinations of them for each load and direction. In the plane,
    patches are hat functions at equal distances along the path; on a surface in space, each patch
    has the points nearest to one of several centres that are far from each other.
    """
    columns, names = [np.zeros((data.size, 0))], list[str]()
    for load in data.moving:
        used = loaded_columns(load)
        found, said = load.columns[:, used], [load.names[i] for i in used]
        if patches is not None:
            found, said = _patched(data, found, load.source, patches)
        columns.append(np.asarray(found.toarray()))
        names += said
    return np.concatenate(columns, axis=1), list(distinct_names(names))


def tabled_loads(data: BlockData, count: int) -> tuple[FloatArray, list[str]]:
    """Load shapes F (n, q) and their names: leading singular vectors of each moving load's table.

    At most `count` per load, over all its times, scaled by their root mean square over these times.
    A load that covers many nodes at once is represented by few of them, but by unit loads only with
    one per node.
    """
    columns, names = [np.zeros((data.size, 0))], list[str]()
    for load in data.moving:
        V = load.table.values  # (times, columns): amplitudes of the unit loads `load.columns`
        # the small side: times or columns; squares lose what is below 1e-8 of the largest
        gram = V @ V.T if len(V) < V.shape[1] else V.T @ V
        values, vectors = np.linalg.eigh(gram)
        kept = np.flatnonzero(values > 1e-14 * max(values[-1], 1e-300))[::-1][:count]
        if len(V) < V.shape[1]:
            shapes = V.T @ vectors[:, kept]
        else:
            shapes = vectors[:, kept] * np.sqrt(values[kept])
        columns.append(np.asarray(load.columns @ shapes) / np.sqrt(len(V)))
        names += [f"{load.source}, tabled {i}" for i in range(len(kept))]
    return np.concatenate(columns, axis=1), list(distinct_names(names))


def moving_loads(
    data: BlockData, patches: int | None, tabled: int | None
) -> tuple[FloatArray, list[str]]:
    """Load patterns F (n, q) and their names: `tabled_loads` if `tabled` is set, else
    `unit_loads`."""
    return unit_loads(data, patches) if tabled is None else tabled_loads(data, tabled)


def refuse_both(points: int | None, tabled: int | None, option: str) -> None:
    """Raises InputError if unit loads (`points`, set by `option`) and tabulated load shapes
    (`tabled`) are both requested."""
    if points is not None and tabled is not None:
        raise InputError(f"give {option} (unit loads at positions) or tabled (loads as tabulated), "
                         "not both", "tabled")


def refuse_nowhere(data: BlockData, who: str) -> InputError:
    """Error for a block over which no load moves."""
    return InputError(
        f"{who}: no load moves over {data.name}, so it has no such response; give this block "
        "another basis under reducer.bases, such as static")


def known_step(data: BlockData, who: str) -> None:
    """Raises InputError if the data contain no time step, which dynamic responses need."""
    if not any(data.factors):
        raise InputError(f"{who}: the time step that {data.name} is reduced for is missing: pass "
                         "it to model.block_data(name, step=...)")


def _patched(
    data: BlockData, columns: Csr, source: str, count: int
) -> tuple[Csr, list[str]]:
    """Patches of the columns (n, j) of one load, at most `count` for each direction, and their
    names."""
    row = np.asarray(abs(columns).argmax(axis=0)).ravel()  # the unknown that each column acts on
    found, names = list[Csr](), list[str]()
    for axis in np.unique(data.component[row]):
        own = np.flatnonzero(data.component[row] == axis)
        weights = patch_weights(data.coordinates[row[own]], count)
        found.append(columns[:, own] @ csr_array(weights))
        direction = f", {AXES[axis]}" if data.component.any() else ""
        names += [f"{source}, patch {i}{direction}" for i in range(weights.shape[1])]
    return csr_array(np.concatenate([f.toarray() for f in found], axis=1)), names


def patch_weights(points: FloatArray, count: int) -> FloatArray:
    """Weights (j, q) of points (j, d) in each of q patches, at most `count`; rows sum to 1."""
    j = len(points)
    if count >= j:
        return np.eye(j)
    if points.shape[1] == 3:
        centres = _far_apart(points, count)
        nearest = np.linalg.norm(points[:, None] - points[centres], axis=2).argmin(axis=1)
        return np.asarray(nearest[:, None] == np.arange(count), dtype=np.float64)
    # hat functions of the length along the curve through the points, m
    order = _chain(points)
    along = np.zeros(j)
    along[order[1:]] = np.cumsum(np.linalg.norm(np.diff(points[order], axis=0), axis=1))
    centres_at = np.linspace(0.0, along.max(), count)
    return np.stack([np.interp(along, centres_at, hat) for hat in np.eye(count)], axis=1)


def _chain(points: FloatArray) -> IntArray:
    """Order of the points along a curve through them: repeatedly the nearest remaining point."""
    start = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
    left, order = np.ones(len(points), dtype=bool), [start]
    left[start] = False
    while left.any():
        away = np.where(left, np.linalg.norm(points - points[order[-1]], axis=1), np.inf)
        order.append(int(away.argmin()))
        left[order[-1]] = False
    return np.array(order, dtype=np.int64)


def _far_apart(points: FloatArray, count: int) -> IntArray:
    """Indices of `count` points, each the farthest from those before it."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    away = np.full(len(points), np.inf)
    while len(chosen) < count:
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(away.argmax()))
    return np.array(chosen, dtype=np.int64)


def largest_directions(
    A: FloatArray, first: FloatArray, count: int, rtol: float, rest: float = 0.0
) -> FloatArray:
    """Leading left singular vectors (n, k), at most `count`, of A (n, j) orthogonal to `first` (n,
    p).

    `first` has orthonormal columns; singular values must exceed `rtol` times the largest. rest:
    norm of a part of A, relative to the largest singular value, that may be left out.
    """
    for _ in range(2):  # once leaves what cancellation brings back
        A = A - first @ (first.T @ A)
    if not A.any():
        return A[:, :0]
    U, s = left_singular(A, max(rtol, round_off_level(*A.shape)), rest)
    kept = min(count, int(np.count_nonzero(s > rtol * s[0])), len(A) - first.shape[1])
    return U[:, :kept]


def compressed(
    first: FloatArray, names: Sequence[str], A: FloatArray, count: int, rtol: float, kind: str,
    rest: float = 0.0,
) -> tuple[FloatArray, list[str]]:
    """Orthonormal atoms (n, k) and their names: the independent ones of the unit columns `first`
    (n, p) with these names, then at most `count` leading directions of A (n, j) orthogonal to them,
    named "`kind` 0", ... rtol, rest: see `largest_directions`."""
    kept, Q = independent(first, rtol)
    U = largest_directions(A, Q, count, rtol, rest)
    return np.hstack([Q, U]), [
        *(names[i] for i in kept), *(f"{kind} {i}" for i in range(U.shape[1]))]


def steps_of(data: BlockData) -> int:
    """Number of time steps that the tables of the moving loads cover; 1 if the step is unknown."""
    moving = [*data.moving, *(data.heat.moving if data.heat is not None else ())]
    span = max(m.table.times[-1] - m.table.times[0] for m in moving)
    return max(1, round(float(span) / data.step)) if data.step else 1


def likely_states(heat: BlockData, atoms: FloatArray, tabled: int | None = None) -> FloatArray:
    """Temperatures X (n, k) with X X^T = sum over p of x_p x_p^T, scaled by how large each becomes.

    x_p are the temperatures p steps after unit heat on the path of a moving heat source (or after
    one of `tabled` load shapes), projected on the span of `atoms`. The sum (a controllability
    Gramian) over 2 N delays is W + A^N W (A^N)^T, with W the sum over N delays and A the matrix of
    one step. Returns `atoms` if no heat source moves or the time step is unknown.
    """
    forces, names = moving_loads(heat, None, tabled)
    if not names or not any(heat.factors):
        return atoms
    _, Q = independent(atoms, 1e-12)
    B = Q.T @ (heat.operator @ Q)
    A = linalg.solve(B, Q.T @ ((heat.operator - heat.stiffness) @ Q), assume_a="sym")
    x = linalg.solve(B, Q.T @ forces, assume_a="sym")
    W = x @ x.T
    for _ in range(steps_of(heat).bit_length()):
        W = W + A @ W @ A.T
        A = A @ A
    values, vectors = np.linalg.eigh(W)
    return np.asarray(Q @ (vectors * np.sqrt(np.maximum(values, 0.0))))
