"""Identity of a run: everything except the scene's text that its numbers depend on; and settings of
a scene that do not affect its full-order solution.

Sources of sparsemor, libraries, plugins of other distributions (name, version, sources), files that
the scene names, and the number of BLAS threads. It is part of the key of every cached product, and
a stopped run is continued only if it is unchanged.
"""

import hashlib
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from sparsemor.core.linalg.threads import threads
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.time_function import Controller
from sparsemor.core.registry.installed import entry_points
from sparsemor.core.scene.scene import Scene

PACKAGE = "sparsemor"
FOLDERS = ("core", "bodies", "reducers", "integrators", "plugins")
OUTSIDE = ("core/cli", "plugins/command_line", "plugins/publishing")
"""Folders in these whose code starts runs and evaluates results, so that no run depends on it."""
LIBRARIES = ("numpy", "scipy", "scikit-fem", "meshio", "pypardiso", "scikit-sparse", "pyamg",
             "cvxpy", "scikit-learn")
"""Distributions that compute parts of a product, whether installed or not, because the linear
solver `auto` chooses among those installed."""
_read: dict[tuple[Path, int, int, int], bytes] = {}
"""Digest of each file that was read, by path, time of its last change, size and inode."""
_SOURCES = (".py", ".so", ".pyd")
_KNOWN = frozenset({PACKAGE, "pydantic", "typing_extensions", "__main__"}) | sys.stdlib_module_names


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a run.

    code: digest of sparsemor's sources; libraries: distribution -> version; plugins: module ->
    (distribution and version, digest of its sources); files: path as named in the scene -> digest;
    threads: number of BLAS threads.
    """

    code: str
    libraries: Mapping[str, str]
    plugins: Mapping[str, tuple[str, str]]
    files: Mapping[str, str]
    threads: int

    @classmethod
    def from_scene(cls, scene: Scene) -> "Identity":
        """Identity of a run of this scene in the present environment."""
        parts = _plugins(scene)
        found = {p.partition(".")[0] for part in parts for p in _modules(type(part))}
        return cls(code_digest(), library_versions(),
                   {root: _origin(root) for root in sorted(found)},
                   _files(parts, scene.folder), threads())

    def plain(self) -> dict[str, Any]:
        """Identity as plain data, for JSON and for keys."""
        return {"code": self.code, "libraries": dict(self.libraries),
                "plugins": {n: list(p) for n, p in self.plugins.items()},
                "files": dict(self.files), "threads": self.threads}

    def changes(self, kept: Mapping[str, Any]) -> list[str]:
        """Differences from an earlier identity (plain data), a clause for each; empty where they
        are equal."""
        if not kept:
            return ["the code of sparsemor has changed (the result names no identity)"]
        found = []
        if kept["code"] != self.code:
            found.append("the code of sparsemor has changed")
        found += _changed("", kept["libraries"], self.libraries)
        for name in sorted({*kept["plugins"], *self.plugins}):
            # distribution and version, digest of the sources
            then, now = kept["plugins"].get(name), self.plugins.get(name)
            if then is None or now is None or then[0] != now[0]:
                found += _changed("plugin ", {name: then and then[0]}, {name: now and now[0]})
            elif then[1] != now[1]:
                found.append(f"the code of plugin {now[0] or name} has changed")
        for name in sorted({*kept["files"], *self.files}):
            if kept["files"].get(name) != self.files.get(name):
                found.append(f"the file {name} has changed")
        if kept["threads"] != self.threads:
            found.append(f"the number of BLAS threads was {kept['threads']} and is {self.threads}")
        return found


def _changed(label: str, then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    return [f"{label}{n} was {then.get(n) or 'absent'} and is {now.get(n) or 'absent'}"
            for n in sorted({*then, *now}) if then.get(n) != now.get(n)]


def environment() -> list[object]:
    """Part of an identity that does not depend on the scene, for keys of cached products."""
    return [code_digest(), library_versions(), threads()]


@cache
def code_digest() -> str:
    """SHA-256 digest of sparsemor's own sources on which runs depend, read once per process."""
    root = Path(__file__).absolute().parents[2]
    outside = [root / folder for folder in (*OUTSIDE, *_of_commands())]
    return _digest_of([p for folder in FOLDERS for p in sources(root / folder)
                       if not any(map(p.is_relative_to, outside))], root)


def _of_commands() -> list[str]:
    """Folders of sparsemor's commands outside of core, on which no run depends either, unless they
    hold checks or choices of runs, too."""
    folders = [{Path(*e.module.split(".")[1:-1]).as_posix() for e in entry_points()
                if e.module.startswith(f"{PACKAGE}.") and e.group in groups} for groups in (
                    [f"{PACKAGE}.command"], [f"{PACKAGE}.check", f"{PACKAGE}.choice"])]
    return sorted(folders[0] - folders[1])


def folder_digest(folder: Path) -> str:
    """SHA-256 digest of the sources in a folder."""
    return _digest_of(sources(folder), folder)


