"""Installed plugins of a kind, third-party ones included."""

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.registry import Registry


def installed(kind: str) -> dict[str, type[Plugin]]:
    """Name -> class of each installed plugin of a kind; plugins that cannot be imported, or violate
    the protocol of their kind, are left out."""
    registry, found = Registry(), {}
    for plugin in registry.names(kind):
        try:
            name = registry.spelling(plugin)
            found[name] = registry.get(kind, name)
        except InputError:
            continue
    return found
