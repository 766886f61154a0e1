"""Conversion of pydantic validation errors to error messages with dotted input keys, the value
found, and advice."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.registry.registry import suggestions

Path = tuple[str | int, ...]
UNKNOWN = "unknown_option"


def dotted(path: Sequence[str | int]) -> str:
    return ".".join(map(str, path))


def shown(value: object) -> str:
    """Value as the user wrote it, shortened to one line."""
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, BaseModel):
        return type(value).__name__
    try:
        text = json.dumps(value)
    except (TypeError, ValueError):
        # Python writes no integer of more than 4300 digits
        text = f"an integer of {value.bit_length()} bits" if isinstance(value, int) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def with_advice(cls: type[BaseModel], error: ValidationError) -> list[InitErrorDetails]:
    """The errors, with the allowed option names added to those for unknown options. cls: options
    that were validated."""
    return [_advised(cls, e) for e in error.errors(include_url=False)]


def custom(kind: str, message: str, loc: Path, value: object) -> InitErrorDetails:
    """One validation error with a message that may contain braces."""
    return InitErrorDetails(
        type=PydanticCustomError("custom", "{text}", {"text": message, "kind": kind}),
        loc=loc, input=value,
    )


def _advised(cls: type[BaseModel], e: ErrorDetails) -> InitErrorDetails:
    if e["type"] == "extra_forbidden":
        options = _options_at(cls, e["loc"][:-1])
        if options is not None:
            advice = f"no such option: {suggestions(str(e['loc'][-1]), options)}"
            return custom(UNKNOWN, advice, e["loc"], e["input"])
    if e["type"] == "custom":
        return custom(e["ctx"]["kind"], e["ctx"]["text"], e["loc"], e["input"])
    return InitErrorDetails(type=e["type"], loc=e["loc"], input=e["input"], ctx=e.get("ctx", {}))


def _options_at(annotation: Any, path: Path) -> list[str] | None:
    """Option names of the pydantic model found at `path` within a type annotation; None if there is
    none."""
    while get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        fields = annotation.model_fields
        if not path:
            return [f.alias or name for name, f in fields.items()]
        if path[0] not in fields:  # a union puts the branch's name into the path
            return _options_at(annotation, path[1:])
        return _options_at(fields[str(path[0])].annotation, path[1:])
    arguments = get_args(annotation)
    is_container = get_origin(annotation) in (dict, list, tuple, Mapping, Sequence)
    for inner in arguments[::-1]:  # of a mapping the type of values, which comes last, first
        found = _options_at(inner, path[1:] if is_container else path)
        if found is not None:
            return found
    return None


def faults_of(error: ValidationError, tree: object) -> list[Fault]:
    """Errors by dotted input key, one per key. tree: the validated input; names of union branches,
    which pydantic adds to keys, are removed."""
    tagged: dict[str, bool] = {}  # True if only branches of unions have faults at the key
    messages: dict[str, list[str]] = {}
    for e in error.errors(include_url=False):
        path, was_tagged = _own_keys(e["loc"], tree, e["type"])
        for key, message in _messages(e):
            full = dotted(path) + (f".{key}" if key and path else key)
            tagged[full] = tagged.get(full, True) and was_tagged
            lines = messages.setdefault(full, [])
            if message not in lines:
                lines.append(message)
    # of a union's branches, the one that got further into the value is the one that was meant
    deepest = [k for k in messages
               if not (tagged[k] and any(o.startswith(f"{k}.") for o in messages))]
    return [Fault(k, "; or: ".join(messages[k])) for k in deepest]


def _own_keys(loc: Path, tree: object, kind: str) -> tuple[Path, bool]:
    """Path of a fault in the data of the user: pydantic's path `loc` without the parts that name a
    branch of a union; True if such parts were left out. tree: those data; kind: pydantic's type of
    the fault."""
    path: list[str | int] = []
    node, tagged = tree, False
    for depth, part in enumerate(loc):
        last_missing = kind == "missing" and depth == len(loc) - 1
        if isinstance(node, Mapping) and part in node:
            node = node[part]
        elif isinstance(node, list | tuple) and isinstance(part, int) and part < len(node):
            node = node[part]
        elif node is not _DEFAULT and not last_missing and not _may_be_default(node, part):
            tagged = True
            continue
        else:
            node = _DEFAULT  # a value that the user left out
        path.append(part)
    return tuple(path), tagged


def _may_be_default(node: object, part: str | int) -> bool:
    """True if an error key may lie inside a default value, which is not in the input file; False
    for names of union branches, which are no keys."""
    return isinstance(node, Mapping) and isinstance(part, str) and part.isidentifier() and (
        part not in _BRANCHES and not _CLASS.fullmatch(part))


_DEFAULT = object()
"""Place of a default value, which the input does not contain."""
_CLASS = re.compile(r"[A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*")
"""Names of classes; names of options that begin with a capital have no other letter."""
_BRANCHES = {"int", "float", "str", "bool", "none", "is_instance", "literal", "date", "constrained"}


_PLAIN = {
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type", "mapping_type"),
                    "Input should be keys with values, such as {key: value}"),
    **dict.fromkeys(("list_type", "tuple_type"), "Input should be a list, such as [a, b]")}
"""Messages that replace those of pydantic with names of Python types or classes."""


def _messages(e: ErrorDetails) -> list[tuple[str, str]]:
    cause = e.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return [(f.key, f.message) for f in cause.faults]
    if e["type"] == "custom":
        return [("", e["ctx"]["text"])]
    text = str(cause) if cause is not None else _PLAIN.get(e["type"], e["msg"])
    if e["type"] == "missing":
        return [("", "is missing, and has no default")]
    return [("", f"{text} (got {shown(e['input'])})")]
