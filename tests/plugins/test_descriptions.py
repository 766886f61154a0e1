"""The first sentence of each plugin, as `sparsemor plugins` shows it."""

import re

import pytest

from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.commands.validate_schema_plugins import NO_CLASS, first_sentence


def plugin_classes() -> list[tuple[str, type]]:
    registry = Registry()
    return [(f"{p.kind} {p.name}", registry.get(p.kind, registry.spelling(p)))
            for kind in registry.kinds() if kind not in NO_CLASS
            for p in registry.names(kind) if p.distribution == "sparsemor"]


@pytest.mark.full
def test_every_plugin_is_one_sentence() -> None:
    """It begins with the method's name, not with a formula, and fits in two lines of a table."""
    found = {name: first_sentence(cls.__doc__ or "") for name, cls in plugin_classes()}
    assert len(found) > 60
    odd = {name: text for name, text in found.items()
           if not re.match(r"[A-Z][A-Za-z-]{2,}|[A-Z]-[a-z]|No ", text) or not text.endswith(".")
           or not 20 <= len(text) <= 180}
    assert not odd
