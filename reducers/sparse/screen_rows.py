"""Helper functions of the screening of atom selections: concatenated supports, block-diagonal
matrices."""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core import BoolArray, FloatArray, Group, IntArray


class Together:
    """Supports of several groups of atoms as one boolean vector (k,), rebuilt only when one of them
    is replaced."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self.groups = tuple(groups)
        self._parts: list[BoolArray] = []
        self._whole = np.zeros(0, dtype=np.bool_)

    def of(self, supports: Mapping[str, BoolArray]) -> BoolArray:
        parts = [supports[g.name] for g in self.groups]
        if len(parts) != len(self._parts) or any(
                a is not b for a, b in zip(parts, self._parts, strict=True)):
            self._parts, self._whole = parts, np.concatenate(parts)
        return self._whole


def joined(parts: Sequence[slice]) -> slice | IntArray:
    """All positions in several ranges, as one slice (a view) where these are contiguous."""
    if all(a.stop == b.start for a, b in zip(parts, parts[1:], strict=False)):
        return slice(parts[0].start, parts[-1].stop)
    return np.concatenate([np.arange(s.start, s.stop) for s in parts])


def diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix of blocks (m_i, k_i)."""
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    i = j = 0
    for b in blocks:
        out[i : i + len(b), j : j + b.shape[1]] = b
        i, j = i + len(b), j + b.shape[1]
    return out
