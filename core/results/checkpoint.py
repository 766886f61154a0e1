"""Checkpoint: the state from which a stopped run continues exactly after its last checkpointed
step, as plain data and arrays: no code and no class names in the file.

An object is stored as its fields: the mapping that `__getstate__` returns, by default its
attributes. Reading fills the fields of an object of the same structure that the program created,
such as the memory that a step solver allocates at the start. A file therefore determines values and
never types.
"""

import io
import json
import zlib
from collections.abc import Mapping, Sequence, Set
from copy import deepcopy
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.protocols.step_solver import StepMemory
from sparsemor.core.results.atomic_files import replace_file

MAGIC = b"sparsemor state 1\n"
_SEQUENCES: Mapping[str, tuple[type, ...]] = {
    "list": (list,), "tuple": (tuple,), "set": (set, frozenset)}
_NO_STATE = (type, Enum, FunctionType, BuiltinFunctionType, MethodType, ModuleType)


class SavedError(ValueError):
    """Error: the file is damaged, or the stored state has another structure than the program's
    objects."""


@runtime_checkable
class SetsState(Protocol):
    """Object that restores its state from the value that its `__getstate__` returned."""

    def __setstate__(self, state: Any) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Saved:
    """Serialized state: tree of JSON values that refers to arrays by their index in `arrays`."""

    tree: Any
    arrays: tuple[NDArray[Any], ...]

    @classmethod
    def from_value(cls, value: object, name: str = "memory") -> "Saved":
        """Serialized copy of `value`: None, numbers, strings, bytes, arrays, random generators,
        lists, tuples, sets, mappings, and objects with fields of these types.

        name: path of `value` in error messages. Raises TypeError, with the path, for any other
        type.
        """
        packer = _Packer()
        tree = packer.node(value, name)
        return cls(tree, tuple(packer.arrays))

    def into(self, fresh: Any, name: str = "memory") -> Any:
        """Value restored into the objects of `fresh`, an object of the same structure, which is
        modified.

        Additional entries of a list or mapping are created as copies of the first entry in `fresh`.
        name: path in error messages. Raises SavedError where fields or types differ.
        """
        return self._value(self.tree, fresh, name)

    def dump(self) -> bytes:
        """Bytes of the file: magic line, CRC-32 of the rest, then .npy arrays in sequence, the JSON
        tree first."""
        body = io.BytesIO()
        text = json.dumps(self.tree, separators=(",", ":"), allow_nan=False).encode()
        for array in (np.frombuffer(text, np.uint8), *self.arrays):
            np.lib.format.write_array(body, array, allow_pickle=False)
        payload = body.getvalue()
        return MAGIC + b"%08x\n" % zlib.crc32(payload) + payload

    @classmethod
    def load(cls, data: bytes) -> "Saved":
        """Inverse of `dump`; executes nothing in the data. Raises SavedError for other formats and
        damaged data."""
        head = len(MAGIC)
        if data[:head] != MAGIC:
            raise SavedError("it is of another format")
        payload = data[head + 9:]
        if data[head:head + 9] != b"%08x\n" % zlib.crc32(payload):
            raise SavedError("its checksum does not match: the file is damaged")
        stream, arrays = io.BytesIO(payload), []
        try:
            while stream.tell() < len(payload):
                arrays.append(np.lib.format.read_array(stream, allow_pickle=False))
            return cls(json.loads(arrays[0].tobytes().decode()), tuple(arrays[1:]))
        except (ValueError, IndexError, RecursionError) as error:
            raise SavedError(f"it cannot be read ({error})") from None

    def _value(self, node: Any, like: Any, name: str) -> Any:
        """Value of a JSON node. like: value of the same structure to be filled, or None; name: path
        in error messages."""
        if node is None:
            return None
        if isinstance(node, bool | int | str):
            return _checked(node, like, name)
        try:
            (kind, content), = node.items()
            if kind in ("float", "bytes", "array", "scalar"):
                return _checked(self._leaf(kind, content), like, name)
            if kind == "map":
                return self._mapping(content, like, name)
            if kind in ("list", "tuple", "set"):
                return self._sequence(kind, content, like, name)
            if kind == "generator":
                return _generator(self._value(content, None, name), like, name)
            if kind in ("state", "fields"):
                return self._object(kind, content, like, name)
        except (AttributeError, TypeError, ValueError, IndexError, KeyError) as error:
            if isinstance(error, SavedError):
                raise
            raise SavedError(f"{name} cannot be read ({error})") from None
        raise SavedError(f"{name} is of an unknown kind {kind!r}")

    def _leaf(self, kind: str, content: Any) -> Any:
        """A float, bytes, an array or a scalar of an array."""
        if kind == "float":
            return float.fromhex(content)
        if kind == "bytes":
            return bytes.fromhex(content)
        return self.arrays[content] if kind == "array" else self.arrays[content][()]

    def _mapping(self, content: Any, like: Any, name: str) -> Any:
        """A mapping; its values are filled into those of `like`, into copies of its first value for
        further keys."""
        if like is not None and not isinstance(like, Mapping):
            raise SavedError(f"{name} is a mapping, and {_kind(like)} in this program")
        keys = [self._value(k, None, name) for k, _ in content]
        entries = dict(like or {})
        first = next(iter(entries.values()), None)  # copied before any of them is filled
        more = None if set(keys) <= set(entries) else _another(first)
        return {k: self._value(v, entries[k] if k in entries else _another(more), f"{name}[{k!r}]")
                for k, (_, v) in zip(keys, content, strict=True)}

    def _sequence(self, kind: str, content: Any, like: Any, name: str) -> Any:
        """List, tuple or set of stored content; its entries become objects like those of `like`,
        the present value.

        Entries beyond those of `like` are restored into copies of its first entry (`more`), made
        before the first entry is itself restored.
        """
        if like is not None and not isinstance(like, _SEQUENCES[kind]):
            raise SavedError(f"{name} is a {kind}, and {_kind(like)} in this program")
        if kind == "set":
            made = frozenset(self._value(v, None, name) for v in content)
            return set(made) if isinstance(like, set) else made
        entries = list(like) if isinstance(like, list | tuple) else []
        more = _another(entries[0]) if entries and len(content) > len(entries) else None
        values = [self._value(v, entries[i] if i < len(entries) else _another(more), f"{name}[{i}]")
                  for i, v in enumerate(content)]
        return values if kind == "list" else tuple(values)

    def _object(self, kind: str, content: Any, like: Any, name: str) -> Any:
        """The present object `like`, filled with its stored content.

        kind: "state", what `__getstate__` returned, for an object with `__setstate__`; else the
        content is attributes by name.
        """
        if like is None or isinstance(
                like, Mapping | list | tuple | np.ndarray | str | int | float):
            raise SavedError(f"{name} is an object with fields, and "
                             f"{'nothing' if like is None else _kind(like)} in this program")
        own = like.__getstate__()
        if (kind == "state") != isinstance(like, SetsState):
            raise SavedError(f"{name} was stored in another way than this program does it")
        if isinstance(like, SetsState):
            like.__setstate__(self._value(content, own, name))
            return like
        fields = _attributes(own, like, name)
        if fields.keys() != content.keys():
            odd = ", ".join(sorted(fields.keys() ^ content.keys()))
            raise SavedError(f"{name} has other fields than in this program: {odd}")
        for field_name, node in content.items():
            value = self._value(node, fields[field_name], f"{name}.{field_name}")
            object.__setattr__(like, field_name, value)
        return like


