"""Disk cache of offline results, addressed by a digest of everything that they depend on."""

import json
import logging
import os
import platform
import shutil
import tempfile
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import Arrays
from sparsemor.core.results.zarr_files import checksum

_MAPPED_BYTES = 2**24
_MANIFEST = "manifest.json"
_PIECE = 2**22
_SCRATCH = ".scratch."
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


class Cache:
    """Disk cache of named arrays, by kind (such as "basis") and key (digest of the inputs). Safe
    for several processes: entries appear by an atomic rename."""

    def __init__(self, root: str | Path | None = None) -> None:
        self.root = cache_folder() if root is None else Path(root)

    def get_or_make(
        self, kind: str, key: str, make: Callable[[], Arrays]
    ) -> tuple[dict[str, NDArray[Any]], bool]:
        """Arrays of an entry, computed by `make` and stored if there is none, and True for a cache
        hit. Large arrays are read-only memory maps of their files.

        An entry that cannot be read is recomputed with a logged warning; if the entry cannot be
        stored (disk full), the run continues without it.
        """
        place = self.place(kind, key)
        if place.exists():
            try:
                found = _load(place)
                with suppress(OSError):  # a cache that may only be read
                    os.utime(place / _MANIFEST)  # the time of its last use
                return found, True
            except (OSError, ValueError, KeyError, TypeError) as fault:
                _log.warning("cache entry %s/%s is unreadable (%s): made again", kind, key, fault)
                shutil.rmtree(place, ignore_errors=True)
        arrays = dict(make())
        try:
            _save(place, arrays)
        except OSError as fault:
            _log.warning("cache entry %s/%s was not kept: %s", kind, key, fault)
            return arrays, False
        try:  # as a hit gets them: other strides in memory may round products differently
            return _load(place), False
        except (OSError, ValueError):  # somebody clears the cache at this moment
            return arrays, False

    def place(self, kind: str, key: str) -> Path:
        """Directory of an entry, whether it exists or not."""
        return self.root / kind / key

    def entries(self) -> list[CacheEntry]:
        """Entries of the cache, by kind and key."""
        return [CacheEntry(p.parent.name, p.name, sum(f.stat().st_size for f in p.iterdir()))
                for p in sorted(self.root.glob("*/*")) if (p / _MANIFEST).exists()]

    def shrink(self, most: int) -> int:
        """Removes the entries that were not used for the longest time until the others have at
        most this size, bytes; returns the bytes that were freed."""
        def used(entry: CacheEntry) -> float:
            try:
                return (self.place(entry.kind, entry.key) / _MANIFEST).stat().st_mtime
            except OSError:  # somebody else removes it at this moment
                return 0.0

        entries = self.entries()
        size = before = sum(e.size for e in entries)
        for entry in sorted(entries, key=used):
            if size <= most:
                break
            shutil.rmtree(self.place(entry.kind, entry.key), ignore_errors=True)
            size -= entry.size
        return before - size

    def clear(self, kind: str | None = None) -> int:
        """Remove all entries, or those of one kind; returns the bytes that were freed."""
        freed = sum(e.size for e in self.entries() if kind in (None, e.kind))
        for folder in self.root.iterdir() if self.root.exists() else ():
            if kind in (None, folder.name):
                shutil.rmtree(folder)
        return freed


def _save(place: Path, arrays: Arrays) -> None:
    fresh = place.with_name(f".{place.name}.{uuid.uuid4().hex}")
    fresh.mkdir(parents=True)
    try:
        files = {name: f"{i:03d}.npy" for i, name in enumerate(arrays)}
        for name, file in files.items():
            written = _scratch_file(arrays[name])
            if written is None:
                np.save(fresh / file, arrays[name], allow_pickle=False)
            else:
                shutil.move(written, fresh / file)
        table = {name: [file, _checksum_of(fresh / file)] for name, file in files.items()}
        (fresh / _MANIFEST).write_text(
            json.dumps({"checksum": _checksum(table), "files": table}), encoding="utf-8")
        try:
            os.rename(fresh, place)
        except OSError:
            if not (place / _MANIFEST).exists():  # else another process was quicker
                raise
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def scratch_folder(root: Path | None) -> Path:
    """New scratch directory of this process: next to the cache's entries, or a temporary one if
    `root` is None.

    Scratch directories left behind by killed processes of this machine are removed.
    """
    if root is None:
        return Path(tempfile.mkdtemp(prefix=_SCRATCH))
    host = platform.node().replace(".", "-")
    for old in root.glob(f"{_SCRATCH}{host}.*"):
        pid = old.name.split(".")[3]
        if pid.isdigit() and not _alive(int(pid)):
            shutil.rmtree(old, ignore_errors=True)
    place = root / f"{_SCRATCH}{host}.{os.getpid()}.{uuid.uuid4().hex}"
    place.mkdir(parents=True)
    return place


def _alive(pid: int) -> bool:
    if os.name == "nt":  # where signal 0 is no question
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True


def _scratch_file(array: NDArray[Any]) -> str | None:
    """File of an array that fills a whole file in a scratch directory, else None."""
    name = getattr(array, "filename", None)
    if name is None or not Path(name).parent.name.startswith(_SCRATCH):
        return None
    whole = getattr(array, "offset", 0) + array.nbytes == os.stat(name).st_size
    return str(name) if whole else None


def _load(place: Path) -> dict[str, NDArray[Any]]:
    """Arrays of an entry. Raises ValueError, KeyError, TypeError or OSError if it is damaged or
    missing."""
    manifest = json.loads((place / _MANIFEST).read_text(encoding="utf-8"))
    table: dict[str, list[Any]] = manifest["files"]
    if manifest["checksum"] != _checksum(table):
        raise ValueError(f"{_MANIFEST}: its checksum is not that of its content")
    for file, kept in table.values():
        if _checksum_of(place / file) != kept:
            raise ValueError(f"{file}: its checksum is not that of its bytes")
    return {name: _load_one(place / file) for name, (file, _) in table.items()}


def _checksum(table: Mapping[str, object]) -> int:
    return checksum(json.dumps(table).encode("utf-8"))


def _checksum_of(file: Path) -> int:
    """CRC-32C checksum of a file, read in blocks."""
    found = 0
    with file.open("rb") as data:
        while piece := data.read(_PIECE):
            found = checksum(piece, found)
    return found


def _load_one(file: Path) -> NDArray[Any]:
    large = file.stat().st_size >= _MAPPED_BYTES
    array: NDArray[Any] = np.load(file, mmap_mode="r" if large else None, allow_pickle=False)
    return array
