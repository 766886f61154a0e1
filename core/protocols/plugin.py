"""Base class of plugins: a frozen pydantic model whose fields are the plugin's options.

The contract of a kind is a subclass of it (`Basis`, `Sampler`, ...), from which plugins derive: a
method without a body here must be written, all others have a default. It is a class and no
`Protocol`, because the metaclasses of `Protocol` and pydantic exclude each other.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler
from pydantic_core import CoreSchema

from sparsemor.core.protocols.numbers import without_booleans

PREFIX = "sparsemor."
"""Prefix of entry-point groups, `sparsemor.<kind>`."""
OWN = "sparsemor"
"""Distribution that takes precedence if several offer a plugin of the same name."""
API = 3
"""Version of the extension interface `sparsemor.core`."""


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
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True,
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
