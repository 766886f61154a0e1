"""Reader of YAML 1.2 that yields plain values, each with its line and column."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, cast

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from sparsemor.core.errors import Fault, InputError

KeyPath = tuple[str | int, ...]
Place = tuple[int, int]
"""Line and column, both counted from 1."""

_TAG = "tag:yaml.org,2002:"
_SCALARS = {"null", "bool", "int", "float", "str"}
_DEEPEST, _LARGEST, MOST_KEYS = 64, 100_000, 20_000
MOST_BYTES = 1_500_000
"""Largest size of a scene or study file that is read, bytes."""
_MOST_LETTERS = 60
"""Largest number of characters of a value that a message repeats."""


class LocatedError(InputError):
    """Input error with its position in a file or option; `lines`: the messages shown to the
    user."""

    def __init__(self, faults: Sequence[Fault], lines: Sequence[str]) -> None:
        super().__init__(faults)
        self.lines = tuple(lines)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.faults, self.lines)


@dataclass(frozen=True, slots=True)
class Document:
    """YAML mapping as plain dicts, lists and scalars, with the position of every key and item."""

    name: str
    tree: dict[str, Any]
    positions: Mapping[KeyPath, Place] = field(default_factory=dict)

    def place(self, path: KeyPath) -> Place:
        """Line and column of `path`, or else of its nearest parent in the file."""
        while path and path not in self.positions:
            path = path[:-1]
        return self.positions.get(path, (1, 1))


@lru_cache(maxsize=16)
def parse(text: str, name: str, kind: str = "scene") -> Document:
    """Document from a file's text, whose root must be a mapping; kind: type of the file in
    messages. The last ones are kept: a scene is read again for each of its variants. Copy the tree
    before you change it.

    Raises `LocatedError` with every fault of form: syntax, duplicate keys, tags, keys that are not
    text, numbers that are not finite, a text that is too long, too deep or of too many values.
    """
    if len(text) > MOST_BYTES:
        raise too_large(name, kind)
    reader = _reader()
    try:
        root = reader.compose(text)
    except YAMLError as error:
        raise _syntax(error, name) from None
    if root is None:
        raise _at(name, [((1, 1), "", f"the file is empty: a {kind} is a mapping of `key: value`")])
    builder = _Converter(reader)
    tree = builder.build(root, ())
    if not isinstance(tree, dict):
        builder.faults.append((_place(root), "", f"a {kind} is a mapping of `key: value`"))
    if builder.faults:
        raise _at(name, builder.faults)
    return Document(name, cast(dict[str, Any], tree), builder.positions)


def parse_value(text: str, key: str) -> Any:
    """Value of a YAML scalar or flow collection (`[1, 2]`, `{use: pod}`), by the same rules as in a
    file."""
    reader = _reader()
    try:
        root = reader.compose(text)
    except YAMLError as error:
        raise InputError(f"{_reason(error)} (got {_short(text)})", key) from None
    if root is None:
        return None
    builder = _Converter(reader)
    value = builder.build(root, ())
    if builder.faults:
        raise InputError([Fault(key, message) for _, _, message in builder.faults])
    return value


def too_large(name: str, kind: str) -> LocatedError:
    """Error for a file that is larger than `MOST_BYTES`."""
    return _at(name, [((1, 1), "", f"a {kind} file has at most {MOST_BYTES / 1e6:g} MB: keep large "
                       "data in files of their own, such as a mesh")])


def not_finite(value: object, path: KeyPath = ()) -> list[KeyPath]:
    """Paths in a tree of plain values to nan, infinities, and integers beyond the range of
    floating-point numbers."""
    if isinstance(value, float):
        return [] if math.isfinite(value) else [path]
    if isinstance(value, int):
        return [] if abs(value) <= sys.float_info.max else [path]
    items: Any = ()
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    return [p for key, v in items for p in not_finite(v, (*path, key))]


_Finding = tuple[Place, str, str]


class _BoundedComposer(Composer):
    """YAML composer that refuses documents that are nested too deep or have too many nodes. _open:
    present depth; _values, _keys: numbers of values and of keys so far."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.warn_double_anchors = False  # the last one counts, as YAML 1.2 has it
        self._open = self._values = self._keys = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The node, refused beyond limits of depth and number, which files with aliases in
        themselves exceed."""
        self._open += 1
        if index is None and isinstance(parent, MappingNode):  # a key; a value has it as index
            self._keys += 1
        else:
            self._values += 1
        for count, most, what in (
                (self._open, _DEEPEST + 1, f"nested deeper than {_DEEPEST} levels"),
                (self._values, _LARGEST, f"more than {_LARGEST} values"),
                (self._keys, MOST_KEYS, f"more than {MOST_KEYS} keys")):
            if count > most:
                raise ComposerError(None, None, what, self.parser.peek_event().start_mark)
        node = super().compose_node(parent, index)
        self._open -= 1
        return node


def _reader() -> YAML:
    reader = YAML(typ="safe", pure=True)
    reader.Composer = _BoundedComposer
    return reader


class _Converter:
    """Converter of YAML nodes to plain values, which records their positions and faults."""

    def __init__(self, reader: YAML) -> None:
        self._construct = reader.constructor.construct_object
        self._count = 0
        self.positions: dict[KeyPath, Place] = {}
        self.faults: list[_Finding] = []

    def build(self, node: Node, path: KeyPath) -> Any:
        """Plain value of a node; its position and those inside are noted, faults are collected."""
        self.positions.setdefault(path, _place(node))
        self._count += 1
        if len(path) > _DEEPEST or self._count > _LARGEST:
            if self._count < 2 * _LARGEST:  # say it once
                self._fault(node, path[:3], "nested too deep or too large (an alias in itself?)")
                self._count = 2 * _LARGEST
            return None
        if isinstance(node, MappingNode) and node.tag == _TAG + "map":
            return self._mapping(node, path)
        if isinstance(node, SequenceNode) and node.tag == _TAG + "seq":
            return [self.build(item, (*path, i)) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return self._scalar(node, path)
        self._fault(node, path, f"the tag {node.tag} is not supported: remove it")
        return None

    def _mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Any]:
        """Mapping of a node; keys that are no plain text or written twice are faults."""
        built: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value if isinstance(key_node, ScalarNode) else None
            if key is None or key_node.tag == _TAG + "merge":
                self._fault(key_node, path, "a key must be plain text; `<<` is not supported")
                continue
            here = (*path, key)
            if key in built:
                line, column = self.positions[here]
                self._fault(key_node, here, f"written twice, first at {line}:{column}: two "
                            "entries of one name; rename or remove one")
                continue
            self.positions[here] = _place(key_node)
            built[key] = self.build(value_node, here)
        return built

    def _scalar(self, node: ScalarNode, path: KeyPath) -> Any:
        """Number, text, truth value or null of a node."""
        kind = str(node.tag).removeprefix(_TAG)
        if kind == "timestamp":  # nothing in a scene is a date
            return node.value
        if kind not in _SCALARS:
            self._fault(node, path, f"the tag {node.tag} is not supported: remove it")
            return None
        try:
            value = self._construct(node, deep=True)
        except (YAMLError, ValueError):
            self._fault(node, path, f"cannot be read as {kind} (got {_short(node.value)})")
            return None
        if not_finite(value):
            self._fault(node, path, f"must be a finite number (got {_short(node.value)})")
        return value

    def _fault(self, node: Node, path: KeyPath, message: str) -> None:
        self.faults.append((_place(node), ".".join(map(str, path)), message))


def _short(text: str) -> str:
    return text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]}..."


def _place(node: Node) -> Place:
    return node.start_mark.line + 1, node.start_mark.column + 1


def _syntax(error: YAMLError, name: str) -> LocatedError:
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    place = (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)
    return _at(name, [(place, "", f"this is not YAML: {_reason(error)}")])


def _reason(error: YAMLError) -> str:
    if isinstance(error, MarkedYAMLError):
        parts = (error.context, error.problem)
        return ", ".join(str(part) for part in parts if part)
    return str(error).splitlines()[0]


def _at(name: str, findings: Sequence[_Finding]) -> LocatedError:
    ordered = sorted(findings)
    return LocatedError([Fault(key, message) for _, key, message in ordered],
        [located(name, place, key, message) for place, key, message in ordered])


def located(name: str, place: Place, key: str, message: str) -> str:
    line, column = place
    return f"{name}:{line}:{column}: " + (f"{key}: {message}" if key else message)
