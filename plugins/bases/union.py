"""Union of several bases in one overcomplete dictionary."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from sparsemor.core import Basis, BlockData, Dictionary, FloatArray, Slot
from sparsemor.core.linalg.dense import coherence, oriented_unit_columns
from sparsemor.core.model.model import distinct_names
from sparsemor.plugins.bases.orthogonalise import independent, merge


class Overcomplete(Basis):
    """Overcomplete dictionary: the atoms of all `bases` in their order, near-duplicates merged.

    An offset that all bases share is kept; otherwise each offset becomes an atom ("pod offset"), so
    that the dictionary represents all that one of the bases can.
    """

    bases: list[Annotated[Basis, Slot("basis")]] = Field(
        default=["pod", "modal", "static"], min_length=1, validate_default=True)
    """Bases whose atoms are united, such as `[{use: pod, count: 20}, {use: modal, count: 40},
    static]`."""
    tolerance: float = Field(default=1e-6, ge=0.0, lt=1.0)
    """Two atoms are merged when the sine of the angle between them is at most this (1e-6: their
    coherence is 1 to 5e-13). The first stays, and its name lists those it absorbed."""
    orthonormal: bool = False
    """Orthogonalise each atom against the earlier ones and drop it below `rank_rtol`: the same span
    without redundancy, for reducers that use all atoms, such as `galerkin`."""
    rank_rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Part of an atom outside the span of earlier ones (2-norm) below which it counts as dependent;
    used with `orthonormal` only."""

    @property
    def needs_snapshots(self) -> bool:
        return any(b.needs_snapshots for b in self.bases)

    def unfit(self, data: BlockData) -> str:
        """Reason of the first of the bases that cannot be built for a block; "" if all can."""
        reasons = (b.unfit(data) for b in self.bases)
        return next((why for why in reasons if why), "")

    def fitting(self, data: BlockData) -> "Overcomplete | None":
        """This dictionary of the bases that can be built for a block; None if there are none."""
        kept = [b for b in self.bases if not b.unfit(data)]
        return self.model_copy(update={"bases": kept}) if kept else None

    def build(self, data: BlockData) -> Dictionary:
        """Dictionary with atoms (n, k), k possibly above n."""
        parts = [b.build(data) for b in self.bases]
        offset, extra, extra_names = _offsets(parts, data.size)
        names = [p for part in parts for p in part.provenance] + extra_names
        atoms = oriented_unit_columns(np.concatenate([*(p.atoms for p in parts), extra], axis=1))
        atoms, said, merged = merge(atoms, distinct_names(names), self.tolerance)
        info: dict[str, float | int | str] = {}
        for i, part in enumerate(parts):  # what each basis reports, under its place in the list
            info |= {f"{i}.{key}": value for key, value in part.info.items()}
        s = np.linalg.svd(atoms, compute_uv=False)
        rank = int(np.count_nonzero(s > s[0] * max(atoms.shape) * np.finfo(np.float64).eps))
        left_out, mutual = 0, coherence(atoms)
        if self.orthonormal:
            kept, added = independent(atoms, self.rank_rtol)
            left_out = atoms.shape[1] - len(kept)
            atoms, said = oriented_unit_columns(added), tuple(said[i] for i in kept)
        return Dictionary(atoms, offset, said, info | {
            "atoms": atoms.shape[1], "merged": merged, "dependent": left_out,
            "numerical_rank": rank, "coherence": mutual})


def _offsets(
    parts: Sequence[Dictionary], n: int
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Common offset (n,), and the offsets that become atoms, (n, j), with their names."""
    first = parts[0].offset
    if all(np.array_equal(p.offset, first) for p in parts):
        return first, np.zeros((n, 0)), []
    moved = [p for p in parts if p.offset.any()]
    names = [f"{p.provenance[0].rpartition(' ')[0] or p.provenance[0]} offset" for p in moved]
    return np.zeros(n), np.stack([p.offset for p in moved], axis=1), names
