"""Rows of D^-1: with them a few sampled rows see the whole residual, smoothed as solutions are."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.offline import Offline
from sparsemor.reducers.factor import factorize

_CHUNK = 256
"""Right-hand sides solved at once."""


def inverse_rows(
    offline: Offline | None, name: str, operator: Csr, rows: IntArray
) -> FloatArray:
    """(m, n): the rows number `rows` (m,) of the inverse of a block's operator (n, n).

    As many solves with its transpose as there are rows; cached, if there is an `offline`.
    """
    def make() -> Mapping[str, FloatArray]:
        factor, n = factorize(operator), operator.shape[0]
        left = np.empty((len(rows), n))
        for first in range(0, len(rows), _CHUNK):
            part = rows[first : first + _CHUNK]
            units = np.zeros((n, len(part)))
            units[part, np.arange(len(part))] = 1.0
            left[first : first + _CHUNK] = factor.solve(units, "T").T
        return {"left": left}

    made = make() if offline is None else offline.remember(
        "inverse rows", (name, operator, rows), make)
    return np.asarray(made["left"], dtype=np.float64)
