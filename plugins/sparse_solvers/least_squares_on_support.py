"""Least squares on a support (set of active columns), and how the support is widened and pruned."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from sparsemor.core import BoolArray, FloatArray, Group, IntArray

EPS = float(np.finfo(np.float64).eps)
_BLOCK = 64
"""Working columns of LAPACK's blocked QR factorization."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Linearised residual(c + d) = r + J d, with columns scaled to unit length: z = norms * c.

    J (m, k): unit columns; r (m,): residual; z (k,): scaled coefficients at the linearisation
    point; norms (k,): column norms, 0 for a column of zeros, which stays zero.
    """

    J: FloatArray
    r: FloatArray
    z: FloatArray
    norms: FloatArray

    @classmethod
    def at(cls, c: FloatArray, r: FloatArray, jacobian: FloatArray) -> "Linearised":
        norms = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
        return cls(jacobian / np.where(norms > 0.0, norms, 1.0), r, norms * c, norms)

    def moved(self, c: FloatArray, r: FloatArray) -> "Linearised":
        """The linearisation at other coefficients c with residual r and the same Jacobian."""
        return Linearised(self.J, r, self.norms * c, self.norms)

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.r).all() and np.isfinite(self.norms).all())

    def unscaled(self, z: FloatArray) -> FloatArray:
        return np.asarray(z / np.where(self.norms > 0.0, self.norms, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Least-squares solution on the `active` columns (k,): z (k,), zero elsewhere; residual (m,).

    rcond is the reciprocal condition number of the active unit columns.
    """

    active: BoolArray
    z: FloatArray
    residual: FloatArray
    rcond: float

    @property
    def norm(self) -> float:
        return float(np.linalg.norm(self.residual))

    @property
    def round_off(self) -> float:
        """Residual norm up to which a residual is zero within rounding of its terms."""
        return 100.0 * EPS * float(np.linalg.norm(self.z))


def fit(linear: Linearised, active: BoolArray, rank_rtol: float) -> Fit | None:
    """Least squares on the active columns by QR; None when they are linearly dependent."""
    columns = np.flatnonzero(active)
    A, z, r = linear.J[:, columns], np.zeros(linear.z.size), linear.r
    gone = np.flatnonzero(~active & (linear.z != 0.0))
    if gone.size:
        r = r - linear.J[:, gone] @ linear.z[gone]
    if columns.size == 0:
        return Fit(active, z, r, 1.0)
    if columns.size > A.shape[0]:
        return None
    k = columns.size
    QR, tau, _, _ = lapack.dgeqrf(A, lwork=_BLOCK * k)
    R = QR[:k]
    rcond = float(lapack.dtrcon(R)[0])
    if not rcond > rank_rtol:
        return None
    # the step is solved for, not z: its rounding shrinks as the iteration converges
    turned = lapack.dormqr("L", "T", QR, tau, -r[:, None], _BLOCK)[0][:k, 0]
    step = lapack.dtrtrs(R, turned)[0]
    z[columns] = linear.z[columns] + step
    return Fit(active, z, r + A @ step, rcond)


def widened(
    linear: Linearised, base: Fit, groups: Sequence[Group], growth: int | None
) -> BoolArray:
    """Mask of the active columns and those of each group that correlate most with the residual of
    `base`.

    At most `budget` (or `growth`) new columns per group, in total no more than there are rows.
    """
    correlation = np.abs(base.residual @ linear.J)
    correlation[base.active] = 0.0
    active = base.active.copy()
    wanted = [(g, min(g.budget, growth or g.budget)) for g in groups if g.budget is not None]
    room = linear.J.shape[0] - int(np.count_nonzero(active))
    share = min(1.0, room / max(1, sum(w for _, w in wanted)))
    for g, w in wanted:
        best = np.argsort(-correlation[g.start : g.stop], kind="stable")[: int(share * w)]
        best = best + g.start
        active[best[correlation[best] > 0.0]] = True
    return active


def independent(J: FloatArray, base: BoolArray, wide: BoolArray, rtol: float) -> BoolArray:
    """Mask `wide` without those new columns of J (m, k) that depend on the columns of `base` or, by
    pivoted QR, on each other."""
    added: IntArray = np.flatnonzero(wide & ~base)
    Q = np.linalg.qr(J[:, base])[0]
    new = J[:, added]
    new = new - Q @ (Q.T @ new)
    R, order = linalg.qr(new, mode="r", pivoting=True, check_finite=False)
    enough = np.abs(np.diag(R)) > 100.0 * rtol
    active = base.copy()
    active[added[order[: enough.size][enough]]] = True
    return active


def pruned(z: FloatArray, active: BoolArray, groups: Sequence[Group]) -> BoolArray:
    """Mask of the `budget` active entries of each group that are largest after column scaling."""
    kept = active.copy()
    for g in groups:
        if g.budget is not None:
            part = slice(g.start, g.stop)
            size = np.where(active[part], np.abs(z[part]), -1.0)
            kept[part][np.argsort(-size, kind="stable")[g.budget :]] = False
    return kept


def largest(sizes: FloatArray, count: int) -> BoolArray:
    """Mask (k,) of the `count` largest sizes that are not zero."""
    kept = sizes > 0.0
    if count <= 0:
        kept[:] = False
    elif count < len(sizes):
        kept[sizes.argpartition(len(sizes) - count)[: len(sizes) - count]] = False
    return kept
