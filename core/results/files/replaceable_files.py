"""Files of a result that this program wrote and nobody has changed since: what may be replaced.

The files of a result need no list: its header has a checksum and the identifier of its run, and
each archive ends with this identifier and the CRC-32 of its bytes. All other files are listed
(written_files.py). What is not listed, or is not as it was written, is somebody else's and stays.
"""

import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from sparsemor.core.errors import InputError
from sparsemor.core.results.atomic_files import unfinished
from sparsemor.core.results.checkpoint import SavedError, checkpoint_file, load_checkpoint
from sparsemor.core.results.files.written_files import (
    LISTING,
    is_as_listed,
    is_free,
    is_kind,
    read_listing,
    real_folder,
)
from sparsemor.core.results.npz_archive import is_archive
from sparsemor.core.results.stored_arrays import FIXED, HEADER, read_header, steps_files

STORE = "result"
"""Name of the folder of a result in the output directory of its run."""
_Signature = tuple[int, int, int]
"""Inode, size and time of the last change (ns) of a file that was found to be ours."""


@dataclass(frozen=True, slots=True)
class OwnFiles:
    """Files that this program wrote into a folder, and its parts.

    files: path relative to the folder -> signature; files by which others are known come before
    those. changed: listed paths that hold something else now.
    """

    files: dict[str, _Signature]
    changed: tuple[str, ...]

    @property
    def results(self) -> bool:
        """True if there is more than lists."""
        return any(PurePosixPath(p).name != LISTING for p in self.files)


# ------------------------------------------------------------------ what is ours


def own_files(folder: Path, *, checked: bool = True) -> OwnFiles:
    """Files in a folder that are ours, by its list, its store and its parts. checked: the content
    of its archives and checkpoints is compared with their checksums, else their ends only."""
    search = _Search(folder, checked)
    search.result("")
    return search.found()


def own_store(store: Path) -> OwnFiles:
    """Files of a store, whatever its name, that are ours."""
    search = _Search(store, True)
    search.store("")
    return search.found()


@dataclass(slots=True)
class _Search:
    """Search for our files in the folder `root`; paths are relative to it, and prefixes of them end
    in a slash."""

    root: Path
    checked: bool
    files: dict[str, _Signature] = field(default_factory=dict)
    changed: dict[str, None] = field(default_factory=dict)

    def found(self) -> OwnFiles:
        return OwnFiles(self.files, tuple(self.changed))

    def result(self, prefix: str) -> None:
        """Adds the files of the result in the folder root/prefix: by `_judge` those that are as
        they were written to our files, and to `changed` those with something else at their path.
        _judge(path, True if anything is there, True if it is as written); checked: the content of
        archives and checkpoints is compared with their checksums."""
        here = self.root / prefix
        listing = read_listing(here)
        if listing is not None:
            self._add(f"{prefix}{LISTING}")
            for name, written in listing.files.items():
                self._judge(f"{prefix}{name}", not is_free(here, name),
                            is_as_listed(here, name, written))
        if self.store(f"{prefix}{STORE}/"):
            name = checkpoint_file(Path(STORE)).name
            self._judge(f"{prefix}{name}", os.path.lexists(here / name),
                        _is_checkpoint(here / STORE, self.checked))
            self._add_unfinished(prefix)
        for part in () if listing is None else listing.parts:
            if real_folder(here, part):
                self.result(f"{prefix}{part}/")

    def store(self, prefix: str) -> bool:
        """Adds the files of the store root/prefix; returns True if it is one of ours. Its header
        has the identifier `run`, with which all archives of the store end. Files with something
        else at their path are `changed`: _judge(path, True if anything is there, True if it is
        ours)."""
        store = self.root / prefix
        header = store / HEADER
        if not is_kind(store, stat.S_ISDIR) or not os.path.lexists(header):
            return False
        try:
            run = read_header(store)["attributes"]["run"] if is_kind(header, stat.S_ISREG) else None
        except (InputError, OSError, KeyError):
            run = None
        self._judge(f"{prefix}{HEADER}", True, run is not None)
        if run is None:
            return False
        for file in (store / FIXED, *steps_files(store).values()):
            ours = is_kind(file, stat.S_ISREG) and is_archive(file, run, checked=self.checked)
            self._judge(f"{prefix}{file.name}", os.path.lexists(file), ours)
        self._add_unfinished(prefix)
        return True

    def _judge(self, path: str, listed: bool, ours: bool) -> None:
        """Adds a path to our files, or to those that are listed and changed."""
        if ours:
            self._add(path)
        elif listed:
            self.changed[path] = None

    def _add(self, path: str) -> None:
        signature = _signature(self.root / path)
        if signature is not None:
            self.files[path] = signature

    def _add_unfinished(self, prefix: str) -> None:
        """Adds what a process that was killed left of a file that it was writing next to ours."""
        with suppress(OSError):
            for entry in os.scandir(self.root / prefix):
                if unfinished(entry.name) and entry.is_file(follow_symlinks=False):
                    self._add(f"{prefix}{entry.name}")


