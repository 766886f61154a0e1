"""Source of a scene: its parsed data, its file, and the changes to it."""

from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from sparsemor.core.errors import Fault, InputError
from sparsemor.core.notes import Note
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.registry.validation_errors import dotted, faults_of
from sparsemor.core.scene.overrides import apply, find
from sparsemor.core.scene.parameters_and_training_points import with_values
from sparsemor.core.scene.yaml_reader import (
    MOST_BYTES,
    Document,
    KeyPath,
    LocatedError,
    located,
    parse,
    too_large,
)

_LAST = (1 << 30, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Data of a scene before validation.

    document: the parsed file; tree: its data with changes; folder: where the file is, None when
    there is no file; origins: changed path -> (label of the change, the key that was set); notes:
    on how overrides of the reducer were understood.
    """

    document: Document
    tree: dict[str, Any]
    registry: Registry
    folder: Path | None = None
    origins: Mapping[KeyPath, tuple[str, str]] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    @classmethod
    def read(cls, scene: str | Path, registry: Registry, kind: str = "scene") -> "Source":
        """Source from a packaged scene (or study, with that `kind`) or a file."""
        path = _path(scene, registry, kind)
        try:
            if path.stat().st_size > MOST_BYTES:
                raise too_large(str(path), kind)
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise _unreadable(path, f"cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise _unreadable(path, "is not UTF-8 text") from None
        return cls.of_text(text, str(path), registry, path.parent.absolute(), kind)

    @classmethod
    def of_text(
        cls, text: str, name: str, registry: Registry, folder: Path | None = None,
        kind: str = "scene",
    ) -> "Source":
        document = parse(text, name, kind)
        return cls(document, deepcopy(document.tree), registry, folder)

    @classmethod
    def of_tree(
        cls, tree: dict[str, Any], registry: Registry | None = None, name: str = ""
    ) -> "Source":
        """Source of a scene that has no file. name: of the scene."""
        return cls(Document(name, tree), tree, registry or Registry())

    @property
    def name(self) -> str:
        return Path(self.document.name).stem or "scene"

    @property
    def context(self) -> dict[str, Any]:
        """Context for pydantic's validation, with the registry of plugins."""
        return {"registry": self.registry}

    def changed(self, overrides: Mapping[str, Any], label: str) -> "Source":
        """Source with overrides applied. Raises `LocatedError` when a key cannot be changed."""
        try:
            made = apply(self.tree, with_values(self.tree, overrides), self.registry)
        except InputError as error:
            lines = [_changed(label, f.key, f.key, f.message) for f in error.faults]
            raise LocatedError(error.faults, lines) from None
        named = {path: (label, key) for path, key in made.origins.items()}
        kept = {p: o for p, o in self.origins.items() if not _inside(p, named)}
        earlier = () if made.new_reducer else self.notes
        return replace(self, tree=made.tree, origins=kept | named, notes=(*earlier, *made.notes))

    def invalid(self, error: ValidationError) -> LocatedError:
        """Error with pydantic's faults, each with its key and position in the file."""
        return self.locate(faults_of(error, self.tree))

    def locate(self, faults: Iterable[Fault]) -> LocatedError:
        ordered = sorted(faults, key=lambda f: self._order(find(self.tree, f.key)))
        return LocatedError(ordered, [self._line(f) for f in ordered])

    def lines(self, error: InputError) -> list[str]:
        if isinstance(error, LocatedError):
            return list(error.lines)
        return list(self.locate(error.faults).lines)

    def origin(self, key: str) -> tuple[str, str] | None:
        """Label and option of the change that set a dotted key; None where its value is from the
        file."""
        return self._origin(find(self.tree, key))

    def _origin(self, path: KeyPath) -> tuple[str, str] | None:
        inside = (path[:n] for n in range(len(path), 0, -1))
        about = [*inside, (*path, "use")]  # an unknown name is a fault of the slot around it
        if path not in self.document.positions:
            about += [p for p in self.origins if p[:len(path)] == path]
        return next((self.origins[p] for p in about if p in self.origins), None)

    def _order(self, path: KeyPath) -> tuple[tuple[int, int], str]:
        place = _LAST if self._origin(path) else self.document.place(path)
        return place, dotted(path)

    def _line(self, fault: Fault) -> str:
        """Message of a fault with file, line and column of its key, or with the override that set
        it."""
        path = find(self.tree, fault.key)
        origin = self._origin(path)
        if origin is not None:
            label, option = origin
            # of changes that the file itself has, such as `training.overrides`
            written: KeyPath = (*label.split("."), option)
            if written not in self.document.positions:
                return _changed(label, option, fault.key, fault.message)
            place = self.document.place(written)
            return located(self.document.name, place, dotted(written), fault.message)
        if not self.document.name:
            return f"{fault.key}: {fault.message}" if fault.key else fault.message
        return located(self.document.name, self.document.place(path), fault.key, fault.message)


def _changed(label: str, option: str, key: str, message: str) -> str:
    inner = f"{key}: " if key != option and key else ""
    return f"{label} {option}: {inner}{message}" if option else message


def _inside(path: KeyPath, changed: Iterable[KeyPath]) -> bool:
    return any(path[:len(c)] == c for c in changed)


def _path(scene: str | Path, registry: Registry, kind: str) -> Path:
    """Path of a packaged scene or study, or of a file. Raises LocatedError where there is
    neither."""
    if isinstance(scene, str) and registry.has(kind, scene):
        try:
            return Path(registry.load(kind, scene))
        except InputError as error:  # two packages offer it
            raise LocatedError(error.faults, [str(error)]) from None
    path = Path(scene)
    if path.is_file():
        return path
    if isinstance(scene, Path) or any(c in scene for c in "/\\.") or path.is_dir():
        what = f"is a directory, not a {kind} file" if path.is_dir() else "there is no such file"
        raise _unreadable(path, what)
    message = (f"no packaged {kind}, and no file, is called {scene!r}: "
               + suggestions(scene, packaged(registry, kind), "packaged"))
    raise LocatedError([Fault("", message)], [message])


def packaged(registry: Registry, kind: str) -> list[str]:
    """Sorted names of the packaged scenes or studies."""
    return sorted(map(registry.spelling, registry.names(kind)))


def _unreadable(path: Path, what: str) -> LocatedError:
    message = f"{path}: {what}"
    return LocatedError([Fault("", message)], [message])
