"""Proper orthogonal decomposition of the snapshots of one body's field (Liang et al. 2026, Eq.
8-12)."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import Basis, BlockData, Dictionary, FloatArray, InputError
from sparsemor.core.linalg.dense import svd
from sparsemor.core.linalg.snapshots import column_chunks, needs_chunks
from sparsemor.plugins.bases.snapshot_svd import (
    LeadingVectors,
    ScaledSnapshots,
    column_mean,
    leading_vectors,
    left_singular,
    round_off_level,
)


class Pod(Basis):
    """Proper orthogonal decomposition: left singular vectors of the snapshots up to their rank.

    Snapshots beyond 256 MB are read by column chunks and decomposed by randomized subspace
    iteration; `count` or `energy` must then limit the number of columns, unless few are above
    round-off. If `energy` and `count` are both given, the one that keeps fewer columns decides. The
    entry of largest magnitude of each atom is positive, so that equal snapshots give equal atoms.
    """

    energy: float | None = Field(default=None, gt=0.0, le=1.0)
    """Share of the summed squared singular values that the kept columns reach at least."""
    count: int | None = Field(default=None, ge=1)
    """Largest number of columns kept."""
    centred: bool = False
    """Subtract the mean of the snapshots first (Eq. 8) and keep it as the dictionary's offset."""
    complete: bool = False
    """Add orthonormal columns beyond the numerical rank until there are n (or `count`) of them, as
    in the n x n basis of Liang et al. 2026. They carry no information about the snapshots."""
    weights: Literal["none", "inverse_sqrt_norm"] = "none"
    """`inverse_sqrt_norm` divides each snapshot (less the mean) by the square root of its norm, so
    that small snapshots count more, such as the start of a run from rest."""

    window: int | None = Field(default=None, ge=1)
    """Decompose successive parts of the training run, of so many snapshots each: what the atoms of
    the parts before leave of them, down to `tolerance`. All atoms are orthonormal. Where a source
    travels over a body a state needs those of few parts, which `sparse` selects in each step; the
    leading vectors of the whole run spread over the path, and a state needs them all."""
    tolerance: float = Field(default=1e-4, gt=0.0, lt=1.0)
    """Of `window`: singular value, relative to the largest norm of a snapshot, down to which
    vectors of a part are kept."""

    @model_validator(mode="after")
    def _one_purpose(self) -> Self:
        others = {"energy": self.energy is not None, "count": self.count is not None,
                  "centred": self.centred, "complete": self.complete,
                  "weights": self.weights != "none"}
        given = [name for name, is_given in others.items() if is_given]
        if self.window is not None and given:
            raise ValueError(
                f"tolerance alone decides on the atoms of a window: leave out {given[0]}")
        if self.complete and self.energy is not None:
            raise ValueError("energy drops columns and complete puts them back: give one of them")
        return self

    @property
    def needs_snapshots(self) -> bool:
        return True

    @property
    def has_offset(self) -> bool:
        return self.centred

    def most_atoms(self, size: int) -> int | None:
        """Upper bound on the number of atoms for `size` unknowns; None: no bound is known."""
        return None if self.count is None else min(self.count, size)

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k). Raises InputError for snapshots that are absent, not finite
        or all 0.

        snapshots: less the offset, divided by their weights, as they are decomposed; plain: the
        same without weights, in which the share of energy is reported.
        """
        A = _checked(data)
        if self.window is not None:
            return self._by_windows(data.name, A, self.window)
        n, M = A.shape
        offset = column_mean(A) if self.centred else np.zeros(n)
        weighted = self.weights != "none"
        snapshots = ScaledSnapshots.from_snapshots(A, offset, weighted)
        plain = snapshots if not weighted else ScaledSnapshots.from_snapshots(
            A, offset, weighted=False)
        if plain.total == 0.0 and self.centred:
            raise _nothing_left(data.name, M)
        if not 0.0 < plain.total < np.inf:
            raise _beyond_numbers(data.name)
        found = self._leading(data.name, snapshots)
        U, s, level = found.U, found.values, round_off_level(n, M)
        # A A^T = V V^T + M mean mean^T for varying parts V: rounding is relative to what was stored
        stored = float(np.sqrt(M) * np.linalg.norm(offset))
        if stored and weighted:  # in the weighted columns, too
            stored *= float(np.sqrt(snapshots.total / plain.total))
        rank = int(np.count_nonzero(s > level * max(float(s[0]), stored)))
        if rank == 0:
            raise _nothing_left(data.name, M)
        kept, cut = self._cut(s, rank, snapshots.total, found.complete)
        energy = plain.share(U[:, :kept]) if weighted else (
            min(1.0, float(s[:kept] @ s[:kept]) / snapshots.total))
        atoms = self._completed(U[:, :kept]) if self.complete else U[:, :kept]
        names = [f"pod {i}" for i in range(kept)]
        names += [f"completion {i}" for i in range(atoms.shape[1] - kept)]
        return Dictionary(_oriented(atoms), offset, tuple(names), {
            "numerical_rank" if found.complete else "rank_at_least": rank,
            "kept": kept,
            "completed": atoms.shape[1] - kept,
            "energy": energy,
            "last_singular_value": float(s[kept - 1] / s[0]),
            "snapshots": M,
            "rank_rtol": level,
            "cut": cut,
        } | ({"passes": found.passes} if found.passes else {}))

    def _by_windows(self, name: str, A: FloatArray, window: int) -> Dictionary:
        """Orthonormal atoms (n, k) of successive parts of the snapshots A (n, M)."""
        n, M = A.shape
        Q, names = np.zeros((n, 0)), list[str]()
        size = max(float(np.linalg.norm(part, axis=0).max()) for _, part in column_chunks(A))
        if not 0.0 < size < np.inf:
            raise _beyond_numbers(name)
        for number, first in enumerate(range(0, M, window)):
            part = np.array(A[:, first : first + window])
            for _ in range(2):  # once leaves what cancellation brings back
                part -= Q @ (Q.T @ part)
            U, s, _ = svd(part)
            kept = int(np.count_nonzero(s > self.tolerance * size))
            # orthogonal to Q up to rounding of `part`, which its small singular values magnify
            U = U[:, :kept] - Q @ (Q.T @ U[:, :kept])
            Q = np.hstack([Q, np.linalg.qr(U)[0]])
            names += [f"window {number}, pod {i}" for i in range(kept)]
        return Dictionary(_oriented(Q), np.zeros(n), tuple(names), {
            "kept": len(names), "snapshots": M, "windows": number + 1})

    def _leading(self, block: str, snapshots: ScaledSnapshots) -> LeadingVectors:
        """Singular vectors of the scaled snapshots: all above round-off, or the leading ones of
        those that are too large to hold in memory."""
        n, M = snapshots.A.shape
        if not needs_chunks(snapshots.A):
            U, s = left_singular(snapshots.in_memory(), round_off_level(n, M))
            return LeadingVectors(U, s, complete=True, passes=0)
        found = leading_vectors(snapshots, self.count, self.energy)
        if found is None:
            raise InputError(
                f"{8 * n * M / 1e9:.2g} GB of snapshots of {block} are decomposed by parts, and "
                f"more than a third of {M} columns are requested: limit their number by count or "
                "energy", "count" if self.energy is None else "energy")
        return found

    def _cut(self, s: FloatArray, rank: int, total: float, complete: bool) -> tuple[int, str]:
        """Number of columns to keep, and the option or limit that decided it.

        s: singular values; rank: numerical rank; total: squared norm of the snapshots; complete: s
        are all above round-off.
        """
        kept, cut = rank, f"the other columns are round-off: below {s[0]:.3g} x rank_rtol"
        if rank == s.size:
            cut = "none: every column is above round-off"
        if self.energy is not None:
            beyond = 0.0 if complete else max(total - float(s @ s), 0.0)
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


def _checked(data: BlockData) -> FloatArray:
    """Snapshots (n, M) of a block. Raises InputError if they are absent, not finite or all zero."""
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


def _beyond_numbers(block: str) -> InputError:
    return InputError(
        f"the squares of the snapshots of {block} overflow or underflow: take other units")


def _nothing_left(block: str, M: int) -> InputError:
    return InputError(
        f"the {M} snapshots of {block} do not differ from their mean by more than "
        "round-off: nothing is left to decompose; set centred: false or train with a load")


def _oriented(U: FloatArray) -> FloatArray:
    """Columns of U (n, k), the entry of largest magnitude of each made positive."""
    peak = U[np.abs(U).argmax(axis=0), np.arange(U.shape[1])]
    return np.ascontiguousarray(U * np.where(peak < 0.0, -1.0, 1.0))
