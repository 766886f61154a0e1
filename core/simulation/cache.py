"""Disk cache of offline results, addressed by a digest of everything that they depend on."""

import json
import logging
import os
import re
import shutil
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import Arrays
from sparsemor.core.results.files.replaceable_files import STORE, own_files
from sparsemor.core.results.files.temporary_folders import NAME as TEMPORARY
from sparsemor.core.results.files.temporary_folders import TemporaryFolder, remove_left
from sparsemor.core.results.files.written_files import written_in

_MAPPED_BYTES = 2**24
_MANIFEST = "manifest.json"
SPENT = "spent.json"
"""File with the computing times of an entry."""
_FILE = re.compile(r"\d{3,}\.npy|manifest\.json|spent\.json")
"""Names of the files of an entry."""
MACHINE_CODE = "machine_code"
"""Kind of machine code (reducers/step/compiled/machine_code.py)."""
_MACHINE_CODE = re.compile(r"[0-9a-f]{32}\.code|\.[0-9a-f]{32}\.part|.+\.nb[ic]")
_UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, EOFError, MemoryError,
               RecursionError)
"""What is raised for a manifest or an array that this program has not written."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class CacheEntry:
    """A stored result of the offline stage, such as snapshots or a basis; size in bytes."""

    kind: str
    key: str
    size: int


def cache_folder() -> Path:
    """Root directory of the cache: environment variable `SPARSEMOR_CACHE`, else the user's cache
    directory."""
    named = os.environ.get("SPARSEMOR_CACHE")
    return Path(named) if named else own_cache_folder()


def own_cache_folder() -> Path:
    """Directory `sparsemor` in the user's cache directory."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sparsemor"


@dataclass(frozen=True, slots=True)
class Contents:
    """What is in a cache. entries: those that carry this program's mark, by kind and key;
    unreadable: number of folders that cannot be read, such as another user's."""

    entries: tuple[CacheEntry, ...]
    unreadable: int


@dataclass(frozen=True, slots=True)
class Removal:
    """What a removal did. freed: bytes; kept: number of entries that could not be removed."""

    freed: int
    kept: int


