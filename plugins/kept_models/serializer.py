"""Objects as plain data and arrays, and back: the form in which a reduced model is kept and copied.

A file determines values, never code: a class or function is named by a word, which must be in the
table of those that the program and the plugins of the scene declare (`Plugin.stored_classes`). An
object is made by its own constructor. Plugins of the scene, such as functions of time, are named by
their key there, so that a copy with other functions is the same data read with another scene.
"""

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from types import FunctionType, MethodType
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel
from scipy.sparse import csr_array

from sparsemor.core.protocols.time_function import TimeFunction
from sparsemor.core.registry.value_types import unfit_field
from sparsemor.core.results.model_file import MAGIC
from sparsemor.plugins.kept_models.array_compression import (
    compact,
    declared,
    order,
    restored,
    shuffled,
)

SMALL, RATIO = 2**20, 64
"""Largest size of what is in a file, bytes: so many, and so many times its compressed bytes.
Numbers do not compress better; where they do, as zeros, `dump` leaves them as they are."""
DEEPEST = 128
"""Levels of the tree; models of the packaged scenes have 31."""
_PIECE = 2**16
Table = Mapping[str, object]
"""Name -> class or function that data may name."""


class PackedError(ValueError):
    """Error: an object cannot be stored, or a file is damaged or foreign."""


@runtime_checkable
class HasParts(Protocol):
    """An object that is stored as the arguments of `of_parts`."""

    def parts(self) -> tuple[object, ...]: ...
    @classmethod
    def of_parts(cls, *parts: Any) -> Any: ...


def table_of(items: Iterable[object]) -> dict[str, object]:
    """Table of classes and functions by module and name."""
    return {_label(item): item for item in items}


def _label(item: Any) -> str:
    return f"{item.__module__}:{item.__qualname__}"


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """Tree of JSON values that refers to arrays by number, and to plugins by their key; used: keys
    that it refers to; about: plain data next to it."""

    tree: Any
    arrays: tuple[NDArray[Any], ...]
    used: frozenset[str]
    about: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_object(cls, value: object, table: Table, plugins: Mapping[str, object]) -> "Packed":
        """Data of an object. plugins: key -> plugin of the scene. Raises PackedError, with its
        path, for an object of a class that is not in the table."""
        packer = _Encoder(table, plugins)
        return cls(packer.node(value, "model"), tuple(packer.arrays), frozenset(packer.used))

    def made(self, table: Table, plugins: Mapping[str, object]) -> Any:
        """The object, with the given plugins. Raises PackedError for data that no object fits."""
        try:
            return _Decoder(table, plugins, self.arrays).value(self.tree)
        except PackedError:
            raise
        except (AttributeError, TypeError, ValueError, IndexError, KeyError, RecursionError,
                AssertionError) as error:
            raise PackedError(f"no model fits the data ({type(error).__name__}: {error})") from None

    def dump(self) -> bytes:
        """Bytes of the file: magic line, SHA-256 digest of the rest, then the compressed data."""
        heads, data = compact(self.arrays)
        head = json.dumps([self.about, self.tree, sorted(self.used), heads], separators=(",", ":"),
                          allow_nan=False).encode()
        body = b"".join([len(head).to_bytes(8, "little"), head, *data])
        payload = zlib.compress(body, 6)
        if len(head) + declared(heads) > _most(payload):  # as no reader believes it
            payload = zlib.compress(body, 0)
        return MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload

    @classmethod
    def load(cls, data: bytes) -> "Packed":
        """Inverse of `dump`; executes nothing in the data. Raises PackedError for other formats and
        damaged data."""
        line = data.find(b"\n") + 1
        if data[:line] != MAGIC:
            version = data[: len(MAGIC) - 2] == MAGIC[:-2]
            raise PackedError("it is of another version of the format" if version else
                              "it is no reduced model")
        start = line + 65  # after the 64 digits of the digest and the end of their line
        payload = memoryview(data)[start:]
        if data[line:start] != hashlib.sha256(payload).hexdigest().encode() + b"\n":
            raise PackedError("its digest does not match: the file is damaged")
        try:
            stream = _Stream(payload)
            about, tree, used, heads = _head(stream)
            arrays = restored(heads, stream.take)
            stream.end()
        except (ValueError, TypeError, LookupError, zlib.error, RecursionError,
                MemoryError) as error:
            raise PackedError(f"it cannot be read ({error})") from None
        return cls(tree, arrays, frozenset(used), about)


