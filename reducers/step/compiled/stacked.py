"""Arrays of all bodies from those of each, and their working arrays (arrays.py)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.reducers.step.compiled.arrays import BodyArrays, MechanicsWork


def array(values: FloatArray) -> FloatArray:
    """A contiguous array that may be written to."""
    return np.array(values, dtype=np.float64, order="C")


def number(i: int) -> IntArray:
    """An integer as an array without dimensions."""
    return np.array(i, dtype=np.int64)


def by_four(A: FloatArray) -> FloatArray:
    """A with rows of zeros up to a number that is a multiple of 4."""
    return array(np.pad(A, ((0, -len(A) % 4), (0, 0))))


_NONE, _EMPTY, _ZERO = np.zeros(0, dtype=np.int64), np.zeros((0, 0)), number(0)
NO_BODY = BodyArrays(
    items=_ZERO, kinds=_NONE, numbers=_EMPTY, starts=np.zeros((0, 3), dtype=np.int64), gains=_NONE,
    entries=_ZERO, rows=_NONE, columns=_NONE, values=np.zeros(0), origin=np.zeros(0),
    guide=number(-1), rigid=_ZERO, positions=_ZERO, u=_ZERO, k=_ZERO, s=_ZERO, active=_NONE,
    idle=_NONE, T=_ZERO, kt=_ZERO, g=_ZERO, p=_ZERO,
    inputs=_ZERO, H=_EMPTY, base=np.zeros(0), j=_ZERO, products=_EMPTY, step_products=_EMPTY,
    E=_EMPTY, G=_EMPTY, amplitude=number(-1), table=number(-1))
"""A rigid body without contributions to its frame."""


def stacked(bodies: Sequence[BodyArrays]) -> BodyArrays:
    """Arrays of all bodies from those of each."""
    made = []
    for values in zip(*(bodies or (NO_BODY,)), strict=True):
        sizes = np.array([v.shape for v in values], dtype=np.int64)
        out = np.zeros((len(values), *sizes.max(axis=0)), dtype=values[0].dtype)
        for i, v in enumerate(values):
            at: tuple[Any, ...] = (i, *map(slice, v.shape))
            out[at] = v
        made.append(out[: len(bodies)])
    return BodyArrays(*made)


def work_of(b: BodyArrays, border: int) -> MechanicsWork:
    """Working arrays for bodies in a model with this many border unknowns."""
    (count, n), p, (s, w) = b.origin.shape, b.G.shape[1], (b.active.shape[1], b.base.shape[1])
    q, g = b.products.shape[2], max([*b.g.tolist(), 0])
    inputs = max([*(3 * b.k + b.kt + b.j).tolist(), 0])
    each = {
        "sigma": (n + 1, p), "tau": (n, p), "border": (n, n + 1), "coefficients": (2 * g + 1,),
        "s": (3, p), "forms": (3 * g,), "gains": (b.kinds.shape[1],), "pose": (3, n),
        "now": (3, n), "inputs": (inputs + 4,), "past": (3, q), "change": (q,), "h": (w,),
        "z": (w,), "u": (s,), "d": (b.step_products.shape[1],), "Gs": (p, n + 1),
        "reduced": (n, n + 1), "scale": (), "distance": (), "elastic": ()}
    of_all = {
        "nothing": (3, 0), "changes": (count + 1,), "before": (count + 1,), "A": (border, border),
        "dy": (border,), "delta": (border,), "predicted": (border,), "sums": (320,)}
    return MechanicsWork(**{name: np.zeros((count, *shape)) for name, shape in each.items()},
                         **{name: np.zeros(shape) for name, shape in of_all.items()})
