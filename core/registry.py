"""Which class is called X? Answered at configuration time, from entry points."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from typing import Any

from stevedore.driver import DriverManager

from sparsemor.core.errors import InputError
from sparsemor.core.plugin import Plugin

PREFIX = "sparsemor."
"""Entry-point groups are `sparsemor.<kind>`."""


@dataclass(frozen=True, slots=True)
class PluginName:
    """A plugin that is installed. Nothing of it has been imported."""

    kind: str
    name: str
    distribution: str
    version: str
    target: str


class Registry:
    """The plugins installed here: a value, never a global.

    Entry points are read on first use and kept, so one registry sees one state of the machine.
    `entry_points` replaces what is installed: tests and embedding programs pass their own list.
    """

    def __init__(self, entry_points: Iterable[metadata.EntryPoint] | None = None) -> None:
        self._given = None if entry_points is None else tuple(entry_points)

    @cached_property
    def _entry_points(self) -> tuple[metadata.EntryPoint, ...]:
        if self._given is not None:
            return tuple(e for e in self._given if e.group.startswith(PREFIX))
        installed = metadata.entry_points()
        groups = sorted(g for g in installed.groups if g.startswith(PREFIX))
        return tuple(e for g in groups for e in installed.select(group=g))

    def kinds(self) -> tuple[str, ...]:
        """Every kind that some installed distribution offers, sorted."""
        return tuple(sorted({e.group.removeprefix(PREFIX) for e in self._entry_points}))

    def names(self, kind: str) -> tuple[PluginName, ...]:
        """The plugins of one kind, sorted by name. Imports nothing."""
        found = [_named(e) for e in self._of(kind)]
        return tuple(sorted(found, key=lambda p: (p.name, p.distribution)))

    def get(self, kind: str, name: str) -> type[Plugin]:
        """Import the plugin's class.

        Raises `InputError` when the name is unknown, offered twice, fails to import, or is not a
        `sparsemor.core.plugin.Plugin`.
        """
        loaded = self.load(kind, name)
        if isinstance(loaded, type) and issubclass(loaded, Plugin):
            return loaded
        (one,) = self._called(kind, name)
        raise InputError(
            f"{kind} plugin {name!r} of {_origin(one)} is no sparsemor.core.plugin.Plugin class "
            f"(its entry point is {one.value}): report it to the authors of that package"
        )

    def load(self, kind: str, name: str) -> Any:
        """Import whatever object the entry point names (packaged scenes are paths)."""
        found = self._called(kind, name)
        if not found:
            raise InputError(self._unknown(kind, name))
        if len(found) > 1:
            raise InputError(
                f"{kind} plugin {name!r} is offered by {' and by '.join(map(_origin, found))}: "
                "uninstall one of them"
            )
        return _Driver(found[0]).plugin

    def name_of(self, kind: str, cls: type) -> str:
        """The name under which a class is registered, the inverse of `get`."""
        same = f"{cls.__module__}:{cls.__qualname__}"
        package = cls.__module__.partition(".")[0]
        candidates = self._of(kind)
        for e in candidates:
            if e.value.replace(" ", "") == same:
                return e.name
        # a package may name its class through a re-export; import only that package's own
        for e in candidates:
            if e.module.partition(".")[0] == package and _loads_as(e, cls):
                return e.name
        raise InputError(
            f"{same} is not registered as a {kind}, so it cannot be written down by name: give it "
            f"an entry point in the group {PREFIX}{kind}"
        )

    def _of(self, kind: str) -> list[metadata.EntryPoint]:
        return [e for e in self._entry_points if e.group == PREFIX + kind]

    def _called(self, kind: str, name: str) -> list[metadata.EntryPoint]:
        return [e for e in self._of(kind) if e.name == name]

    def _unknown(self, kind: str, name: str) -> str:
        names = sorted({e.name for e in self._of(kind)})
        if not names:
            return f"there is no kind of plugin called {kind!r}: {near(kind, self.kinds())}"
        return f"no {kind} plugin is called {name!r}: {near(name, names, 'installed')}"


class _Driver(DriverManager[Any]):
    """stevedore's "load exactly one", kept away from its cache of entry points on disk."""

    def __init__(self, entry_point: metadata.EntryPoint) -> None:
        self._only = entry_point
        super().__init__(
            entry_point.group, entry_point.name,
            on_load_failure_callback=_reraise, on_missing_entrypoints_callback=None,
        )

    def list_entry_points(self) -> list[metadata.EntryPoint]:
        return [self._only]

    @property
    def plugin(self) -> Any:
        return self.extensions[0].plugin

    def _load_one_plugin(self, ep: metadata.EntryPoint, *args: Any) -> Any:
        # stevedore lets an AssertionError or a sys.exit() of the plugin's module through
        try:
            return super()._load_one_plugin(ep, *args)
        except (Exception, SystemExit) as cause:
            kind = ep.group.removeprefix(PREFIX)
            raise InputError(
                f"{kind} plugin {ep.name!r} of {_origin(ep)} cannot be imported "
                f"({type(cause).__name__}: {cause}): mend or uninstall that package"
            ) from cause


def _loads_as(e: metadata.EntryPoint, cls: type) -> bool:
    try:
        return _Driver(e).plugin is cls
    except InputError:  # another plugin's failure is no concern of this one
        return False


def _reraise(_manager: Any, _entry_point: metadata.EntryPoint, error: BaseException) -> None:
    raise error


def near(given: str, known: Iterable[str], label: str = "allowed") -> str:
    """Advice after a name nobody knows: the nearest ones, then all of them."""
    names = list(known)
    close = difflib.get_close_matches(given, names, n=3, cutoff=0.6)
    hint = f"did you mean {' or '.join(close)}? " if close else ""
    return f"{hint}{label}: {', '.join(names) or 'none'}"


def _named(e: metadata.EntryPoint) -> PluginName:
    dist = e.dist
    return PluginName(
        e.group.removeprefix(PREFIX), e.name,
        dist.name if dist else "", dist.version if dist else "", e.value,
    )


def _origin(e: metadata.EntryPoint) -> str:
    return f"{e.dist.name} {e.dist.version}" if e.dist else "an unnamed distribution"
