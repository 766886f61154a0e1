"""Iterations over supports (sets of active columns): least squares on a support, how it is widened
and pruned, initial iterate, stopping test, outcome, cycles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from sparsemor.core import (
    BoolArray,
    FloatArray,
    Group,
    IntArray,
    SparseOutcome,
    SparseProblem,
    SparseStart,
    Status,
)

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

    z are coefficients of unit columns, and residual is r + J (z - its z), as in `Linearised`; rcond
    is the reciprocal condition number of the active columns.
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
    """Least squares of r + J (z - z_0) on the active columns by QR, with the unit columns J (m, k),
    residual r and scaled coefficients z_0 of the linearisation; None when they are linearly
    dependent: their reciprocal condition number is at most `rank_rtol`."""
    columns = np.flatnonzero(active)
    A, z, r = linear.J[:, columns], np.zeros(linear.z.size), linear.r
    gone = np.flatnonzero(~active & (linear.z != 0.0))  # coefficients that become zero
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

    At most `budget` (or `growth`, if it is smaller) new columns per group; with the active ones, no
    more than there are rows.
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
    pivoted QR, on each other: whose part outside their space is at most 100 rtol."""
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


def always_active(groups: Sequence[Group], size: int) -> BoolArray:
    """Mask (k,), True in the groups without a budget, whose columns are always active."""
    always = np.zeros(size, dtype=np.bool_)
    for g in groups:
        if g.budget is None:
            always[g.start : g.stop] = True
    return always


def within_budget(problem: SparseProblem, start: SparseStart) -> tuple[FloatArray, BoolArray]:
    """Initial coefficients and support, zero outside the support and with no more active columns
    than the budgets allow."""
    groups = problem.groups
    support = start.support | always_active(groups, start.c.size)
    c = np.where(support, start.c, 0.0)
    if any(g.budget is not None and support[g.start : g.stop].sum() > g.budget for g in groups):
        norms = np.linalg.norm(problem.jacobian(c), axis=0)
        support = pruned(norms * c, support, groups)
        c = np.where(support, c, 0.0)
    return c, support


def small_step(linear: Linearised, found: Fit, groups: Sequence[Group], rtol: float) -> bool:
    """True if the step of every group is within `rtol` of the group's norm, or within rounding
    errors."""
    step = found.z - linear.z
    # rounding of the solve is amplified by the condition number of the active columns
    floor = min(4.0 * EPS / found.rcond, rtol) * float(np.linalg.norm(found.z))
    return all(
        float(np.linalg.norm(step[g.start : g.stop]))
        <= max(rtol * float(np.linalg.norm(found.z[g.start : g.stop])), floor)
        for g in groups
    )


def ended(
    problem: SparseProblem, c: FloatArray, good: SparseOutcome, status: Status, iterations: int
) -> SparseOutcome:
    """Outcome at the coefficients c with their residual norm; if that overflowed, `good` with
    status NOT_FINITE."""
    norm = float(np.linalg.norm(problem.residual(c)))
    if not np.isfinite(norm):
        return replace(good, status=Status.NOT_FINITE, iterations=iterations)
    return SparseOutcome(c, good.support, status, iterations, norm)


class Visits:
    """Supports visited during one solve, and the best iterate on each."""

    def __init__(self) -> None:
        self._best: dict[bytes, SparseOutcome] = {}
        self._last = b""

    def note(self, iterate: SparseOutcome) -> bool:
        """Records an iterate; True when its support was left before and has returned."""
        key = iterate.support.tobytes()
        cycle = key in self._best and key != self._last
        if key not in self._best or iterate.residual_norm < self._best[key].residual_norm:
            self._best[key] = iterate
        self._last = key
        return cycle

    def best(self) -> SparseOutcome:
        """Recorded iterate of least residual norm."""
        return min(self._best.values(), key=lambda iterate: iterate.residual_norm)
