"""The extension API: everything that the author of a plugin needs, in one import line.

    from sparsemor.core import BlockData, Dictionary, InputError, Plugin

Names are imported when they are asked for, so that importing the package stays quick. Where a name
is defined may change; its name here does not: tests/laws/test_extension_api.py
lists them all. Law checks of a plugin are in `sparsemor.core.testing`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.core.arrays import BoolArray as BoolArray
    from sparsemor.core.arrays import Csr as Csr
    from sparsemor.core.arrays import FloatArray as FloatArray
    from sparsemor.core.arrays import IntArray as IntArray
    from sparsemor.core.errors import Fault as Fault
    from sparsemor.core.errors import Gather as Gather
    from sparsemor.core.errors import InputError as InputError
    from sparsemor.core.linalg.factorized import Solved as Solved
    from sparsemor.core.linalg.factorized import not_solved as not_solved
    from sparsemor.core.linalg.factorized import solved_directly as solved_directly
    from sparsemor.core.linalg.factorized import unsuitable_matrix as unsuitable_matrix
    from sparsemor.core.model.block_patterns import chosen as chosen
    from sparsemor.core.model.compressed_local import CompressedLocal as CompressedLocal
    from sparsemor.core.notes import Note as Note
    from sparsemor.core.notes import information as information
    from sparsemor.core.protocols import *  # noqa: F403
    from sparsemor.core.registry.hooks import RunStart as RunStart
    from sparsemor.core.registry.hooks import hookimpl as hookimpl
    from sparsemor.core.registry.optional_packages import require as require
    from sparsemor.core.registry.plugin import Plugin as Plugin
    from sparsemor.core.registry.registry import Registry as Registry
    from sparsemor.core.registry.registry import near as near
    from sparsemor.core.registry.slot import Slot as Slot
    from sparsemor.core.registry.slot import slot_default as slot_default
    from sparsemor.core.status import SolveFailed as SolveFailed
    from sparsemor.core.status import Status as Status

_HOMES = {
    "arrays": ("BoolArray", "Csr", "FloatArray", "IntArray"),
    "errors": ("Fault", "Gather", "InputError"),
    "linalg.factorized": ("Solved", "not_solved", "solved_directly", "unsuitable_matrix"),
    "model.block_patterns": ("chosen",),
    "model.compressed_local": ("CompressedLocal",),
    "notes": ("Note", "information"),
    "status": ("SolveFailed", "Status"),
    "registry.hooks": ("RunStart", "hookimpl"),
    "registry.optional_packages": ("require",),
    "registry.plugin": ("Plugin",),
    "registry.registry": ("Registry", "near"),
    "registry.slot": ("Slot", "slot_default"),
}
"""Module of core -> names; those of `protocols` come from its own list."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.core.{module}"), name)
    if not name.startswith("_"):
        protocols = import_module("sparsemor.core.protocols")
        if name in protocols.__all__:
            return getattr(protocols, name)
    raise AttributeError(f"module 'sparsemor.core' has no attribute {name!r}")


def __dir__() -> list[str]:
    protocols = import_module("sparsemor.core.protocols")
    return sorted([*protocols.__all__, *(n for names in _HOMES.values() for n in names)])