def _most(payload: bytes | memoryview) -> int:
    """Largest size of what is in compressed data, bytes."""
    return SMALL + RATIO * len(payload)


class _Stream:
    """Compressed data that is read piece by piece: no more memory is taken than is asked for.
    _at: position of the next piece in the payload; _rest: what of the last one is to be read."""

    def __init__(self, payload: memoryview) -> None:
        self.payload, self._rest = payload, b""
        self._at, self._zlib = 0, zlib.decompressobj()

    def take(self, size: int) -> bytearray:
        """The next bytes. Raises ValueError if there are not so many."""
        made = bytearray()
        while len(made) < size:
            if not self._rest:
                self._rest = bytes(self.payload[self._at : self._at + _PIECE])
                self._at += _PIECE
            piece = self._zlib.decompress(self._rest, size - len(made))
            self._rest = self._zlib.unconsumed_tail
            if not piece and (self._zlib.eof or self._at >= len(self.payload) and not self._rest):
                raise ValueError("it holds fewer bytes than its arrays have")
            made += piece
        return made

    def end(self) -> None:
        """Raises ValueError if there is more."""
        rest = self._rest + bytes(self.payload[self._at :])
        if self._zlib.decompress(rest, 1) or not self._zlib.eof or self._zlib.unused_data:
            raise ValueError("it holds more bytes than its arrays have")


def _head(stream: _Stream) -> tuple[dict[str, Any], Any, list[str], list[Any]]:
    """Plain data, tree, used plugins and heads of arrays. Raises ValueError or TypeError for what
    is none, or declares more than such a file holds."""
    size = int.from_bytes(stream.take(8), "little")
    most = _most(stream.payload)
    if size > most:
        raise ValueError(f"its head of {size} bytes is too large for it")
    text = stream.take(size)
    values = sum(map(text.count, b"[{,"))  # about their number, before the text is read
    if values > SMALL // 32 + len(stream.payload):  # one for each stored byte, and 2^15 more
        raise ValueError(f"its head of {values} values is too large for it")
    about, tree, used, heads = found = json.loads(text.decode())
    _check_plain(found, 0)
    whole = size + declared(heads)
    if whole > most:
        raise ValueError(f"its arrays would have {whole} bytes, which such a file cannot hold")
    if not (isinstance(about, dict) and isinstance(about.get("scene"), dict)
            and isinstance(about.get("name"), str) and all(isinstance(k, str) for k in used)):
        raise ValueError("it names no scene")
    return about, tree, used, heads


def _check_plain(value: object, depth: int) -> None:
    """Raises ValueError for data that no writer makes: nested too deep, texts with a NUL or half a
    character, and integers beyond 64 bits."""
    if depth > DEEPEST:
        raise ValueError(f"its data is nested deeper than {DEEPEST} levels")
    if isinstance(value, str):
        if value.count("\0"):
            raise ValueError(f"a text holds the character NUL ({value[:40]!r})")
        value.encode()
    elif isinstance(value, dict):
        for key, inner in value.items():
            _check_plain(key, depth + 1)
            _check_plain(inner, depth + 1)
    elif isinstance(value, list):
        for inner in value:
            _check_plain(inner, depth + 1)
    elif isinstance(value, int) and value.bit_length() > 63:
        raise ValueError("an integer has more than 64 bits")


def _identity(a: NDArray[Any]) -> tuple[object, ...]:
    """Type, shape, order and digest of an array: equal ones are stored once."""
    return a.dtype.str, a.shape, order(a), hashlib.sha256(shuffled(a)).digest()


