"""Checks of the values returned by plugin methods.

Each check raises InputError, located at the input key `key` if there is one, with the plugin class,
the method and the returned value.
"""

from typing import Any, TypeVar

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.basis import Basis, BlockData, Dictionary
from sparsemor.core.protocols.sampler import Preconditioner, Sampler
from sparsemor.core.protocols.sparse_solver import Columns, Recovery, SparseSolver
from sparsemor.core.registry.boundary import guard
from sparsemor.core.registry.contracts import origin, part_breaches, required

T = TypeVar("T")


def checked_return(
    value: object, expected: type[T], plugin: object, call: str, key: str = ""
) -> T:
    """The value, if it is an instance of `expected`, else InputError. call: the plugin method that
    returned it."""
    if isinstance(value, expected):
        return value
    raise _wrong(plugin, call, type(value).__name__, f"a {expected.__name__}", key)


def controller_step(
    plugin: object, value: Any, count: int, t: float, key: str
) -> tuple[float, tuple[float, ...]]:
    """Value and memory that `update` of a controller returned at t, s: a finite number, and `count`
    finite numbers. Raises InputError for anything else."""
    try:
        number, memory = value
        found = np.array([number, *memory], dtype=np.float64)
    except (TypeError, ValueError):
        raise _wrong(plugin, "update", repr(value)[:60],
                     "a number with the numbers that it remembers", key) from None
    if found.shape != (1 + count,):
        raise _wrong(plugin, "update", f"a memory of {len(found) - 1} numbers",
                     f"one of {count}, as `begin` returns", key)
    if not np.isfinite(found[0]):
        raise InputError(f"the controller gives {found[0]} at t = {t:.6g} s", key)
    return float(found[0]), tuple(found[1:].tolist())


def complete(value: object, protocol: type, plugin: object, call: str, key: str = "") -> None:
    """Raises InputError if the object that a plugin method returned does not satisfy `protocol`, or
    has a member in another form or under a misspelt name."""
    if not isinstance(value, protocol):
        raise _wrong(plugin, call, f"{type(value).__name__}, which does not derive from it",
                     f"a {protocol.__name__}", key)
    lacks = [text for name, text in required(protocol).items() if not hasattr(value, name)]
    if lacks:
        raise _wrong(plugin, call, f"{type(value).__name__}, which lacks {', '.join(lacks)}",
                     f"a {protocol.__name__}", key)
    wrong = part_breaches(protocol, type(value), {})
    if wrong:
        raise _wrong(plugin, call, f"{type(value).__name__}, of which {'; '.join(wrong)}",
                     f"a {protocol.__name__}", key)
    guard(protocol, type(value))


def sampled_rows(
    sampler: Sampler, data: BlockData, m: int, dictionary: Dictionary, rng: np.random.Generator,
    required: IntArray,
) -> IntArray:
    """Row numbers (r,) that a sampler selects for a block; checked to be distinct and in range."""
    guard(Sampler, type(sampler))
    return np.asarray(sampler.sample(data, m, dictionary, rng, required)).astype(np.int64)


def built_dictionary(basis: Basis, data: BlockData) -> Dictionary:
    """Trial basis of a block built by `basis`; checked for shapes, atoms (n, k) and offset (n,)."""
    guard(Basis, type(basis))
    return basis.build(data)


def built_weights(preconditioner: Preconditioner, B: FloatArray) -> FloatArray:
    """Preconditioner matrix P (m, m) of sampled rows B (m, k); its shape is checked."""
    guard(Preconditioner, type(preconditioner))
    return np.asarray(preconditioner.build(B)).astype(np.float64)


def prepared_recovery(solver: SparseSolver, columns: Columns, budget: int) -> Recovery:
    """Recovery that a sparse solver prepares for constant columns; checked to be one."""
    guard(SparseSolver, type(solver))
    return solver.prepare(columns, budget)


def _wrong(plugin: object, call: str, got: str, required: str, key: str = "") -> InputError:
    return InputError(f"{call} of {origin(plugin)} returned {got}, where {required} is required: "
                      "report it to the authors of that plugin", key)
