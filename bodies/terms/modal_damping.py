"""Modal damping: damping ratios of the lowest elastic modes of a body.

    C = M Phi diag(2 zeta omega) Phi^T M,    Phi^T M Phi = I,    K Phi = M Phi diag(omega^2)

(Craig and Kurdila, Fundamentals of Structural Dynamics, 2nd ed. 2006, sec. 10.3). C is full, and is
kept as the product of M Phi and its factors. Modes that it does not name are not damped. Those of a
free body are orthogonal to its rigid motion: C does no work on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy import linalg
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackNoConvergence, eigsh

from sparsemor.bodies.fem.field_matrices import ModalFactors
from sparsemor.core import Csr, FloatArray, InputError, IntArray, ReducedTerm, Term, Trial

_DENSE = 150
"""Number of unknowns up to which the dense solver is faster than Lanczos."""
EQUAL = 1e-6
"""Relative difference of eigenvalues below which modes have the same frequency."""


def modal_factors(
    K: Csr, M: Csr, held: IntArray, rigid: int, ratio: float | Sequence[float], count: int
) -> ModalFactors:
    """Damping factors of a body with stiffness K and mass M (n, n) of all displacements.

    held: those that are zero in its modes; rigid: number of rigid modes, which come first and are
    not damped; ratio: damping ratios zeta of the elastic modes that follow, or one of `count` of
    them, fewer where the last one has the frequency of the next: of such modes none is a given
    one. InputError for more ratios than modes.
    """
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    K, M, elastic_modes = K[free][:, free], M[free][:, free], len(free) - rigid
    same_ratio = isinstance(ratio, int | float)  # of `count` modes, or as many as there are
    number_of_ratios = count if isinstance(ratio, int | float) else len(ratio)
    if number_of_ratios > elastic_modes and not same_ratio:
        raise InputError(f"gives {number_of_ratios} ratios, and the body has {elastic_modes} "
                         "elastic modes", "ratio")
    # of a common ratio one mode more, to see whether the last ones have the same frequency
    computed = min(number_of_ratios + same_ratio, elastic_modes)
    values, shapes = _lowest(K, M, rigid + computed)
    values, shapes = values[rigid:], shapes[:, rigid:]
    keep = min(number_of_ratios, elastic_modes)
    while same_ratio and 0 < keep < len(values) and (
            values[keep] - values[keep - 1] < EQUAL * values[keep]):
        keep -= 1
    L = np.zeros((len(free) + len(held), keep))
    L[free] = M @ shapes[:, :keep]
    zeta = np.full(keep, ratio) if same_ratio else np.array(ratio, dtype=np.float64)
    return ModalFactors(L, 2.0 * zeta * np.sqrt(np.maximum(values[:keep], 0.0)))


def _lowest(K: Csr, M: Csr, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest eigenvalues (count,), rad^2/s^2, and M-orthonormal eigenvectors (n, count), by
    shift-invert Lanczos with a small negative shift, as K may be singular."""
    n = K.shape[0]
    if n <= _DENSE or 3 * count >= n:
        try:
            values, shapes = linalg.eigh(K.toarray(), M.toarray(), subset_by_index=(0, count - 1))
        except linalg.LinAlgError:
            raise InputError("modes of so few unknowns need a positive definite mass matrix, and "
                             "that of this body is singular", "ratio") from None
        return values, shapes
    shift = -1e-2 * float(K.diagonal().sum() / M.diagonal().sum()) / n
    start = np.random.default_rng([n, count]).standard_normal(n)  # the same modes each time
    try:
        values, shapes = eigsh(K.tocsc(), count, M.tocsc(), sigma=shift, v0=start, tol=0.0)
    except ArpackNoConvergence as error:
        raise InputError(f"{len(error.eigenvalues)} of {count} modes converged: damp fewer modes",
                         "modes") from None
    order = np.argsort(values)
    return values[order], shapes[:, order]


@dataclass(frozen=True, slots=True, eq=False)
class ModalDamping(Term):
    """Damping force U diag(c) V^T v on displacements with rates v, on the left-hand side: U (m, p),
    V (n, p): M phi of p modes in its rows and columns, kg^(1/2), equal before any `restrict`; c
    (p,) = 2 zeta omega, 1/s. rows (m,), columns (n,): positions in the state vector."""

    rows: IntArray
    columns: IntArray
    U: FloatArray
    c: FloatArray
    V: FloatArray
    source: str = ""

    @property
    def damps(self) -> bool:
        return True

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return np.asarray(self.U @ (self.c * (self.V.T @ v)))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array((self.U * self.c) @ (self.V.T * c1))

    def restrict(self, keep: IntArray) -> Self:
        return replace(self, rows=self.rows[keep], U=self.U[keep])

    def compress(self, trial: Trial, left: FloatArray) -> "ReducedDamping":
        return ReducedDamping((left @ self.U * self.c) @ (self.V.T @ trial.atoms), self.source)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedDamping(ReducedTerm):
    """Projected damping force C v, C (l, k), of k reduced unknowns with rates v; c1 (k,): dv = c1
    dx."""

    C: FloatArray
    source: str = ""

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return np.asarray(self.C @ v)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return np.asarray(self.C * c1)
