"""Small matrices that the screens of a step are made of."""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols import Group


def joined(parts: Sequence[slice]) -> slice | IntArray:
    """All places of the parts, as one slice where they follow each other: it copies nothing."""
    if all(a.stop == b.start for a, b in zip(parts, parts[1:], strict=False)):
        return slice(parts[0].start, parts[-1].stop)
    return np.concatenate([np.arange(s.start, s.stop) for s in parts])


def group(name: str, start: int, budget: int | None, J: FloatArray) -> Group:
    return Group(name, start, start + J.shape[1], budget)


def with_rest(J: FloatArray, first: int) -> FloatArray:
    """The first rows of J, and a row of zeros for what is folded into one number."""
    return np.vstack([J[:first], np.zeros((1, J.shape[1]))])


def folded(r: FloatArray, first: int) -> FloatArray:
    """(first + 1,): the rows that columns reach, and the norm of the others."""
    out, rest = np.empty(first + 1), r[first:]
    out[:first], out[first] = r[:first], norm(rest)
    return out


def squares(A: FloatArray) -> FloatArray:
    """(k,) squared lengths of the columns of A (m, k)."""
    return np.asarray(np.einsum("ij,ij->j", A, A))


def norm(v: FloatArray) -> float:
    return sqrt(float(v.dot(v)))


def diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    """Blocks (m_i, k_i) along the diagonal."""
    out = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    i = j = 0
    for b in blocks:
        out[i : i + len(b), j : j + b.shape[1]] = b
        i, j = i + len(b), j + b.shape[1]
    return out