@dataclass(slots=True)
class _Encoder:
    table: Table
    plugins: Mapping[str, object]
    arrays: list[NDArray[Any]] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    _numbers: dict[Any, int] = field(default_factory=dict)
    _known: dict[int, tuple[int, object]] = field(default_factory=dict)
    _open: set[int] = field(default_factory=set)

    def node(self, value: Any, name: str) -> Any:
        """JSON of a value; a compound one is a mapping with one key, its type. name: its path."""
        if isinstance(value, Enum):  # before numbers and texts, which its members may be
            return {"enum": [self._named(type(value), name), value.name]}
        if value is None or isinstance(value, bool | int) or type(value) is str:
            return value
        if isinstance(value, float):  # also np.float64, which is read back as a float
            return {"float": value.hex()}
        if isinstance(value, np.ndarray):
            return self._dense(value)
        if isinstance(value, np.generic):
            return {"scalar": self._array(value)}
        if isinstance(value, slice):
            return {"slice": [value.start, value.stop, value.step]}
        if isinstance(value, BaseModel):
            return self._plugin(value, name)
        if isinstance(value, FunctionType | type):
            return {"name": self._named(value, name)}
        if isinstance(value, MethodType):
            return {"method": [self.node(value.__self__, name), value.__name__]}
        if type(value) in (list, tuple):
            return {type(value).__name__: [
                self.node(v, f"{name}[{i}]") for i, v in enumerate(value)]}
        if isinstance(value, set | frozenset):
            return {"set": [self.node(v, name) for v in sorted(value)]}
        return self._object(value, name)

    def _array(self, value: Any) -> int:
        """Number of an array, or of an equal one that is there already."""
        array = np.asarray(value)
        key = _identity(array)
        if key not in self._numbers:
            self._numbers[key] = len(self.arrays)
            self.arrays.append(array)
        return self._numbers[key]

    def _dense(self, value: NDArray[Any]) -> Any:
        """An array, or that it is another one with its last two axes swapped."""
        if value.ndim > 2 and order(value) == "C":
            number = self._numbers.get(_identity(np.ascontiguousarray(value.swapaxes(-1, -2))))
            if number is not None and _identity(value) not in self._numbers:
                return {"swapped": number}
        return {"array": self._array(value)}

    def _plugin(self, value: BaseModel, name: str) -> Any:
        """Key of a plugin of the scene, or the options of another one."""
        key = next((k for k, p in self.plugins.items() if p is value), None)
        if key is None:
            return {"options": [self._named(type(value), name), value.model_dump(mode="json")]}
        self.used.add(key)
        return {"plugin": key}

    def _named(self, item: Any, name: str) -> str:
        """Label of a class or function of the table. Raises PackedError for another one; name: path
        of the object."""
        label = _label(item)
        if self.table.get(label) is not item:
            raise PackedError(f"{name} is a {item.__qualname__}, which cannot be stored")
        return label

    def _object(self, value: Any, name: str) -> Any:
        """JSON of an object of which there may be one alone in several places: each after the first
        refers to it by `again` and its number. _known: id -> number and object; _open: ids of the
        objects that are being written."""
        if id(value) in self._known:
            return {"again": self._known[id(value)][0]}
        if id(value) in self._open:
            raise PackedError(f"{name} refers to an object that it is part of")
        self._open.add(id(value))
        made: dict[str, Any]
        if isinstance(value, Mapping):
            made = {"map": [[self.node(k, name), self.node(v, f"{name}[{k!r}]")]
                            for k, v in value.items()]}
        elif isinstance(value, csr_array):
            made = {"csr": [self._array(value.data), self._array(value.indices),
                            self._array(value.indptr), list(value.shape)]}
        elif isinstance(value, HasParts) or isinstance(value, tuple):
            parts = value.parts() if isinstance(value, HasParts) else tuple(value)
            made = {"parts": [self._named(type(value), name), [
                self.node(v, f"{name}[{i}]") for i, v in enumerate(parts)]]}
        elif is_dataclass(value) and not isinstance(value, BaseModel):
            made = {"fields": [self._named(type(value), name), {
                f.name: self.node(getattr(value, f.name), f"{name}.{f.name}")
                for f in fields(value) if f.init}]}
        else:
            raise PackedError(f"{name} is a {type(value).__qualname__}, which cannot be stored")
        self._open.discard(id(value))
        self._known[id(value)] = len(self._known), value  # held, so that its id stays its own
        return made


