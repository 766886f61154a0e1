"""Small parts that the screens of a step are made of."""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core import BoolArray, FloatArray, Group, IntArray


class Together:
    """Supports of some groups as one (k,), rebuilt only when one of them is another object."""

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
    """All positions of the parts, as one slice where they follow each other: it copies nothing."""
    if all(a.stop == b.start for a, b in zip(parts, parts[1:], strict=False)):
        return slice(parts[0].start, parts[-1].stop)
    return np.concatenate([np.arange(s.start, s.stop) for s in parts])


def diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    """Blocks (m_i, k_i) along the diagonal."""
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    i = j = 0
    for b in blocks:
        out[i : i + len(b), j : j + b.shape[1]] = b
        i, j = i + len(b), j + b.shape[1]
    return out
