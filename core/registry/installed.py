"""What is installed: entry points of plugins, and optional dependencies, such as packages of some
linear solvers."""

import os
import sys
from contextlib import suppress
from functools import cache
from importlib import metadata
from importlib.util import find_spec

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import PREFIX


def entry_points() -> tuple[metadata.EntryPoint, ...]:
    """Entry points of all kinds of plugins, sorted by kind. They are read again where the search
    path or a folder in it has changed."""
    return _entry_points(tuple([(path, _changed(path)) for path in sys.path]))


@cache
def _entry_points(path: tuple[tuple[str, int], ...]) -> tuple[metadata.EntryPoint, ...]:
    found = metadata.entry_points()
    groups = sorted([g for g in found.groups if g.startswith(PREFIX)])
    return tuple([e for g in groups for e in found.select(group=g)])


def _changed(path: str) -> int:
    """Time of the last change of a folder, in which a distribution adds its own."""
    with suppress(OSError):
        return os.stat(path or ".").st_mtime_ns
    return 0


def require(module: str, extra: str, who: str) -> None:
    """Raises InputError with the name of the pip extra if `module` is not installed. Imports
    nothing. who: the plugin that needs it."""
    if find_spec(module) is None:
        raise InputError(
            f"{who} needs the package {module}, which is not installed: "
            f"pip install 'sparsemor[{extra}]'")