@dataclass(slots=True)
class _Decoder:
    table: Table
    plugins: Mapping[str, object]
    arrays: tuple[NDArray[Any], ...]
    _known: list[Any] = field(default_factory=list)
    _swapped: dict[int, NDArray[Any]] = field(default_factory=dict)
    _copied: int = 0

    def value(self, node: Any) -> Any:
        """Value of a node as `_Encoder.node` makes it: itself, or a mapping {type: content}."""
        if node is None or isinstance(node, bool | int | str):
            return node
        (kind, content), = node.items()
        return self._kept(kind, content) if kind in _KEPT else _LEAVES[kind](self, content)

    def _kept(self, kind: str, content: Any) -> Any:
        """A new object, with the next number by which `again` refers to it."""
        self._known.append(made := _KEPT[kind](self, content))
        return made

    def named(self, name: str) -> Any:
        """Class or function of the table. Raises PackedError for another one."""
        if name not in self.table:
            raise PackedError(f"it names {name!r}, which no plugin of its scene provides")
        return self.table[name]

    def plugin(self, key: str) -> object:
        if key not in self.plugins:
            raise PackedError(f"it names {key!r}, which is no plugin of its scene")
        return self.plugins[key]

    def options(self, content: Any) -> Any:
        """Plugin of a class with the stored options."""
        return self.named(content[0]).model_validate(content[1])

    def method(self, content: Any) -> Callable[..., Any]:
        """Public method of a stored object. Raises PackedError for what is none."""
        of, name = self.value(content[0]), content[1]
        allowed = isinstance(of, TimeFunction) or type(of) in self.table.values()
        if not allowed or name[:1] == "_" or not isinstance(
                getattr(type(of), name, None), FunctionType):
            raise PackedError(f"it names {name!r}, which is no method")
        found: Callable[..., Any] = getattr(of, name)
        return found

    def swapped(self, content: int) -> NDArray[Any]:
        """Array with its last two axes exchanged, made once."""
        if content not in self._swapped:
            self._swapped[content] = np.ascontiguousarray(self.arrays[content].swapaxes(-1, -2))
        return self._swapped[content]

    def csr(self, content: Any) -> Any:
        """Sparse matrix of the arrays with three numbers and a shape. Raises PackedError where
        copies of its numbers would fill memory."""
        data, indices, indptr, shape = content
        self._copied += self.arrays[indices].nbytes + self.arrays[indptr].nbytes
        if self._copied > SMALL + sum(a.nbytes for a in self.arrays):
            raise PackedError("it names one matrix many times")
        made = csr_array((self.arrays[data], self.arrays[indices], self.arrays[indptr]),
                         shape=tuple(shape))
        made.check_format(full_check=True)
        return made

    def parts(self, content: Any) -> Any:
        """Object of a class and the arguments of its `of_parts`, or of itself."""
        cls, values = self.named(content[0]), [self.value(v) for v in content[1]]
        return self.fitting(
            cls.of_parts(*values) if issubclass(cls, HasParts) else cls(*values))

    def fields(self, content: Any) -> Any:
        """Object of a class and its fields by name."""
        return self.fitting(self.named(content[0])(
            **{n: self.value(v) for n, v in content[1].items()}))

    def fitting(self, made: Any) -> Any:
        """The object itself. Raises PackedError where its fields are not of their types."""
        if is_dataclass(made) and (wrong := unfit_field(made)):
            raise PackedError(f"no model fits the data ({wrong})")
        return made


_LEAVES: Mapping[str, Callable[[_Decoder, Any], Any]] = {
    "float": lambda m, c: float.fromhex(c),
    "array": lambda m, c: m.arrays[c],
    "swapped": _Decoder.swapped,
    "scalar": lambda m, c: m.arrays[c][()],
    "slice": lambda m, c: slice(*c),
    "enum": lambda m, c: m.named(c[0])[c[1]],
    "plugin": lambda m, c: m.plugin(c),
    "options": lambda m, c: m.options(c),
    "name": lambda m, c: m.named(c),
    "method": lambda m, c: m.method(c),
    "list": lambda m, c: [m.value(v) for v in c],
    "tuple": lambda m, c: tuple(m.value(v) for v in c),
    "set": lambda m, c: frozenset(m.value(v) for v in c),
    "again": lambda m, c: m._known[c],
}
_KEPT: Mapping[str, Callable[[_Decoder, Any], Any]] = {
    "map": lambda m, c: {m.value(k): m.value(v) for k, v in c},
    "csr": _Decoder.csr, "parts": _Decoder.parts, "fields": _Decoder.fields,
}