@cache
def library_versions() -> dict[str, str]:
    """Version of each of `LIBRARIES`, "" where it is not installed."""
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = ""
    return found


def origin(cls: type) -> list[list[str]]:
    """Origin of a plugin's class, for keys: module, distribution and version, and digest of the
    sources.

    One entry for each package other than sparsemor that defines the class or one of its bases;
    empty for plugins of sparsemor.
    """
    roots = {m.partition(".")[0] for m in _modules(cls)}
    return [[root, *_origin(root)] for root in sorted(roots)]


def _plugins(scene: Scene) -> list[object]:
    """Plugins in a scene, including the scene itself."""
    found, waiting = list[object](), list[object]([scene])
    while waiting:
        value = waiting.pop()
        if isinstance(value, Mapping):
            waiting += value.values()
        elif isinstance(value, list | tuple | set | frozenset):
            waiting += value
        elif isinstance(value, BaseModel):
            found.append(value)
            waiting += [getattr(value, name) for name in type(value).model_fields]
        elif not isinstance(value, str | bytes | int | float | None):
            found.append(value)  # an object that a script gave in a plugin's place
    return found


def _modules(cls: type) -> set[str]:
    return {c.__module__ for c in cls.__mro__ if c.__module__.partition(".")[0] not in _KNOWN}


def _origin(root: str) -> tuple[str, str]:
    """Pair of "name version" of the distribution that offers plugins from the package (or module)
    `root`, and digest of its sources."""
    try:
        spec = find_spec(root)
    except ValueError:  # a module that was made by hand
        spec = None
    files: list[Path] = []
    if spec is not None and spec.submodule_search_locations:
        files = [p for place in spec.submodule_search_locations for p in sources(Path(place))]
    elif spec is not None and spec.origin:
        files = [Path(spec.origin)]
    return _distribution(root), _digest_of(files, None)


def _distribution(root: str) -> str:
    found = {f"{e.dist.name} {e.dist.version}" for e in entry_points()
             if e.module.partition(".")[0] == root and e.dist is not None}
    return ", ".join(sorted(found))


def sources(folder: Path) -> list[Path]:
    return sorted([Path(place, name) for place, _, names in os.walk(folder) for name in names
                   if name.endswith(_SOURCES)])


def _digest_of(files: Sequence[Path], root: Path | None) -> str:
    """SHA-256 digest of the names and contents of files, each read once as long as its time, size
    and inode stay the same; one that cannot be read has its name alone. root: folder from which
    the names are paths; None: names without folders."""
    state = hashlib.sha256()
    for file in files:
        digest = b""
        with suppress(OSError):  # whoever reads it says what is wrong
            found = file.stat()
            version = file, found.st_mtime_ns, found.st_size, found.st_ino
            if version not in _read:
                with file.open("rb") as stream:
                    _read[version] = hashlib.file_digest(stream, "sha256").digest()
            digest = _read[version]
        name = file.name if root is None else file.relative_to(root).as_posix()
        state.update(f"{name}:".encode() + digest)
    return state.hexdigest()


def _files(parts: Sequence[object], base: Path) -> dict[str, str]:
    named = [f for part in parts if isinstance(part, Plugin) for f in part.files(base)]
    return {Path(os.path.relpath(f, base)).as_posix(): _digest_of([f], None) for f in named}


# ------------------------------------------------------------------ full-order solution


IRRELEVANT: Mapping[str, Any] = {
    "title": "", "seed": 0, "check_stability": "warn", "check_trial_space": "warn",
    "check_strains": "warn", "output": {}, "probes": {}, "parameters": {}}
"""Keys of a scene that do not affect its solution, with the value to which they are reset. A new
key of `Scene` belongs here or in `RELEVANT`, which a test checks."""
REDUCTION = frozenset({"reducer", "training"})
"""Keys that affect a reduced model only."""
RELEVANT = frozenset({
    "format", "bodies", "joints", "contacts", "loads", "rigid_stage", "initial", "time",
    "integrator", "linear_solver", "linear_solvers"})
NOT_PHYSICS = (frozenset(IRRELEVANT) | REDUCTION) - {"parameters"}
"""Keys that may change without a new reference solution."""


def physics_of(scene: Scene, label: str) -> Scene:
    """Scene with every irrelevant setting reset, so that all scenes of the same physics have the
    same digest. label: origin of the changed keys in messages."""
    without = {f"training.{key}": None for key in ("parameters", "loads")
               if getattr(scene.training, key) is not None}
    reset = dict(IRRELEVANT)
    if any(isinstance(f, Controller) for f in scene.functions_of_time.values()):
        del reset["probes"]  # sensors
    return scene.using({**reset, **without}, label=label)


def training_physics(scene: Scene, own: Mapping[str, Any] | None = None) -> tuple[Scene, Scene]:
    """Scene of the training run, with its own changes if there are several, and the same with
    every irrelevant setting reset."""
    training = scene.for_training(own)
    return training, physics_of(training, "training")
