"""Random but repeatable inputs for the laws."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from scipy import sparse

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.protocols import BlockData, Dictionary


def law(holds: object, message: str) -> None:
    """An assert that python -O keeps."""
    if not holds:
        raise AssertionError(message)


def random_block(rng: np.random.Generator, name: str = "body.field") -> BlockData:
    """A block of 24 to 60 unknowns on distinct nodes, with snapshots of rank 4 to 8."""
    d = int(rng.integers(1, 4))
    nodes = int(rng.integers(24, 61)) // d
    n, M, rank = nodes * d, int(rng.integers(12, 80)), int(rng.integers(4, 9))
    size = 10.0 ** -np.linspace(0.0, 6.0, rank)
    snapshots = (rng.standard_normal((n, rank)) * size) @ rng.standard_normal((rank, M))
    return BlockData(
        name=name,
        snapshots=snapshots,
        mass=_definite(n, 0.1, rng),
        stiffness=_definite(n, 1.0, rng),
        coordinates=np.repeat(rng.random((nodes, d)), d, axis=0),
        component=np.tile(np.arange(d), nodes).astype(np.int64),
        loads=rng.standard_normal((n, 2)),
    )


def random_dictionary(n: int, k: int, rng: np.random.Generator) -> Dictionary:
    """k random unit columns."""
    atoms = rng.standard_normal((n, k))
    atoms /= np.linalg.norm(atoms, axis=0)
    return Dictionary(atoms, np.zeros(n), tuple(f"random {i}" for i in range(k)))


def with_snapshots(block: BlockData, snapshots: FloatArray) -> BlockData:
    return replace(block, snapshots=snapshots)


def copied(item: Any) -> list[Any]:
    """Copies of the arrays of a data class, to see later whether a plugin wrote to them."""
    return [_plain(getattr(item, f.name)).copy() for f in fields(item) if _is_array(item, f.name)]


def unchanged(item: Any, before: list[Any]) -> bool:
    now = [_plain(getattr(item, f.name)) for f in fields(item) if _is_array(item, f.name)]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(now, before, strict=True))


def _is_array(item: Any, name: str) -> bool:
    value = getattr(item, name)
    return isinstance(value, np.ndarray) or sparse.issparse(value)


def _plain(value: Any) -> Any:
    return value.toarray() if sparse.issparse(value) else value


def _definite(n: int, size: float, rng: np.random.Generator) -> Csr:
    """Tridiagonal, diagonally dominant: symmetric positive definite."""
    off = size * (0.2 + 0.2 * rng.random(n - 1))
    return sparse.csr_array(
        sparse.diags_array([-off, np.full(n, size), -off], offsets=[-1, 0, 1])
    )
