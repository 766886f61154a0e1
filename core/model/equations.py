"""Residual and Jacobian of the whole model as sums of residual terms."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array, csc_array

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.protocols import Term
from sparsemor.core.protocols.layout import Layout


def system_residual(
    layout: Layout, terms: Sequence[Term], x: FloatArray, v: FloatArray, a: FloatArray, t: float
) -> FloatArray:
    """Residual (n,) of the whole model."""
    r = np.zeros(layout.size)
    for term in terms:
        j = term.columns
        np.add.at(r, term.rows, term.residual(x[j], v[j], a[j], t))
    return r


def system_jacobian(
    layout: Layout, terms: Sequence[Term], x: FloatArray, v: FloatArray, a: FloatArray, t: float,
    c1: FloatArray, c2: FloatArray,
) -> Csr:
    """Jacobian (n, n), csc, of the whole model, with dv = c1 dx and da = c2 dx; c1, c2 (n,)."""
    rows, columns, values = [], [], []
    for term in terms:
        j = term.columns
        J = coo_array(term.jacobian(x[j], v[j], a[j], t, c1[j], c2[j]))
        # short numbers: this is what takes most memory at the start of a large run
        rows.append(term.rows.astype(np.int32)[J.row])
        columns.append(j.astype(np.int32)[J.col])
        values.append(J.data)
    n = layout.size
    places = np.concatenate(rows), np.concatenate(columns)
    return csc_array((np.concatenate(values), places), shape=(n, n))


def rate_factors(
    layout: Layout, c1: float, c2: float, c1_first: float
) -> tuple[FloatArray, FloatArray]:
    """Factors c1, c2 (n,) of dv = c1 dx, da = c2 dx for each unknown; those of first-order unknowns
    are c1_first and 0, those of algebraic ones 0."""
    k1, k2 = np.zeros(layout.size), np.zeros(layout.size)
    k1[layout.second], k1[layout.first], k2[layout.second] = c1, c1_first, c2
    return k1, k2