class Cache:
    """Disk cache of named arrays, by kind (such as "basis") and key (digest of the inputs). Safe
    for several processes: entries appear by an atomic rename.

    An entry is a folder KIND/KEY with a manifest of its files, which has a checksum; reference runs
    are stores of results, which have one too. Whatever else is in the folder of the cache is
    somebody else's and stays.
    """

    def __init__(self, root: str | Path | None = None) -> None:
        self.root = cache_folder() if root is None else Path(root)

    def get_or_make(
        self, kind: str, key: str, make: Callable[[], Arrays]
    ) -> tuple[Arrays, bool]:
        """Arrays of an entry, computed by `make` and stored if there is none, and True for a cache
        hit (`find`, `keep`)."""
        found = self.find(kind, key)
        return (self.keep(kind, key, make()), False) if found is None else (found, True)

    def find(self, kind: str, key: str) -> Arrays | None:
        """Arrays of an entry, None if there is none. Large arrays are read-only memory maps of
        their files. An entry that cannot be read is removed, with a logged warning."""
        place = self.place(kind, key)
        if not os.path.lexists(place):
            return None
        try:
            found = _load(place)
            with suppress(OSError):  # a cache that may only be read
                os.utime(place / _MANIFEST)  # the time of its last use
            return found
        except (OSError, *_UNREADABLE) as fault:
            _log.warning("cache entry %s/%s is unreadable (%s): made again", kind, key, fault)
            with suppress(OSError):
                _remove(place, [f.name for f in place.iterdir() if _FILE.fullmatch(f.name)])
            return None

    def keep(self, kind: str, key: str, arrays: Arrays) -> Arrays:
        """The arrays, stored as an entry and read from it. If they cannot be stored (disk full),
        the run continues without, and a warning is logged."""
        place, arrays = self.place(kind, key), dict(arrays)
        try:
            _save(self.root, place, arrays)
        except OSError as fault:
            _log.warning("cache entry %s/%s was not kept: %s", kind, key, fault)
            return arrays
        try:  # as a hit gets them: other strides in memory may round products differently
            return _load(place)
        except (OSError, ValueError, KeyError, TypeError):  # somebody clears the cache now
            return arrays

    def place(self, kind: str, key: str) -> Path:
        """Directory of an entry, whether it exists or not."""
        return self.root / kind / key

    def has(self, kind: str, key: str) -> bool:
        """True if there is an entry, which may be unreadable."""
        return os.path.lexists(self.place(kind, key) / _MANIFEST)

    def contents(self) -> Contents:
        """Entries of the cache, and the number of folders that cannot be read."""
        found: list[CacheEntry] = []
        unreadable = 0
        # unread: True for a folder that cannot be read; files None: of no entry of this program
        for kind, unread in _folders(self.root):
            if TEMPORARY.fullmatch(kind.name):
                continue
            unreadable += unread
            for place, unread_entry in () if unread else _folders(kind):
                try:
                    files = None if unread_entry else _files(place)
                    size = sum(os.lstat(place / f).st_size for f in files or ())
                except FileNotFoundError:  # somebody else removes it at this moment
                    continue
                except OSError:
                    unread_entry = True
                unreadable += unread_entry
                if not unread_entry and files is not None:
                    found.append(CacheEntry(kind.name, place.name, size))
        return Contents(tuple(found), unreadable)

    def entries(self) -> list[CacheEntry]:
        """Entries of the cache, by kind and key."""
        return list(self.contents().entries)

    def reduce(self, most: int, kind: str | None = None) -> Removal:
        """Removes the entries, or those of one kind, that were not used for the longest time until
        the others have at most `most` bytes; all of them if that is 0. kept: number of entries
        that could not be removed, such as those of which files are left."""
        remove_left(self.root)
        entries = [e for e in self.entries() if kind in (None, e.kind)]
        size = sum(e.size for e in entries)
        freed = kept = 0
        for entry in sorted(entries, key=self._last_use):
            if most and size <= most:
                break
            size -= entry.size
            place = self.place(entry.kind, entry.key)
            try:
                freed += _remove(place, _files(place) or ())
                kept += _files(place) is not None
            except FileNotFoundError:  # it is gone
                pass
            except OSError:
                kept += 1
            with suppress(OSError):
                place.parent.rmdir()
        return Removal(freed, kept)

    def shrink(self, most: int) -> int:
        """Removes the entries that were not used for the longest time until the others have at
        most this size, bytes; returns the bytes that were freed."""
        return self.reduce(most).freed

    def clear(self, kind: str | None = None) -> int:
        """Removes all entries, or those of one kind; returns the bytes that were freed."""
        return self.reduce(0, kind).freed

    def _last_use(self, entry: CacheEntry) -> float:
        """Time of the last use of an entry, s since the epoch; 0 where it is gone."""
        place = self.place(entry.kind, entry.key)
        times = []
        for file in (place / _MANIFEST, place):
            with suppress(OSError):
                times.append(file.stat().st_mtime)
        return times[0] if times else 0.0


