"""Lowest eigenmodes of K x = lambda M x, free or under the constraint P^T x = 0."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from sparsemor.core import BlockData, Csr, FloatArray, InputError
from sparsemor.plugins.bases.static_response import factorize

_DENSE = 150
"""Number of unknowns up to which the dense solver is faster than Lanczos."""


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Eigenvalues (k,), increasing (rad^2/s^2 for displacements, 1/s for temperatures), and
    eigenvectors `shapes` (n, k) with shapes^T M shapes = I."""

    values: FloatArray
    shapes: FloatArray


def lowest_modes(data: BlockData, count: int, held: FloatArray | None = None) -> Modes:
    """Lowest eigenmodes, at most `count`; with independent columns P (n, p) in `held`, under P^T x
    = 0.

    Shift-invert Lanczos with a small negative shift, so that the singular K of an insulated body is
    no special case. With P, the inverse is that of the bordered matrix: A^-1 less its part along
    A^-1 P. It is symmetric and its range satisfies P^T x = 0, so all Lanczos vectors do.
    """
    n, K, M = data.size, data.stiffness, data.mass
    p = 0 if held is None else held.shape[1]
    count = min(count, n - p)
    if count == 0:
        return Modes(np.zeros(0), np.zeros((n, 0)))
    if n <= _DENSE or 3 * count >= n:
        return _dense(K, M, count, held)
    # about the lowest rate of conduction; far below what would spoil the lowest vibrations
    shift = -1e-2 * float(K.diagonal().sum() / M.diagonal().sum()) / n
    factor = factorize(K - shift * M, data)
    inverse = LinearOperator((n, n), matvec=_held_inverse(factor, held), dtype=np.float64)
    start = np.random.default_rng([n, count]).standard_normal(n)  # fixed: the same modes each time
    if held is not None:
        start = inverse @ (M @ start)
    try:
        values, shapes = eigsh(K, count, M, sigma=shift, OPinv=inverse, v0=start, tol=0.0)
    except ArpackNoConvergence as error:
        raise InputError(
            f"{len(error.eigenvalues)} of {count} eigenmodes of {data.name} converged: ask for "
            "fewer modes") from None
    order = np.argsort(values)
    return Modes(values[order], shapes[:, order])


def _held_inverse(
    factor: Any, held: FloatArray | None
) -> Callable[[FloatArray], FloatArray]:
    if held is None:
        return lambda b: np.asarray(factor.solve(np.ravel(b)))
    reached = factor.solve(np.ascontiguousarray(held))
    compliance = linalg.cho_factor(held.T @ reached)

    def solve(b: FloatArray) -> FloatArray:
        b = np.ravel(b)
        x = factor.solve(b)
        return np.asarray(x - reached @ linalg.cho_solve(compliance, held.T @ x))

    return solve


def _dense(K: Csr, M: Csr, count: int, held: FloatArray | None) -> Modes:
    if held is None:
        values, shapes = linalg.eigh(K.toarray(), M.toarray(), subset_by_index=(0, count - 1))
        return Modes(values, shapes)
    Z = linalg.null_space(held.T)
    values, c = linalg.eigh(Z.T @ (K @ Z), Z.T @ (M @ Z), subset_by_index=(0, count - 1))
    return Modes(values, Z @ c)
