"""Exclusive use of an output directory: an advisory lock that the end of its process releases."""

import errno
import itertools
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import MappingProxyType

from sparsemor.core.errors import InputError

LOCK = ".lock"
"""The locked file. One that a killed process leaves is harmless."""
_ATTEMPTS = 100
_held: ContextVar[Mapping[Path, int]] = ContextVar("held", default=MappingProxyType({}))


def inode(path: Path | int) -> tuple[int, int] | None:
    """Device and inode of a file; None when there is none."""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return found.st_dev, found.st_ino


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """The folder, made if it is missing, for this run alone; nested use in one thread is one use.

    At the end the folders that were made here and are empty are removed, and no others. Raises
    InputError when another run has the folder or it cannot be written to. On Windows, and on file
    systems without locks, nothing is locked.
    """
    place = Path(os.path.realpath(folder))
    if place in _held.get():
        yield
        return
    made: list[Path] = []
    try:
        lock = _locked(place, folder, made)
        token = _held.set({**_held.get(), place: lock})
        try:
            yield
        finally:
            _held.reset(token)
            if sys.platform == "win32":
                os.close(lock)
                (place / LOCK).unlink(missing_ok=True)
            else:  # removed while it is locked: whoever waits for it finds that it is gone
                if inode(place / LOCK) == inode(lock):
                    (place / LOCK).unlink(missing_ok=True)
                os.close(lock)
    finally:
        for path in reversed(made):
            try:
                path.rmdir()
            except OSError:  # somebody else's files are in it
                break


class FixedFolder:
    """A folder that has to stay where it is, and the same, while it is written to."""

    def __init__(self, path: Path) -> None:
        self.path, self._inode = path, inode(path)

    def in_place(self) -> bool:
        """False when it was moved, removed or replaced."""
        return inode(self.path) == self._inode

    @contextmanager
    def kept(self, stored: float) -> Iterator[None]:
        """Raises OSError when it is not in place before or after the writing inside; stored: time
        of the last step that was stored before, s."""
        self._check(stored)
        try:
            yield
        except FileNotFoundError:
            self._check(stored)
            raise
        self._check(stored)

    def _check(self, stored: float) -> None:
        if not self.in_place():
            until = f"stored up to t = {stored:g} s" if stored >= 0.0 else "no step was stored"
            raise FileNotFoundError(
                errno.ENOENT, "the result was moved, removed or replaced while the run wrote to it "
                f"({until}); --resume continues one that was moved where it is now",
                str(self.path))


def check_owned(folder: Path) -> None:
    """Raises OSError when the folder is owned here, and was moved, removed or replaced."""
    if lost(folder):
        raise FileNotFoundError(
            errno.ENOENT, "the output directory was moved, removed or replaced during the run",
            str(folder))


def lost(folder: Path) -> bool:
    """True for a folder that is owned here and was moved, removed or replaced since."""
    place = Path(os.path.realpath(folder))
    lock = _held.get().get(place)
    return lock is not None and inode(place / LOCK) != inode(lock)


def _locked(place: Path, folder: Path, made: list[Path]) -> int:
    """The descriptor of the locked file, which is the one in the folder. Folders that were made
    are added to `made`."""
    for attempt in itertools.count():
        try:
            _make(place, made)
            file = os.open(place / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            if isinstance(error, FileNotFoundError) and attempt < _ATTEMPTS:
                continue  # another run removed its empty folders at this moment
            there = next(p for p in (folder, *folder.parents, Path()) if os.path.exists(p))
            raise InputError(f"{folder}: {there} is not writable ({error.strerror}): "
                             "choose another --out", "out") from None
        if not _lock(file):
            os.close(file)
            raise InputError(f"another run is writing to {folder}: wait for it, or choose "
                             "another --out", "out")
        if inode(place / LOCK) == inode(file):
            return file
        os.close(file)
    raise AssertionError  # the loop has no end of its own


def _lock(file: int) -> bool:
    """False when another process, or another run of this one, has locked the file."""
    if sys.platform == "win32":
        return True
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # this file system has no locks
        pass
    return True


def _make(place: Path, made: list[Path]) -> None:
    if os.path.isdir(place):
        return
    _make(place.parent, made)
    try:
        place.mkdir()
        made.append(place)
    except FileExistsError:
        if not place.is_dir():
            raise