def _is_checkpoint(store: Path, checked: bool) -> bool:
    """True if the checkpoint of a store is whole and of its run; not checked: if it exists."""
    if not is_kind(checkpoint_file(store), stat.S_ISREG) or not checked:
        return is_kind(checkpoint_file(store), stat.S_ISREG)
    try:
        found = load_checkpoint(store)
        return found is not None and found.run == read_header(store)["attributes"]["run"]
    except (SavedError, OSError, KeyError, InputError):
        return False


def _signature(path: Path) -> _Signature | None:
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


# ------------------------------------------------------------------ what is done with them


def remove(own: OwnFiles, folder: Path) -> bool:
    """Removes these files, and folders that they leave empty, in `folder`; files that were changed
    since they were found are left. The first of `own.files`, by which others are known to be ours,
    go last, so that a killed removal can be repeated. Returns False if one could not be removed."""
    whole = True
    for path in reversed(own.files):
        if _signature(folder / path) == own.files[path]:
            try:
                (folder / path).unlink()
            except OSError:
                whole = False
    _prune(own.files, folder)
    return whole


def move(own: OwnFiles, source: Path, target: Path, *, back: bool = False) -> None:
    """Moves these files from a folder to another one, folders with nothing else in them as a whole.
    Nothing is replaced: what finds its place taken stays. back: those by which others are known
    come last, so that a killed move can be repeated."""
    whole = _whole(own.files, source)
    done: set[str] = set()
    for path in reversed(own.files) if back else own.files:
        # the outermost folder with our files alone, else the file itself
        unit = next((f for f in _above(path) if f in whole), path)
        if unit in done:
            continue
        done.add(unit)
        if os.path.lexists(target / unit):
            inside = [p for p in own.files if p != unit and PurePosixPath(p).is_relative_to(unit)]
            for each in reversed(inside) if back else inside:
                _move_one(each, source, target)
        else:
            _move_one(unit, source, target)
    _prune(own.files, source)


def _move_one(path: str, source: Path, target: Path) -> None:
    if is_free(target, path) and os.path.lexists(source / path):
        (target / path).parent.mkdir(parents=True, exist_ok=True)
        os.replace(source / path, target / path)


def _above(path: str) -> list[str]:
    """Folders that contain a path, from the outermost."""
    return [p.as_posix() for p in reversed(PurePosixPath(path).parents) if p.parts]


def _whole(files: Mapping[str, _Signature], root: Path) -> set[str]:
    """Folders below `root` that contain these files and nothing else."""
    folders = {f for path in files for f in _above(path)}
    whole: set[str] = set()
    for folder in sorted(folders, key=len, reverse=True):  # those inside before those around
        with suppress(OSError):
            inside = [f"{folder}/{e.name}" for e in os.scandir(root / folder)]
            if all(p in files or p in whole for p in inside):
                whole.add(folder)
    return whole


def _prune(files: Mapping[str, _Signature], root: Path) -> None:
    """Removes the folders of these files that are empty now."""
    for folder in sorted({f for path in files for f in _above(path)}, key=len, reverse=True):
        with suppress(OSError):
            (root / folder).rmdir()
