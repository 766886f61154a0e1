"""What is installed: entry points of plugins, and optional dependencies, such as packages of some
linear solvers."""

import os
import sys
from contextlib import suppress
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from itertools import chain
from operator import attrgetter

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import PREFIX


def entry_points() -> tuple[metadata.EntryPoint, ...]:
    """Entry points of all kinds of plugins, sorted by kind. They are read again where the search
    path or a folder in it has changed."""
    return _entry_points(tuple([(path, _changed(path)) for path in sys.path]))


@cache
def _entry_points(path: tuple[tuple[str, int], ...]) -> tuple[metadata.EntryPoint, ...]:
    found: dict[str, list[metadata.EntryPoint]] = {}
    for folder, changed in path:
        for name in _offering(folder, changed):
            if name not in found:  # of several with one name, that which Python imports
                found[name] = _own(metadata.distribution(name))
    return tuple(sorted(chain.from_iterable(found.values()), key=attrgetter("group")))


@cache
def _offering(folder: str, changed: int) -> tuple[str, ...]:
    """Names of the distributions in a folder that offer plugins; changed: its last change."""
    names = []
    for d in metadata.distributions(path=[folder]):
        # most have none: their text is searched before it is parsed
        if PREFIX in (d.read_text("entry_points.txt") or "") and _own(d):
            with suppress(TypeError, KeyError):  # a half removed one has no metadata
                names.append(d.name)
    return tuple(filter(None, names))


def _own(distribution: metadata.Distribution) -> list[metadata.EntryPoint]:
    return [e for e in distribution.entry_points if e.group.startswith(PREFIX)]


@cache
def name_of(distribution: metadata.Distribution | None) -> str:
    """Name of a distribution, read from its metadata; "" if there is none."""
    return distribution.name if distribution else ""


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