@dataclass(slots=True)
class _Packer:
    arrays: list[NDArray[Any]] = field(default_factory=list)
    open: list[int] = field(default_factory=list)

    def node(self, value: Any, name: str) -> Any:
        """JSON representation of a value; a compound value is a mapping with one key, its type.

        name: path of the value in error messages. Arrays are appended to `arrays`; `open` holds the
        ids of the compound values around this one, so that a cycle is found.
        """
        if isinstance(value, _NO_STATE):
            raise TypeError(f"{name}: a {type(value).__name__} is no state that can be saved")
        if isinstance(value, np.ndarray | np.generic):
            label = "array" if isinstance(value, np.ndarray) else "scalar"
            return {label: self._array(value, name)}
        if value is None or isinstance(value, bool | int | str):
            return value
        if isinstance(value, float):
            return {"float": value.hex()}
        if isinstance(value, bytes):
            return {"bytes": value.hex()}
        if id(value) in self.open:
            raise TypeError(f"{name}: refers to an object that it is part of")
        self.open.append(id(value))
        try:
            return self._compound(value, name)
        finally:
            self.open.pop()

    def _array(self, value: Any, name: str) -> int:
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise TypeError(f"{name}: an array of objects cannot be saved")
        self.arrays.append(array)
        return len(self.arrays) - 1

    def _compound(self, value: Any, name: str) -> Any:
        """Node of a container, a random generator, or an object by its state or its fields."""
        if isinstance(value, Mapping):
            return {"map": [[self.node(k, f"a key of {name}"), self.node(v, f"{name}[{k!r}]")]
                            for k, v in value.items()]}
        if isinstance(value, list | tuple):
            label = "list" if isinstance(value, list) else "tuple"
            return {label: [self.node(v, f"{name}[{i}]") for i, v in enumerate(value)]}
        if isinstance(value, set | frozenset):
            return {"set": [self.node(v, name) for v in sorted(value)]}
        if isinstance(value, np.random.Generator):
            return {"generator": self.node(value.bit_generator.state, name)}
        state = value.__getstate__()
        if isinstance(value, SetsState):
            return {"state": self.node(state, name)}
        return {"fields": {n: self.node(v, f"{name}.{n}")
                           for n, v in _attributes(state, value, name).items()}}


