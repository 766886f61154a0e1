"""Responses of one block to its load tables."""

import numpy as np

from sparsemor.core import BlockData, FloatArray
from sparsemor.plugins.bases.response_compression import steps_of
from sparsemor.plugins.bases.static_response import factorize, is_thermal


def tabled_responses(data: BlockData) -> FloatArray:
    """Responses (n, N) of a block at rest to its load tables, at their N steps h, 2 h, ...

    Implicit Euler: (K + D/h + M/h^2) x_n = f_n + D x_(n-1)/h + M (2 x_(n-1) - x_(n-2))/h^2, with
    damping D, for displacements; (K_T + C/h) x_n = f_n + C x_(n-1)/h for temperatures. f_n: loads
    of the tables; for displacements also those of the temperatures that the tables cause.
    """
    h, n = data.step, data.size
    X = np.zeros((n, steps_of(data)))
    if not is_thermal(data) and data.heat is not None and data.coupling is not None and (
            data.heat.moving):
        X = np.asarray(data.coupling @ tabled_responses(data.heat))
    for load in data.moving:
        times = load.table.times[0] + h * np.arange(1, X.shape[1] + 1)
        X += load.columns @ load.table.along(times).T
    if is_thermal(data):
        last, before = data.mass / h, None
    else:
        before = data.mass / -h**2
        last = -2.0 * before if data.damping is None else data.damping / h - 2.0 * before
    operator = data.stiffness + last
    factor = factorize(operator if before is None else operator + before, data)
    x = older = np.zeros(n)
    for j in range(X.shape[1]):
        f = X[:, j] + last @ x
        if before is not None:
            f += before @ older
        x, older = factor.solve(f), x
        X[:, j] = x
    return X
