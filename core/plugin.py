"""The base of every plugin: a frozen pydantic model whose fields are its options."""

from pydantic import BaseModel, ConfigDict


class Plugin(BaseModel):
    """Fields are options, methods fill the protocol of the plugin's kind. No second config class.

    Unknown options, and numbers that are not finite, are refused.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )
