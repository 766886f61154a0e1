"""Registry of plugins: classes by kind and name, from entry points."""

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from typing import Any

from stevedore.driver import DriverManager

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import OWN, PREFIX, Plugin
from sparsemor.core.registry import installed
from sparsemor.core.registry.boundary import admit
from sparsemor.core.registry.contracts import refusal

_UNNAMED = "an unnamed distribution"


@dataclass(frozen=True)
class PluginName:
    """Kind, name and distribution of an installed plugin, which is not imported yet."""

    kind: str
    name: str
    entry_point: metadata.EntryPoint

    @cached_property
    def distribution(self) -> str:
        """Name of its distribution, read from the metadata of that; "" if it has none."""
        return installed.name_of(self.entry_point.dist)

    @property
    def version(self) -> str:
        return self.entry_point.dist.version if self.entry_point.dist else ""

    @property
    def own(self) -> bool:
        """True for a plugin of sparsemor."""
        return canonical(self.distribution) == OWN

    @property
    def qualified(self) -> str:
        """Name `package:name`, which selects this plugin if several packages offer the name."""
        return f"{self.distribution}:{self.name}"

    @property
    def origin(self) -> str:
        """Distribution and version that provide the plugin."""
        return f"{self.distribution} {self.version}" if self.distribution else _UNNAMED


class Registry:
    """Registry of the installed plugins; an ordinary object, not a global.

    A name is plain (`lhs`) or qualified by its distribution (`sparsemor-other:lhs`). If several
    distributions offer a plain name, the one of sparsemor is used.

    Entry points are read at first use and kept, and so are classes. `entry_points` replaces the
    installed ones, for tests and embedding programs.
    """

    def __init__(self, entry_points: Iterable[metadata.EntryPoint] | None = None) -> None:
        self._replaced = None if entry_points is None else tuple(entry_points)
        self._classes: dict[tuple[str, str], type[Plugin]] = {}

    @cached_property
    def _plugins(self) -> Mapping[str, list[PluginName]]:
        """Kind -> its plugins."""
        found: dict[str, list[PluginName]] = {}
        for e in installed.entry_points() if self._replaced is None else self._replaced:
            if e.group.startswith(PREFIX):
                kind = e.group.removeprefix(PREFIX)
                found.setdefault(kind, []).append(PluginName(kind, e.name, e))
        return found

    @cached_property
    def _offers(self) -> Mapping[tuple[str, str], list[PluginName]]:
        """Kind and plain name -> plugins of that name."""
        found: dict[tuple[str, str], list[PluginName]] = {}
        for kind, plugins in self._plugins.items():
            for p in plugins:
                found.setdefault((kind, p.name), []).append(p)
        return found

    def kinds(self) -> tuple[str, ...]:
        """Kinds of plugins that the installed distributions offer, sorted."""
        return tuple(sorted(self._plugins))

    def names(self, kind: str) -> tuple[PluginName, ...]:
        """Plugins of one kind, sorted by name. Imports nothing."""
        return tuple(sorted(
            self._plugins.get(kind, ()), key=lambda p: (p.name, p.distribution)))

    def has(self, kind: str, name: str) -> bool:
        """True if at least one plugin has this plain or qualified name. Imports nothing."""
        return bool(self._called(kind, name))

    def get(self, kind: str, name: str) -> type[Plugin]:
        """Plugin class of this kind and name, imported.

        Raises `InputError` if the name is unknown or ambiguous, the import fails, or the class is
        not a `sparsemor.core.protocols.plugin.Plugin` or violates the protocol of its kind.
        """
        if (kind, name) not in self._classes:
            self._classes[kind, name] = self._checked(kind, name)
        return self._classes[kind, name]

    def _checked(self, kind: str, name: str) -> type[Plugin]:
        """Class of a plugin, imported, compared with the contract of its kind and guarded. Raises
        InputError that names its distribution."""
        one = self._only(kind, name)
        loaded = _Driver(one).plugin
        blame = ("report it to the authors of that package (its entry point is "
                 f"{one.entry_point.value})")
        if not (isinstance(loaded, type) and issubclass(loaded, Plugin)):
            raise InputError(f"{kind} plugin {one.name!r} of {one.origin} is no "
                             f"sparsemor.core.protocols.plugin.Plugin class: {blame}")
        broken = refusal(kind, loaded)
        if broken:
            raise InputError(f"{kind} plugin {one.name!r} of {one.origin} {broken}: {blame}")
        admit(kind, loaded)
        return loaded

    def every(self, kind: str) -> tuple[type[Plugin], ...]:
        """Classes of all plugins of one kind, imported. Raises InputError as `get`."""
        return tuple(self.get(kind, self.spelling(p)) for p in self._plugins.get(kind, ()))

    def load(self, kind: str, name: str) -> Any:
        """Object to which an entry point refers, imported (for packaged example inputs, a path)."""
        return _Driver(self._only(kind, name)).plugin

    def spelling(self, plugin: PluginName) -> str:
        """Shortest name that selects a plugin: plain if possible, else `package:name`."""
        offers = self._called(plugin.kind, plugin.name)
        return plugin.name if len(offers) < 2 or plugin.own else plugin.qualified

    def passed_over(self, kind: str, name: str) -> str:
        """Note on the other packages that offer the same plain name, "" if there are none."""
        offers = self._called(kind, name)
        if len(offers) < 2:
            return ""
        one = self._only(kind, name)
        others = [p for p in offers if p is not one]
        return (f"{kind} plugin {name!r} is that of {one.origin}; "
                f"{' and '.join(p.origin for p in others)} "
                f"{'offers' if len(others) == 1 else 'offer'} one of that name too: write "
                f"{' or '.join(p.qualified for p in others)} for it, or {one.qualified} "
                "for this one")

    def name_of(self, kind: str, cls: type) -> str:
        """Name under which a class is registered, the inverse of `get`."""
        same = f"{cls.__module__}:{cls.__qualname__}"
        package = cls.__module__.partition(".")[0]
        candidates = self._plugins.get(kind, [])
        for p in candidates:
            if p.entry_point.value.replace(" ", "") == same:
                return self.spelling(p)
        # a package may name its class through a re-export; import only that package's own
        for p in candidates:
            if p.entry_point.module.partition(".")[0] == package and _loads_as(p, cls):
                return self.spelling(p)
        raise InputError(
            f"{same} is not registered as a {kind}, so it cannot be written down by name: give it "
            f"an entry point in the group {PREFIX}{kind}"
        )

    def _called(self, kind: str, name: str) -> list[PluginName]:
        """All plugins with this plain or qualified name."""
        package, colon, plain = name.partition(":")
        offers = self._offers.get((kind, plain if colon else name), [])
        if colon:
            return [p for p in offers if p.distribution
                    and canonical(p.distribution) == canonical(package)]
        # the order of several; names of distributions are read from their metadata
        return offers if len(offers) < 2 else sorted(offers, key=lambda p: p.distribution)

    def _only(self, kind: str, name: str) -> PluginName:
        """The plugin with this name; InputError if there is none or more than one."""
        found = self._called(kind, name)
        if not found:
            raise InputError(self._unknown(kind, name))
        own = [p for p in found if p.own] if len(found) > 1 else found
        if len(own) == 1:
            return own[0]
        raise InputError(
            f"{kind} plugin {name!r} is offered by {' and by '.join(p.origin for p in found)}: "
            f"write {' or '.join(p.qualified for p in found)}, or uninstall one of them")

    def _unknown(self, kind: str, name: str) -> str:
        names = sorted({self.spelling(p) for p in self.names(kind)})
        if not names:
            return f"there is no kind of plugin called {kind!r}: {suggestions(kind, self.kinds())}"
        return f"no {kind} plugin is called {name!r}: {suggestions(name, names, 'installed')}"


