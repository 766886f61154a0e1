"""Results of plugins' methods, checked where core and reducers receive them.

Each check raises an InputError, under `key` if there is one, that names the plugin's class, the
method and what it returned, instead of a traceback further on.
"""

from typing import Any, TypeVar

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import Basis, BlockData, Dictionary, Preconditioner, Sampler
from sparsemor.core.registry.contracts import absent_members, origin, part_breaches

T = TypeVar("T")


def checked_return(
    value: object, expected: type[T], plugin: object, call: str, key: str = ""
) -> T:
    """The value, if it is of the class that a plugin's method has to return."""
    if isinstance(value, expected):
        return value
    raise _wrong(plugin, call, type(value).__name__, f"a {expected.__name__}", key)


def complete(
    value: object, protocol: type, plugin: object, call: str, key: str = "",
    abilities: tuple[type, ...] = (),
) -> None:
    """InputError unless what a plugin's method returned has every member of a protocol, and no
    member of its optional abilities in another form or under a misspelled name."""
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
    """Rows (r,) that a sampler draws: distinct row numbers of the block."""
    rows: Any = np.asarray(sampler.sample(data, m, dictionary, rng, required))
    if rows.ndim != 1 or (rows.size and rows.dtype.kind not in "iu"):
        raise _wrong(sampler, "sample", f"{rows.dtype} of shape {rows.shape}",
                     "integers of shape (r,)", "reducer.sampler")
    if rows.size and (rows.min() < 0 or rows.max() >= data.size
                      or len(np.unique(rows)) < len(rows)):
        raise _wrong(sampler, "sample", f"{rows.size} rows from {rows.min()} to {rows.max()}",
                     f"distinct rows from 0 to {data.size - 1}", "reducer.sampler")
    found: IntArray = rows.astype(np.int64)
    return found


def built_dictionary(basis: Basis, data: BlockData) -> Dictionary:
    """The dictionary of a block that a basis builds, atoms (n, k) and offset (n,)."""
    made = checked_return(basis.build(data), Dictionary, basis, "build")
    shapes = np.shape(made.atoms), np.shape(made.offset)
    if len(shapes[0]) != 2 or shapes[0][0] != data.size or shapes[1] != (data.size,):
        raise _wrong(basis, "build", f"atoms {shapes[0]} and offset {shapes[1]}",
                     f"atoms ({data.size}, k) and offset ({data.size},)")
    return made


def built_weights(preconditioner: Preconditioner, B: FloatArray) -> FloatArray:
    """The matrix P (m, m) that a preconditioner builds for rows B (m, k)."""
    P: Any = np.asarray(preconditioner.build(B))
    m = len(B)
    if P.shape != (m, m) or P.dtype.kind not in "fiu":
        raise _wrong(preconditioner, "build", f"{P.dtype} of shape {P.shape}",
                     f"numbers of shape ({m}, {m})", "reducer.preconditioner")
    found: FloatArray = P.astype(np.float64)
    return found


def _wrong(plugin: object, call: str, got: str, required: str, key: str = "") -> InputError:
    return InputError(f"{call} of {origin(plugin)} returned {got}, where {required} is required: "
                      "report it to the authors of that plugin", key)
