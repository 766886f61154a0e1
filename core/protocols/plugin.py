"""Base class of plugins: a frozen pydantic model whose fields are the plugin's options.

The contract of a kind is a subclass of it (`Basis`, `Sampler`, ...), from which plugins derive: a
method without a body here must be written, all others have a default. It is a class and no
`Protocol`, because the metaclasses of `Protocol` and pydantic exclude each other.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticKnownError, core_schema

PREFIX = "sparsemor."
"""Prefix of entry-point groups, `sparsemor.<kind>`."""
OWN = "sparsemor"
"""Distribution that takes precedence if several offer a plugin of the same name."""
API = 3
"""Version of the extension interface `sparsemor.core`."""


def without_booleans(schema: CoreSchema) -> CoreSchema:
    """The same pydantic schema, in which no number accepts true or false as 1 or 0, at any depth
    except in references to other models, which have their own schema."""
    root: list[Any] = [schema]
    waiting: list[tuple[Any, Any]] = [(root, 0)]  # container and key of parts to be copied
    choices: list[tuple[Any, Any]] = []  # of a union with their labels: tuples
    while waiting:
        holder, key = waiting.pop()
        part = holder[key]
        if isinstance(part, list | tuple):
            holder[key] = parts = list(part)
            for i, p in enumerate(parts):
                if isinstance(p, _CONTAINERS):
                    waiting.append((parts, i))
            if isinstance(part, tuple):
                choices.append((holder, key))
        elif part.get("type") in _NUMBERS and (check := _check_of(part)) is not None:
            holder[key] = core_schema.no_info_before_validator_function(check, part)
        else:
            holder[key] = copy = dict(part)
            for k, v in copy.items():
                if k not in _NOT_SCHEMAS and isinstance(v, _CONTAINERS):
                    waiting.append((copy, k))
    for holder, key in reversed(choices):  # inner ones before those that contain them
        holder[key] = tuple(holder[key])
    return cast(CoreSchema, root[0])


_CONTAINERS = (dict, list, tuple)
_NUMBERS = frozenset({"float", "int", "literal"})
"""Types of schemas that may accept numbers."""
_NOT_SCHEMAS = frozenset({"default", "expected", "metadata", "serialization", "config", "cls"})
"""Keys of a schema whose values are data of the option, and no schemas."""


def _check_of(part: dict[str, Any]) -> Callable[[Any], Any] | None:
    """Check of the values of a schema without parts, None where it has no number or accepts true
    or false, too."""
    kind, expected = part.get("type"), part.get("expected")
    if kind in ("float", "int"):
        return partial(_refuse_booleans, f"{kind}_type", None)
    listed = expected if kind == "literal" and isinstance(expected, list) else []
    types = set(map(type, listed))
    if not types & {int, float} or bool in types:
        return None
    *others, last = map(repr, listed)
    words = f"{', '.join(others)} or {last}" if others else last
    return partial(_refuse_booleans, "literal_error", {"expected": words})


def _refuse_booleans(fault: Any, context: dict[str, Any] | None, value: Any) -> Any:
    """The value. Raises the pydantic error `fault` with its context for true and false."""
    if isinstance(value, bool | np.bool_):
        raise PydanticKnownError(fault, context)
    return value


class Plugin(BaseModel):
    """Base class of plugins: fields are options, methods those of the contract of the plugin's
    kind, which derives from this class.

    Unknown options and non-finite numbers are rejected, and true or false where an option is a
    number. A plugin may set `sparsemor_api` to the
    version of the interface that it was written for; another version is an error that names the
    plugin.
    """

    sparsemor_api: ClassVar[int] = API

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False,
        ignored_types=(bool, str),  # checked with the class's protocol, where it is named
    )

    def files(self, base: Path) -> Sequence[Path]:
        """Paths of the files named in the options; base: folder of the input file."""
        return ()

    @property
    def stored_classes(self) -> Sequence[object]:
        """Classes and functions of which the step solver of a kept model may be made. The file of a
        model refers to them by name; no others are used when it is read."""
        return ()

    def __eq__(self, other: object) -> bool:
        """Equal options of the same class; what a plugin has computed and kept (cached properties,
        arrays among them) is not compared."""
        return type(self) is type(other) and all(
            getattr(self, name) == getattr(other, name) for name in type(self).model_fields)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        schema = handler(source)
        own: Any = handler.resolve_ref_schema(schema)
        own["schema"] = without_booleans(own["schema"])
        return schema

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """JSON schema of the options; an option's docstring is its description."""
        from sparsemor.core.protocols.option_docs import option_docs  # no run reads them

        made, texts = handler(schema), option_docs(cls)
        options = handler.resolve_ref_schema(made).get("properties", {})
        for name, field in cls.model_fields.items():
            if texts.get(name):
                options[field.alias or name].setdefault("description", texts[name])
        return made
