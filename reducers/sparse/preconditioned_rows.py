"""Rows of D^-1: with them a few sampled rows see the whole residual, smoothed as solutions are."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import AssembledModel, Csr, FloatArray, IntArray, OfflineProducts
from sparsemor.core.model.factorizations import solved

_CHUNK = 256
"""Right-hand sides solved at once."""


def inverse_rows(
    model: AssembledModel, offline: OfflineProducts | None, name: str, operator: Csr, rows: IntArray
) -> FloatArray:
    """(m, n): the rows number `rows` (m,) of the inverse of a block's symmetric operator (n, n).

    As many solves as there are rows; cached, if there is an `offline`.
    """
    def make() -> Mapping[str, FloatArray]:
        factor, n = model.factorize(name, operator, "rows of the inverse"), operator.shape[0]
        left = np.empty((len(rows), n))
        for first in range(0, len(rows), _CHUNK):
            part = rows[first : first + _CHUNK]
            units = np.zeros((n, len(part)))
            units[part, np.arange(len(part))] = 1.0
            left[first : first + _CHUNK] = solved(factor, units, name).T
        return {"left": left}

    made = make() if offline is None else offline.remember(
        "inverse rows", (name, operator, rows, model.solvers.of(name)), make)
    return np.asarray(made["left"], dtype=np.float64)
