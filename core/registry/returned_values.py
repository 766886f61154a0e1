"""Checks of the values returned by plugin methods.

Each check raises InputError, located at the input key `key` if there is one, with the plugin class,
the method and the returned value.
"""

from typing import Any, TypeVar

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import (
    Basis,
    BlockData,
    Columns,
    Dictionary,
    Preconditioner,
    Recovery,
    Sampler,
    SparseSolver,
)
from sparsemor.core.registry.contracts import absent_members, origin, part_breaches

T = TypeVar("T")


def checked_return(
    value: object, expected: type[T], plugin: object, call: str, key: str = ""
) -> T:
    """The value, if it is an instance of `expected`, else InputError. call: the plugin method that
    returned it."""
    if isinstance(value, expected):
        return value
    raise _wrong(plugin, call, type(value).__name__, f"a {expected.__name__}", key)


def complete(
    value: object, protocol: type, plugin: object, call: str, key: str = "",
    abilities: tuple[type, ...] = (),
) -> None:
    """Raises InputError if the object that a plugin method returned lacks a member of `protocol`,
    or implements an optional protocol wrongly or under a misspelt name."""
    lacks = absent_members(protocol, value)
    if lacks:
        raise _wrong(plugin, call, f"{type(value).__name__}, which lacks {', '.join(lacks)}",
                     f"a {protocol.__name__}", key)
    wrong = part_breaches(protocol, abilities, type(value))
    if wrong:
        raise _wrong(plugin, call, f"{type(value).__name__}, of which {'; '.join(wrong)}",
                     f"a {protocol.__name__}", key)


def sampled_rows(
    sampler: Sampler, data: BlockData, m: int, dictionary: Dictionary, rng: np.random.Generator,
    required: IntArray,
) -> IntArray:
    """Row numbers (r,) that a sampler selects for a block; checked to be distinct and in range."""
    rows: Any = np.asarray(sampler.sample(data, m, dictionary, rng, required))
    if rows.ndim != 1 or (rows.size and rows.dtype.kind not in "iu"):
        raise _wrong(sampler, "sample", f"{rows.dtype} of shape {rows.shape}",
                     "an array of integers of shape (r,)", "reducer.sampler")
    if rows.size and (rows.min() < 0 or rows.max() >= data.size
                      or len(np.unique(rows)) < len(rows)):
        raise _wrong(sampler, "sample", f"{rows.size} rows from {rows.min()} to {rows.max()}",
                     f"distinct rows from 0 to {data.size - 1}", "reducer.sampler")
    found: IntArray = rows.astype(np.int64)
    return found


def built_dictionary(basis: Basis, data: BlockData) -> Dictionary:
    """Trial basis of a block built by `basis`; checked for shapes, atoms (n, k) and offset (n,)."""
    made = checked_return(basis.build(data), Dictionary, basis, "build")
    shapes = np.shape(made.atoms), np.shape(made.offset)
    if len(shapes[0]) != 2 or shapes[0][0] != data.size or shapes[1] != (data.size,):
        raise _wrong(basis, "build", f"atoms {shapes[0]} and offset {shapes[1]}",
                     f"atoms ({data.size}, k) and offset ({data.size},)")
    return made


def built_weights(preconditioner: Preconditioner, B: FloatArray) -> FloatArray:
    """Preconditioner matrix P (m, m) of sampled rows B (m, k); its shape is checked."""
    P: Any = np.asarray(preconditioner.build(B))
    m = len(B)
    if P.shape != (m, m) or P.dtype.kind not in "fiu":
        raise _wrong(preconditioner, "build", f"{P.dtype} of shape {P.shape}",
                     f"an array of numbers of shape ({m}, {m})", "reducer.preconditioner")
    found: FloatArray = P.astype(np.float64)
    return found


def _wrong(plugin: object, call: str, got: str, required: str, key: str = "") -> InputError:
    return InputError(f"{call} of {origin(plugin)} returned {got}, where {required} is required: "
                      "report it to the authors of that plugin", key)


def prepared_recovery(solver: SparseSolver, columns: Columns, budget: int) -> Recovery:
    """Recovery that a sparse solver prepares for constant columns; checked to be one."""
    recovery = solver.prepare(columns, budget)
    complete(recovery, Recovery, solver, "prepare", "reducer.solver")
    return recovery
