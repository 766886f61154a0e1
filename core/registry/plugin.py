"""The base of every plugin: a frozen pydantic model whose fields are its options."""

from typing import ClassVar

from pydantic import BaseModel, ConfigDict

API = 2
"""Version of the extension API, `sparsemor.core`."""


class Plugin(BaseModel):
    """Base class of plugins: fields are options, methods implement the protocol of its kind.

    Unknown options, and numbers that are not finite, are refused. A plugin that sets
    `sparsemor_api` to the version it was written for is refused by name where that is another one.
    """

    sparsemor_api: ClassVar[int] = API

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True,
        ignored_types=(bool, str),  # checked with the class's protocol, where it is named
    )
