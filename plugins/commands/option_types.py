"""Option types in words, from their JSON schema: `number <= 1`, `name: basis plugin`."""

from collections.abc import Mapping
from typing import Any

from sparsemor.core.registry.plugin_option import Slot

_BOUNDS = {"minimum": ">= {}", "exclusiveMinimum": "> {}", "maximum": "<= {}",
           "exclusiveMaximum": "< {}", "minLength": "length >= {}", "pattern": "matching {}"}


def type_in_words(option: Mapping[str, Any]) -> str:
    """Type of one option in words, with its bounds; option: its JSON schema."""
    if Slot.MARK in option:
        return f"{option[Slot.MARK]} plugin"
    if "$ref" in option:
        return "mapping"
    choices = option.get("anyOf", option.get("oneOf"))
    if choices is not None:
        return " or ".join(dict.fromkeys(
            type_in_words(c) for c in choices if c.get("type") != "null"))
    if "enum" in option or "const" in option:
        return " or ".join(f"`{v}`" for v in option.get("enum", [option.get("const")]))
    bounds = ", ".join(text.format(option[b]) for b, text in _BOUNDS.items() if b in option)
    return f"{_plain(option)} {bounds}".strip()


def _plain(option: Mapping[str, Any]) -> str:
    kind = option.get("type", "anything")
    if kind == "array" and "prefixItems" in option:
        return f"list of {len(option['prefixItems'])}: {type_in_words(option['prefixItems'][0])}"
    if kind == "array":
        return f"list: {type_in_words(option['items'])}"
    if kind == "object":
        values = option.get("additionalProperties")
        return f"name: {type_in_words(values)}" if isinstance(values, Mapping) else "mapping"
    return {"boolean": "true or false", "string": "text"}.get(str(kind), str(kind))
