"""Arrays of a kept model as bytes that compress well, and back, to the last digit.

Bytes are ordered by their significance. A large matrix that is another one with its rows times a
vector, such as the operators of a step, D^-1 A with a diagonal D, is stored as the numbers of the
two. Numbers of full precision that depend on nothing else do not compress.
"""

from collections.abc import Callable, Sequence
from itertools import permutations
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGE = 10_000
"""Number of entries from which a matrix is stored as a product."""
MOST_DIMENSIONS = 8
_DTYPES = {d.str: d for d in map(np.dtype, ("?", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8",
                                            "f2", "f4", "f8"))}
"""Data types of arrays, in the order of bytes of this machine."""
Head = list[Any]
"""Data type, shape, order, and None or [matrix, vector, transposed]: the numbers of two arrays
whose product it is."""


def compact(arrays: Sequence[NDArray[Any]]) -> tuple[list[Head], list[bytes]]:
    """Heads of all arrays and bytes of those that are no products."""
    products = _products(arrays)
    return [[a.dtype.str, list(a.shape), order(a), products.get(i)] for i, a in enumerate(arrays)
            ], [shuffled(a) for i, a in enumerate(arrays) if i not in products]


def restored(heads: Sequence[Head], take: Callable[[int], bytearray]) -> tuple[NDArray[Any], ...]:
    """Inverse of `compact`. heads: of each array its data type, shape, order ("C" or "F"), and None
    or, of a product (`_times`), the numbers of matrix and vector, and True if it is transposed.
    take: the next bytes of the data, so many. Raises ValueError, TypeError or LookupError for heads
    of no arrays."""
    stored = {i: _restored(take(_bytes_of(kind, shape)), kind, shape, layout)
              for i, (kind, shape, layout, product) in enumerate(heads) if product is None}
    made = []
    for i, (kind, shape, layout, product) in enumerate(heads):
        if product is None:
            made.append(stored[i])
            continue
        matrix, vector, transposed = product
        _is_product(kind, shape, stored[matrix], stored[vector], transposed)
        made.append(np.asarray(_times(stored[matrix], stored[vector], transposed),
                               order="F" if layout == "F" else "C"))
    return tuple(made)


def declared(heads: Sequence[Head]) -> int:
    """Bytes of all arrays, before any memory is taken for them; empty ones count by their other
    dimensions. Raises ValueError or TypeError for heads of no arrays."""
    return sum(_bytes_of(kind, [max(n, 1) if isinstance(n, int) else n for n in shape])
               for kind, shape, _, _ in heads)


def _bytes_of(kind: str, shape: list[int]) -> int:
    if kind not in _DTYPES:
        raise ValueError(f"an array of {kind!r}")
    if len(shape) > MOST_DIMENSIONS or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError(f"an array of the shape {shape!r:.60}")
    return int(_DTYPES[kind].itemsize) * prod(shape)


def _is_product(
    kind: str, shape: list[int], matrix: NDArray[Any], vector: NDArray[Any], transposed: bool
) -> None:
    """Raises ValueError where an array of this type and shape is not the product that it is said
    to be."""
    of = (*shape[:-2], *shape[:-3:-1]) if transposed else tuple(shape)
    if transposed not in (False, True) or matrix.shape != of or vector.shape != of[-2:-1] or (
            {matrix.dtype, vector.dtype} != {_DTYPES[kind]}):
        raise ValueError(f"an array of the shape {shape} as a product of {matrix.shape} and "
                         f"{vector.shape}")


def order(a: NDArray[Any]) -> str:
    return "F" if a.flags.f_contiguous and not a.flags.c_contiguous else "C"


def shuffled(a: NDArray[Any]) -> bytes:
    """Bytes of an array, first bytes of all entries first, which compress better."""
    flat = np.ascontiguousarray(a.ravel(order=order(a)))  # type: ignore[arg-type]
    return flat.view(np.uint8).reshape(-1, a.itemsize).T.tobytes() if a.size else b""


def _products(arrays: Sequence[NDArray[Any]]) -> dict[int, tuple[int, int, bool]]:
    """Number of a large matrix a -> numbers of the matrix b and the vector v whose product
    diag(v) b (`_times`) it is to the last digit, and True if it is the transposed one."""
    found: dict[int, tuple[int, int, bool]] = {}
    kept = set[int]()  # matrices of products: they are stored themselves
    large = [i for i, a in enumerate(arrays) if _is_large(a)]
    for i, j in permutations(large, 2):
        if i in found or i in kept or j in found:
            continue
        a, b = arrays[i], arrays[j]
        for n, v in enumerate(arrays):
            if v.shape != b.shape[-2:-1] or v.dtype != b.dtype:
                continue
            for transposed in (False, True):
                of = a.swapaxes(-1, -2) if transposed else a
                if of.shape == b.shape and np.array_equal(of[..., 0], b[..., 0] * v) and (
                        np.array_equal(a, _times(b, v, transposed))):
                    found[i] = j, n, transposed
                    kept.add(j)
    return found


def _times(b: NDArray[Any], v: NDArray[Any], transposed: bool) -> NDArray[Any]:
    """Matrices b (.., m, n) with their rows times v (m,), or the transposed ones."""
    made = np.asarray(b * v[:, None])
    return made.swapaxes(-1, -2) if transposed else made


def _is_large(a: NDArray[Any]) -> bool:
    return a.ndim > 1 and a.size >= LARGE and a.dtype.kind == "f"


def _restored(data: bytearray, kind: str, shape: list[int], layout: str) -> NDArray[Any]:
    dtype = _DTYPES[kind]
    raw = np.frombuffer(data, np.uint8).reshape(dtype.itemsize, prod(shape))
    flat = np.ascontiguousarray(raw.T).reshape(-1).view(dtype)
    return flat.reshape(shape, order="F" if layout == "F" else "C")