class _Driver(DriverManager[Any]):
    """Loader of exactly one plugin by stevedore, without its cache on disk."""

    def __init__(self, one: PluginName) -> None:
        self._only = one
        super().__init__(one.entry_point.group, one.name,
            on_load_failure_callback=_reraise, on_missing_entrypoints_callback=None)

    def list_entry_points(self) -> list[metadata.EntryPoint]:
        return [self._only.entry_point]

    @property
    def plugin(self) -> Any:
        return self.extensions[0].plugin

    def _load_one_plugin(self, ep: metadata.EntryPoint, *args: Any) -> Any:
        # stevedore lets an AssertionError or a sys.exit() of the plugin's module through
        try:
            return super()._load_one_plugin(ep, *args)
        except (Exception, SystemExit) as cause:
            raise InputError(
                f"{self._only.kind} plugin {ep.name!r} of {self._only.origin} cannot be imported "
                f"({type(cause).__name__}: {cause}): fix or uninstall the package"
            ) from cause


def _loads_as(one: PluginName, cls: type) -> bool:
    try:
        return _Driver(one).plugin is cls
    except InputError:  # another plugin's failure is no concern of this one
        return False


def _reraise(_manager: Any, _entry_point: metadata.EntryPoint, error: BaseException) -> None:
    raise error


def suggestions(name: str, allowed: Iterable[str], label: str = "allowed") -> str:
    """Hint after an unknown name: the most similar allowed names, then all of them."""
    names = list(allowed)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.6)
    hint = f"did you mean {' or '.join(close)}? " if close else ""
    return f"{hint}{label}: {', '.join(names) or 'none'}"


def canonical(distribution: str) -> str:
    """Distribution name normalised as by package indexes (PEP 503)."""
    return re.sub(r"[-_.]+", "-", distribution).lower()