def _attributes(state: Any, value: Any, name: str) -> dict[str, Any]:
    """Fields in the value that `__getstate__` returned: a mapping, a tuple of one for attributes
    and one for slots, or None."""
    parts = state if isinstance(state, tuple) else (state,)
    found: dict[str, Any] = {}
    for part in parts:
        if part is not None and not isinstance(part, Mapping):
            raise TypeError(f"{name}: a {type(value).__name__} has no fields to save")
        found |= dict(part or {})
    return found


def _generator(state: Any, like: Any, name: str) -> np.random.Generator:
    if not isinstance(like, np.random.Generator):
        raise SavedError(f"{name} is a random generator, and {_kind(like)} in this program")
    like.bit_generator.state = state
    return like


def _checked(value: Any, like: Any, name: str) -> Any:
    if like is not None and _kind(like) != _kind(value):
        raise SavedError(f"{name} is {_kind(value)}, and {_kind(like)} in this program")
    return value


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} with {value.ndim} axes"
    if isinstance(value, bool | int | float | np.number | np.bool_):
        return "a number"
    return f"a {type(value).__name__}"


def _another(like: Any) -> Any:
    """Copy of an object, to be filled as an additional entry; step memory is copied by its own
    method, because its working arrays are not part of its state."""
    plain = isinstance(like, Mapping | Sequence | Set | np.ndarray)
    return like.copy() if isinstance(like, StepMemory) and not plain else deepcopy(like)


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Checkpoint of a run. run: identifier of the store that it belongs to; stored: number of steps
    in the store at that moment; arrays: state of the time integrator; memory: serialized state of
    the step solver (`Saved`)."""

    run: str
    stored: int
    arrays: Mapping[str, NDArray[Any]]
    memory: Saved


def checkpoint_file(store: Path) -> Path:
    """Path of the checkpoint, next to the folder of the result."""
    return store.with_suffix(".checkpoint")


def save_checkpoint(store: Path, checkpoint: Checkpoint) -> None:
    """Writes the checkpoint of a store; an earlier one is replaced atomically."""
    memory = checkpoint.memory
    head = Saved.from_value(
        (checkpoint.run, checkpoint.stored, dict(checkpoint.arrays)), "checkpoint")
    tree = {"head": head.tree, "own": len(head.arrays), "memory": memory.tree}
    replace_file(checkpoint_file(store), Saved(tree, (*head.arrays, *memory.arrays)).dump())


def load_checkpoint(store: Path) -> Checkpoint | None:
    """Checkpoint of a store, None if there is none; nothing in the file is executed.

    The first `own` arrays of the file belong to the head, the others to the solver's memory.
    Raises SavedError for a file that is damaged or of another format.
    """
    file = checkpoint_file(store)
    if not file.exists():
        return None
    read = Saved.load(file.read_bytes())
    try:
        own = int(read.tree["own"])
        head = Saved(read.tree["head"], read.arrays[:own]).into(("", 0, {}), "checkpoint")
        # identifier of the run, its number of stored steps, and the integrator's arrays by name
        run, stored, arrays = head
        memory = Saved(read.tree["memory"], read.arrays[own:])
    except (KeyError, TypeError, ValueError) as error:
        raise SavedError(f"it has not the fields of a checkpoint ({error})") from None
    if not all(isinstance(a, np.ndarray) for a in arrays.values()):
        raise SavedError("its state is not made of arrays")
    return Checkpoint(run, stored, arrays, memory)
