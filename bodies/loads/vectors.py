"""Vectors with as many components as a body has dimensions."""

from collections.abc import Sequence

import numpy as np

from sparsemor.core import Body, FloatArray, InputError

Vector = tuple[float, float] | tuple[float, float, float]


def components(body: Body, vector: Sequence[float], key: str) -> FloatArray:
    """(d,) array of a vector; InputError if its number of components differs from the body's
    dimension."""
    if len(vector) != body.d:
        where = "in space: give three components" if body.d == 3 else "plane: give two components"
        raise InputError(f"body {body.name!r} is {where} (got {list(vector)})", key)
    return np.array(vector, dtype=np.float64)
