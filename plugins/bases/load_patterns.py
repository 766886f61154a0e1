"""Unit loads along the path of loads that move: one a point of the surface, or one a patch."""

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import (
    BlockData,
    Csr,
    FloatArray,
    InputError,
    IntArray,
    distinct_names,
    loaded_columns,
)

AXES = "xyz"


def unit_loads(data: BlockData, patches: int | None) -> tuple[FloatArray, list[str]]:
    """F (n, q) and what each column is ("sole, node 12, x"): the columns of the moving loads that
    act at some time, or `patches` combinations of those of each load and direction.

    Patches in the plane are hats of equal distance along the path; on a surface in space, the
    points nearest to centres that are far from each other.
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
    """F (n, q) and names: at most `count` loads for each moving load, the largest singular vectors
    of what its table says at all its times, each as large as it is there (root of mean square).

    A load that covers many nodes at once has a shape that unit loads do not know: its sums are few.
    """
    columns, names = [np.zeros((data.size, 0))], list[str]()
    for load in data.moving:
        V = load.table.values
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
    """Unit loads, or with `tabled` loads as the tables have them."""
    return unit_loads(data, patches) if tabled is None else tabled_loads(data, tabled)


def refuse_both(points: int | None, tabled: int | None, option: str) -> None:
    """InputError where unit loads and tabled ones are asked for at once."""
    if points is not None and tabled is not None:
        raise InputError(f"give {option} (unit loads at positions) or tabled (loads as tabulated), "
                         "not both", "tabled")


def refuse_nowhere(data: BlockData, who: str) -> InputError:
    """Error for a block over which no load moves."""
    return InputError(
        f"{who}: no load moves over {data.name}, so it has no such response; give this block "
        "another basis under reducer.bases, such as static")


def known_step(data: BlockData, who: str) -> None:
    """InputError where the data come without the step that dynamic responses are made for."""
    if not any(data.factors):
        raise InputError(f"{who}: the time step that {data.name} is reduced for is missing: pass "
                         "it to model.block_data(name, step=...)")


def _patched(
    data: BlockData, columns: Csr, source: str, count: int
) -> tuple[Csr, list[str]]:
    """`count` combinations of the columns (n, j) of each direction, fewer where it has fewer."""
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
    """(j, q), rows that sum to 1, for points (j, d): how much of each belongs to each patch."""
    j = len(points)
    if count >= j:
        return np.eye(j)
    if points.shape[1] == 3:
        centres = _far_apart(points, count)
        nearest = np.linalg.norm(points[:, None] - points[centres], axis=2).argmin(axis=1)
        return np.asarray(nearest[:, None] == np.arange(count), dtype=np.float64)
    order = _chain(points)
    along = np.zeros(j)
    along[order[1:]] = np.cumsum(np.linalg.norm(np.diff(points[order], axis=0), axis=1))
    centres_at = np.linspace(0.0, along.max(), count)
    return np.stack([np.interp(along, centres_at, hat) for hat in np.eye(count)], axis=1)


def _chain(points: FloatArray) -> IntArray:
    """The points in the order of a line through them: each time the nearest that is left."""
    start = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
    left, order = np.ones(len(points), dtype=bool), [start]
    left[start] = False
    while left.any():
        away = np.where(left, np.linalg.norm(points - points[order[-1]], axis=1), np.inf)
        order.append(int(away.argmin()))
        left[order[-1]] = False
    return np.array(order, dtype=np.int64)


def _far_apart(points: FloatArray, count: int) -> IntArray:
    """Numbers of `count` points, each the farthest from those before it."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    away = np.full(len(points), np.inf)
    while len(chosen) < count:
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(away.argmax()))
    return np.array(chosen, dtype=np.int64)
