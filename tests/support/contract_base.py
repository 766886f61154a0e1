"""Text of a plugin class for tests: the contract of its kind as base class."""

from sparsemor.core import Plugin
from sparsemor.core.registry.contracts import CONTRACTS


def with_base(kind: str, text: str) -> str:
    """The text with the contract of a kind in place of BASE."""
    contract = CONTRACTS[kind]
    return text.replace("BASE", contract.__name__ if issubclass(contract, Plugin) else "Plugin")
