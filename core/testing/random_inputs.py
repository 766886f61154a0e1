"""Random but repeatable inputs of the law kits."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
from scipy import sparse

from sparsemor.core.arrays import Csr
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.dense import unit_columns
from sparsemor.core.protocols.basis import BlockData, Dictionary
from sparsemor.core.protocols.layout import FieldKind, Quantity
from sparsemor.core.protocols.load_tables import LoadTable, Table, path_rows, ring
from sparsemor.core.registry.contracts import refusal


def keeps_contract(kind: str, plugin: object) -> None:
    """Law of every plugin: its class has what the contract of its kind requires, and no public name
    that is nearly one of it."""
    law(not (wrong := refusal(kind, type(plugin))), wrong)


def law(holds: object, message: str) -> None:
    """Assertion that python -O keeps. Raises AssertionError with `message` unless `holds` is
    true."""
    if not holds:
        raise AssertionError(message)


def refused(what: str, attempt: Callable[[], object], optional: bool = False) -> None:
    """Checks that `attempt()` raises InputError, or with `optional` nothing else; what: its
    description in the AssertionError."""
    try:
        attempt()
    except InputError:
        return
    except Exception as error:  # whatever else a plugin's code raises, the law is broken
        raise AssertionError(f"{what}: expected an InputError, got {error!r}") from error
    law(optional, f"{what}: expected an InputError, but it was accepted")


ANY = FieldKind("field", order=2, unit="", reducible=True)
DISPLACEMENTS = FieldKind(
    "displacements", order=2, unit="m", quantity=Quantity.DISPLACEMENT, reducible=True)
TEMPERATURES = FieldKind(
    "temperatures", order=1, unit="K", quantity=Quantity.TEMPERATURE, reducible=True)
FORCES = FieldKind("forces", order=0, unit="N")
"""Kinds of fields on which laws are tried."""


def random_block(rng: np.random.Generator, kind: FieldKind = ANY) -> BlockData:
    """Random data of a block of 24 to 60 unknowns on distinct nodes, with snapshots of rank 4 to 8.

    Two loads, a joint and a moving load act on it; its initial values are not zero, its steps are
    those of implicit Euler. Displacements are coupled to a block of temperatures, insulated in
    about half the draws.
    """
    d = int(rng.integers(1, 4))
    nodes = int(rng.integers(24, 61)) // d
    n, M, rank = nodes * d, int(rng.integers(12, 80)), int(rng.integers(4, 9))
    size = 10.0 ** -np.linspace(0.0, 6.0, rank)
    snapshots = (rng.standard_normal((n, rank)) * size) @ rng.standard_normal((rank, M))
    block = BlockData(name=f"body.{kind.name}", order=1 if kind.order == 1 else 2,
        snapshots=snapshots, mass=_definite(n, 0.1, rng), stiffness=_definite(n, 1.0, rng),
        coordinates=np.repeat(rng.random((nodes, d)), d, axis=0),
        component=np.tile(np.arange(d), nodes).astype(np.int64), loads=rng.standard_normal((n, 2)))
    return _loaded(block, kind, rng.spawn(1)[0])  # what callers draw next stays the same


def random_heat(rng: np.random.Generator) -> BlockData:
    """Random data of a block of temperatures (`random_block`), insulated (K 1 = 0) in about half
    the draws."""
    block = random_block(rng, TEMPERATURES)
    if rng.random() < 0.5:
        K = block.stiffness - sparse.diags_array(np.asarray(block.stiffness.sum(axis=1)))
        return replace(block, stiffness=sparse.csr_array(K))
    return block


def _loaded(block: BlockData, kind: FieldKind, rng: np.random.Generator) -> BlockData:
    """Block with joint forces on a few rows, load names, initial values, and temperatures if it is
    one of displacements."""
    n = block.size
    interface = np.sort(rng.choice(n, 3, replace=False)).astype(np.int64)
    joint = np.zeros((n, 1))
    joint[interface] = rng.random((3, 1)) + 0.1
    heat = random_heat(rng) if kind.quantity is Quantity.DISPLACEMENT else None
    moving, h = moving_load(n, 6, rng), 0.5
    first = block.order == 1
    return replace(
        block, moving=(moving,), step=h, factors=(0.0, 1 / h) if first else (1 / h, 1 / h**2),
        ring=ring(block.mass, block.stiffness, block.coordinates, path_rows((moving,))),
        loads=np.hstack([block.loads, joint]), joints=np.array([2]), interface=interface,
        load_names=("push", "pull", "pin x"), start=rng.standard_normal(n), heat=heat,
        coupling=None if heat is None else sparse.random_array(
            (n, heat.size), density=0.3, format="csr", rng=rng))


def moving_load(n: int, count: int, rng: np.random.Generator) -> LoadTable:
    """Load that moves over `count` neighbouring unknowns of n without reaching the last one."""
    first, times = int(rng.integers(0, n - count)), np.linspace(0.0, 1.0, 4 * count)
    columns = sparse.csr_array(
        (np.ones(count), (first + np.arange(count), np.arange(count))), shape=(n, count))
    at = times[:, None] * (count - 2)
    values = np.maximum(0.0, 1.0 - np.abs(at - np.arange(count)))
    return LoadTable("walk", columns, tuple(f"walk, node {first + i}" for i in range(count)),
                     Table(times, values))


def random_dictionary(n: int, k: int, rng: np.random.Generator) -> Dictionary:
    """Dictionary of k random unit columns of length n."""
    return Dictionary(unit_columns(rng.standard_normal((n, k))), np.zeros(n),
                      tuple(f"random {i}" for i in range(k)))


def copied(item: Any) -> list[Any]:
    """Copies of the arrays of a data class, to detect later whether a plugin changed them."""
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
    """Random tridiagonal, diagonally dominant matrix: symmetric positive definite."""
    off = size * (0.2 + 0.2 * rng.random(n - 1))
    return sparse.csr_array(
        sparse.diags_array([-off, np.full(n, size), -off], offsets=[-1, 0, 1])
    )
