"""Proper orthogonal decomposition of the snapshots of one body's field (Liang et al. 2026, Eq.
8-12)."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import (
    BlockData,
    Dictionary,
    FloatArray,
    InputError,
    Plugin,
    column_chunks,
    needs_chunks,
    svd,
)
from sparsemor.plugins.bases.blocked_svd import Snapshots, leading, mean
from sparsemor.plugins.bases.inner_product import InnerProduct, Product, inner_product
from sparsemor.plugins.bases.randomized_svd import held, left_singular, round_off_level, weighted
from sparsemor.plugins.bases.time_windows import pooled, share, shares, too_many_windows

SQUARABLE = 300
"""Binary exponent, of either sign, from which snapshots are rescaled before they are squared: 2e90
and 5e-91."""


class Pod(Plugin):
    """Proper orthogonal decomposition: left singular vectors of the snapshots up to their rank.

    Snapshots beyond 256 MB are read by column chunks and decomposed by randomized subspace
    iteration; `count` or `energy` must then limit the number of columns, unless few are above
    round-off. If `energy` and `count` are both given, the one that keeps fewer columns decides. The
    entry of largest magnitude of each atom is positive, so that equal snapshots give equal atoms.
    With `windows`, each time window gets a separate POD with the same options.

    With a `product` of matrix X the atoms are orthogonal in X, and the first k minimise the summed
    squared X-norms of the snapshots' projection errors among all k columns: they are L^-T times the
    left singular vectors of L^T A, where X = L L^T (Volkwein 2013, Proper Orthogonal Decomposition:
    Theory and Reduced-Order Modelling). Like the atoms of every basis, they have length 1 in the
    2-norm.
    """

    energy: float | None = Field(default=None, gt=0.0, le=1.0)
    """Share of the summed squared singular values that the kept columns reach at least; in the
    `product`, as singular values are."""
    count: int | None = Field(default=None, ge=1)
    """Largest number of columns kept."""
    centred: bool = False
    """Subtract the mean of the snapshots first (Eq. 8) and keep it as the dictionary's offset."""
    complete: bool = False
    """Add orthonormal columns beyond the numerical rank until there are n (or `count`) of them, as
    in the n x n basis of Liang et al. 2026. They carry no information about the snapshots."""
    rank_rtol: float | None = Field(default=None, gt=0.0, lt=1.0)
    """Singular value, relative to the largest, below which a column is round-off, in the 2-norm for
    every `product`. Left out: 4 (sqrt n + sqrt M) eps for n unknowns and M snapshots, about
    1e-13."""
    product: Product = "none"
    """Inner product in which atoms are orthogonal and the truncation is optimal. `none`: the
    Euclidean one of the unknowns; `mass`: M, for temperatures the capacity C, so that fine parts of
    a mesh do not count more; `stiffness`: K, for temperatures the conductivity, an energy norm of
    strains or gradients. A stiffness that is singular, as that of an insulated body, gets lambda M
    added, with the lowest positive eigenvalue lambda of K x = lambda M x."""

    weights: Literal["none", "inverse_sqrt_norm"] = "none"
    """`inverse_sqrt_norm` divides each snapshot (less the mean) by the square root of its norm (in
    the `product`), so that small snapshots count more, such as the start of a run from rest."""
    windows: int = Field(default=1, ge=1)
    """Number of equal time windows, each with a separate POD; their atoms are pooled. A moving load
    has few shapes within a short time."""
    tolerance: float = Field(default=1e-6, ge=0.0, lt=1.0)
    """Atoms of different windows are merged when the sine of the (Euclidean) angle between them is
    at most this. The first stays, and its name lists those it absorbed."""

    @model_validator(mode="after")
    def _one_purpose(self) -> Self:
        if self.windows > 1 and self.complete:
            raise ValueError("complete fills one orthonormal basis, and windows make several: "
                             "give one of them")
        if self.complete and self.product != "none":
            raise ValueError("complete fills a basis that is orthonormal in the 2-norm, and product"
                             " asks for another one: give one of them")
        if self.complete and self.energy is not None:
            raise ValueError("energy drops columns and complete puts them back: give one of them")
        return self

    @property
    def needs_snapshots(self) -> bool:
        return True

    def most_atoms(self, size: int) -> int | None:
        """Upper bound on the number of atoms for `size` unknowns; None: no bound is known."""
        return None if self.count is None else self.windows * min(self.count, size)

    def unfit(self, data: BlockData, snapshots: int) -> str:
        """Reason why a block cannot be decomposed (more windows than snapshots); "" if it can."""
        return "" if self.windows <= snapshots else (
            too_many_windows(self.windows, snapshots, data.name))

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k). Raises InputError for snapshots that are absent, not finite
        or all 0."""
        A = _checked(data)
        offset = mean(A) if self.centred else np.zeros(len(A))
        product = inner_product(data, self.product)
        if self.windows == 1:
            return self._decomposed(data.name, A, offset, product)
        one = self.model_copy(update={"windows": 1})
        return pooled(
            lambda part: one._decomposed(data.name, part, offset, product),
            A, offset, product, self.windows, self.tolerance, data.name)

    def _decomposed(
        self, block: str, A: FloatArray, offset: FloatArray, product: InnerProduct
    ) -> Dictionary:
        """POD dictionary of the snapshots A (n, M) about `offset` (n,)."""
        if needs_chunks(A):
            return self._by_chunks(block, A, offset, product)
        n, M = A.shape
        A, about = _squarable(A, offset)
        plain = A - about[:, None] if self.centred else A
        varying = plain if self.weights == "none" else weighted(plain, product.norms(plain))
        level = self.rank_rtol or round_off_level(n, M)
        U, s = left_singular(varying, level)
        # A A^T = varying varying^T + M mean mean^T: rounding is relative to what was stored
        stored = float(np.sqrt(M) * np.linalg.norm(about))
        if stored and varying is not plain:  # in the weighted columns, too
            stored *= float(np.linalg.norm(varying)) / max(float(np.linalg.norm(plain)), 1e-300)
        largest = max(float(s[0]), stored)
        rank = int(np.count_nonzero(s > level * largest))
        if rank == 0:
            raise _nothing_left(block, M)
        why = _round_off_cut(s, rank)
        if not product.euclidean:
            U, s = product.singular(U[:, :rank], s[:rank])
        total = product.norm(varying) ** 2
        kept, cut = self._cut(s, rank, total, 0.0, why)
        if product.euclidean and varying is plain:
            energies = {"energy": min(1.0, float(s[:kept] @ s[:kept]) / total)}
        else:
            energies = shares(lambda Q, used: held(plain, Q, used), U[:, :kept], product)
        atoms = self._completed(U[:, :kept]) if self.complete else U[:, :kept]
        names = [f"pod {i}" for i in range(kept)]
        names += [f"completion {i}" for i in range(atoms.shape[1] - kept)]
        return Dictionary(_unit(atoms, product), offset, tuple(names), {
            "numerical_rank": rank,
            "kept": kept,
            "completed": atoms.shape[1] - kept,
            **energies,
            "last_singular_value": float(s[kept - 1] / s[0]),
            "snapshots": M,
            "rank_rtol": level,
            "cut": cut,
        })

    def _by_chunks(
        self, block: str, A: FloatArray, offset: FloatArray, product: InnerProduct
    ) -> Dictionary:
        """POD dictionary of snapshots that are too large to hold in memory: leading columns
        only."""
        n, M = A.shape
        snapshots = Snapshots.of(A, offset, self.weights != "none", product)
        level = self.rank_rtol or round_off_level(n, M)
        found = leading(snapshots, self.count, self.energy, level)
        if found is None:
            raise InputError(
                f"{8 * n * M / 1e9:.2g} GB of snapshots of {block} are decomposed by parts, and "
                f"more than a third of {M} columns are requested: limit their number by count or "
                "energy", "count" if self.energy is None else "energy")
        U, s = found.U, found.values
        if not 0.0 < snapshots.total < np.inf:
            raise InputError(
                f"the snapshots of {block} are so large or small (largest singular value "
                f"{float(s[0]):.3g}) that their squares are no numbers: take other units")
        stored = float(np.sqrt(M) * np.linalg.norm(offset))
        beyond = 0.0 if found.complete else max(snapshots.total - float(s @ s), 0.0)
        if not product.euclidean:
            U, s, _ = svd(U * s)  # round-off is judged in the 2-norm
        rank = int(np.count_nonzero(s > level * max(float(s[0]), stored)))
        if rank == 0:
            raise _nothing_left(block, M)
        why = _round_off_cut(s, rank)
        if not product.euclidean:
            U, s = product.singular(U[:, :rank], s[:rank])
        kept, cut = self._cut(s, rank, snapshots.total, beyond, why)
        if product.euclidean:
            energies = {"energy": min(1.0, float(s[:kept] @ s[:kept]) / snapshots.total)}
        else:
            energies = shares(
                lambda Q, used: share(A, offset, Q, used), U[:, :kept], product)
        atoms = self._completed(U[:, :kept]) if self.complete else U[:, :kept]
        names = [f"pod {i}" for i in range(kept)]
        names += [f"completion {i}" for i in range(atoms.shape[1] - kept)]
        return Dictionary(_unit(atoms, product), offset, tuple(names), {
            "numerical_rank" if found.complete else "rank_at_least": rank,
            "kept": kept, "completed": atoms.shape[1] - kept, **energies,
            "last_singular_value": float(s[kept - 1] / s[0]), "snapshots": M, "rank_rtol": level,
            "cut": cut, "passes": found.passes})

    def _cut(
        self, s: FloatArray, rank: int, total: float, beyond: float, why: str
    ) -> tuple[int, str]:
        """Number of columns to keep, and the option or limit that decided it.

        s: singular values; rank: numerical rank; total: squared norm of the snapshots; beyond: the
        part of it in singular vectors that were not computed; why: reason for the rank.
        """
        kept, cut = rank, why
        if self.energy is not None:
            rest = np.append(np.cumsum((s * s)[::-1])[::-1][1:], 0.0) + beyond  # after column i
            enough = np.flatnonzero(rest <= (1.0 - self.energy) * total)
            if enough.size and enough[0] + 1 < kept:
                kept, cut = int(enough[0]) + 1, "energy"
        if self.count is not None and self.count < kept:
            kept, cut = self.count, "count"
        return kept, cut

    def _completed(self, U: FloatArray) -> FloatArray:
        wanted = min(U.shape[0], self.count or U.shape[0])
        # like the singular vectors of round-off that they stand for, without any order: a QR of U
        # alone would complete it by near unit vectors, of which sampled rows see nothing
        rng = np.random.default_rng([U.shape[0], wanted])
        rest = rng.standard_normal((U.shape[0], wanted - U.shape[1]))
        for _ in range(2):  # once leaves what cancellation brings back
            rest -= U @ (U.T @ rest)
        return np.hstack([U, np.linalg.qr(rest)[0]])


def _squarable(A: FloatArray, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Snapshots (n, M) and offset (n,), scaled by a power of two where squares would overflow or
    underflow; this changes no digit of the atoms."""
    largest = max(float(A.max()), -float(A.min()))
    exponent = int(np.frexp(largest)[1])
    if abs(exponent) < SQUARABLE:
        return A, offset
    return np.ldexp(A, -exponent), np.ldexp(offset, -exponent)


