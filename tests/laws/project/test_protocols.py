"""Every contract is imported from `sparsemor.core.protocols`, wherever in it its file is."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

import pytest

from sparsemor.core import protocols

FILES = [name for _, name, _ in iter_modules(protocols.__path__)]
NAMES = {n for n in vars(protocols) if not n.startswith("_")} - {*FILES}


def contracts(module: ModuleType) -> set[str]:
    return {name for name, value in vars(module).items()
            if isinstance(value, type) and value.__module__ == module.__name__
            and not name.startswith("_")}


@pytest.mark.parametrize("name", FILES)
def test_what_a_file_defines_is_exported(name: str) -> None:
    module = import_module(f"sparsemor.core.protocols.{name}")
    assert contracts(module) <= NAMES
    assert all(getattr(protocols, c) is getattr(module, c) for c in contracts(module))


def test_nothing_else_is_exported() -> None:
    defined = {c for name in FILES
               for c in contracts(import_module(f"sparsemor.core.protocols.{name}"))}
    values = {"Amplitude", "Effect", "ErrorAction", "PROBLEM_FEATURES", "RowsKept",
              "Solve", "Stiffened"}
    assert NAMES == defined | values