def _folders(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Folders in a folder, sorted, and True for those that cannot be read. Symbolic links are no
    folders."""
    try:
        inside = sorted(e.path for e in os.scandir(folder) if e.is_dir(follow_symlinks=False))
    except OSError:
        return
    for path in inside:
        try:
            os.scandir(path).close()
        except FileNotFoundError:
            continue
        except OSError:
            yield Path(path), True
        else:
            yield Path(path), False


def _files(place: Path) -> list[str] | None:
    """Files of an entry, relative to its folder, in the order in which they may be removed: the one
    by which it is known as ours last (the manifest, or the header of a reference run); None if it
    is not ours. Raises OSError if it cannot be read. SPENT: file of the computing times."""
    if place.parent.name == MACHINE_CODE:
        names_of_code = sorted(f.name for f in place.iterdir() if _MACHINE_CODE.fullmatch(f.name))
        return names_of_code or None
    if (place / STORE).is_dir():
        # a reference run: known by its header, which `own_files` names before its arrays
        own_result = own_files(place, checked=False)  # without their contents' checksums
        return list(reversed(own_result.files)) if own_result.results else None
    try:
        names = sorted({file for file, _ in _table(place).values()})
    except (FileNotFoundError, *_UNREADABLE):  # without a manifest, or with a damaged one
        return None
    return [f for f in (*names, SPENT, _MANIFEST) if os.path.lexists(place / f)]


def _remove(entry: Path, files: Iterable[str]) -> int:
    """Removes files of an entry, and its folder if nothing else is in it; returns the bytes that
    were freed."""
    freed = 0
    for name in files:
        with suppress(OSError):
            size = os.lstat(entry / name).st_size
            (entry / name).unlink()
            freed += size
    for folder in sorted({p for f in files for p in (entry / f).parents
                          if entry in p.parents}, key=lambda p: len(p.parts), reverse=True):
        with suppress(OSError):
            folder.rmdir()
    with suppress(OSError):
        entry.rmdir()
    return freed


def _save(root: Path, entry: Path, arrays: Arrays) -> None:
    """Stores arrays as one entry of the cache: in a temporary folder, which is then renamed, so
    that no other process reads a part of it."""
    with TemporaryFolder(root) as folder:
        fresh = folder / entry.name
        fresh.mkdir()
        files = {name: f"{i:03d}.npy" for i, name in enumerate(arrays)}
        for name, file in files.items():
            written = _scratch_file(arrays[name])  # moved rather than copied
            if written is None:
                np.save(fresh / file, arrays[name], allow_pickle=False)
            else:
                shutil.move(written, fresh / file)
        # name -> its file, and the file's CRC-32
        table = {name: [file, written_in(fresh / file)[1]] for name, file in files.items()}
        (fresh / _MANIFEST).write_text(
            json.dumps({"program": "sparsemor", "checksum": _checksum(table), "files": table}),
            encoding="utf-8")
        entry.parent.mkdir(exist_ok=True)
        try:
            os.rename(fresh, entry)
        except OSError:
            if not (entry / _MANIFEST).exists():  # else another process was quicker
                raise


def _scratch_file(array: NDArray[Any]) -> str | None:
    """File of an array that fills a whole file in a temporary folder of ours, else None."""
    name = getattr(array, "filename", None)
    if name is None or not TEMPORARY.fullmatch(Path(name).parent.name):
        return None
    whole = getattr(array, "offset", 0) + array.nbytes == os.stat(name).st_size
    return str(name) if whole else None


def _load(entry: Path) -> dict[str, NDArray[Any]]:
    """Arrays of an entry. Raises ValueError, KeyError, TypeError or OSError if it is damaged or
    missing."""
    table = _table(entry)
    for file, kept in table.values():
        if written_in(entry / file)[1] != kept:
            raise ValueError(f"{file}: its checksum is not that of its bytes")
    return {name: _load_one(entry / file) for name, (file, _) in table.items()}


def _table(entry: Path) -> dict[str, list[Any]]:
    """Name of each array -> its file and the file's checksum, from the manifest, whose checksum is
    the mark of this program. Raises ValueError, KeyError, TypeError or OSError for others."""
    manifest = json.loads((entry / _MANIFEST).read_text(encoding="utf-8"))
    table: dict[str, list[Any]] = manifest["files"]
    if manifest["checksum"] != _checksum(table):
        raise ValueError(f"{_MANIFEST}: its checksum is not that of its content")
    if not all(_FILE.fullmatch(file) for file, _ in table.values()):
        raise ValueError(f"{_MANIFEST}: it names files elsewhere")
    return table


def _checksum(table: Mapping[str, object]) -> int:
    """CRC-32 of the table of a manifest."""
    return zlib.crc32(json.dumps(table).encode("utf-8"))


def _load_one(file: Path) -> NDArray[Any]:
    """Array of a file; a large one as a read-only memory map."""
    large = file.stat().st_size >= _MAPPED_BYTES
    array: NDArray[Any] = np.load(file, mmap_mode="r" if large else None, allow_pickle=False)
    return array