def _round_off_cut(s: FloatArray, rank: int) -> str:
    """Reason why `rank` of the columns with Euclidean singular values s are kept at most."""
    if rank == s.size:
        return "none: every column is above round-off"
    return f"the other columns are round-off: below {s[0]:.3g} x rank_rtol"


def _unit(U: FloatArray, product: InnerProduct) -> FloatArray:
    """Columns of U (n, k) of unit length whose entry of largest magnitude is positive."""
    if not product.euclidean:
        U = U / np.linalg.norm(U, axis=0)
    return np.ascontiguousarray(U * _signs(U))


def _nothing_left(block: str, M: int) -> InputError:
    return InputError(
        f"the {M} snapshots of {block} do not differ from their mean by more than "
        "round-off: nothing is left to decompose; set centred: false or train with a load")


def _checked(data: BlockData) -> FloatArray:
    A = data.snapshots
    if A.size == 0:
        raise InputError(
            f"pod has no snapshots of {data.name} (shape {A.shape}): give the scene a training "
            "run, or use a basis that needs none"
        )
    finite = np.concatenate([np.isfinite(part).all(axis=0) for _, part in column_chunks(A)])
    if not finite.all():
        bad = int(np.flatnonzero(~finite)[0])
        raise InputError(
            f"snapshot {bad} of {data.name} has values that are not finite: the training run "
            "failed there; repeat it with a smaller time.step"
        )
    if not any(part.any() for _, part in column_chunks(A)):
        raise InputError(
            f"all {A.shape[1]} snapshots of {data.name} are zero: nothing moved or heated it in "
            "the training run; add a load there, or leave this block out of the budgets"
        )
    return A


def _signs(U: FloatArray) -> FloatArray:
    peak = U[np.abs(U).argmax(axis=0), np.arange(U.shape[1])]
    return np.where(peak < 0.0, -1.0, 1.0)
