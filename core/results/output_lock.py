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

LOCK = ".sparsemor.lock"
"""Name of the locked file. A lock file that a killed process leaves is harmless."""
_ATTEMPTS = 100
_held: ContextVar[Mapping[Path, int]] = ContextVar("held", default=MappingProxyType({}))


def inode(path: Path | int) -> tuple[int, int] | None:
    """(device, inode) of a file or file descriptor; None if it does not exist."""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return found.st_dev, found.st_ino


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Context manager: exclusive use of a folder, which is created if missing; reentrant within one
    thread.

    At the end, folders that were created here and are empty are removed. Raises InputError when
    another run has locked the folder or it is not writable. On Windows, and on file systems without
    locks, nothing is locked.
    """
    real_path = Path(os.path.realpath(folder))
    if real_path in _held.get():
        yield
        return
    created: list[Path] = []
    try:
        lock = _locked(real_path, folder, created)
        token = _held.set({**_held.get(), real_path: lock})
        try:
            yield
        finally:
            _held.reset(token)
            ours = os.fstat(lock).st_size == 0 and inode(real_path / LOCK) == inode(lock)
            windows = sys.platform == "win32"  # where nothing is locked, and no open file removed
            if windows:
                os.close(lock)
            if ours:  # removed while it is locked: whoever waits for it finds that it is gone
                (real_path / LOCK).unlink(missing_ok=True)
            if not windows:
                os.close(lock)
    finally:
        for path in reversed(created):
            try:
                path.rmdir()
            except OSError:  # somebody else's files are in it
                break


class FixedFolder:
    """Folder, identified by its inode, that must not be moved, removed or replaced while it is
    written to."""

    def __init__(self, path: Path) -> None:
        self.path, self._inode = path, inode(path)

    def in_place(self) -> bool:
        """False if the folder was moved, removed or replaced."""
        return inode(self.path) == self._inode

    @contextmanager
    def kept(self, stored: float) -> Iterator[None]:
        """Context manager for writing: raises OSError when the folder is not in place before or
        after it.

        stored: time of the last step stored before, s; negative: no step was stored.
        """
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
    """Raises OSError if this process locked the folder and it was moved, removed or replaced
    since."""
    if lost(folder):
        raise FileNotFoundError(
            errno.ENOENT, "the output directory was moved, removed or replaced during the run",
            str(folder))


def lost(folder: Path) -> bool:
    """True if this process locked the folder and it was moved, removed or replaced since."""
    place = Path(os.path.realpath(folder))
    lock = _held.get().get(place)
    return lock is not None and inode(place / LOCK) != inode(lock)


def _locked(real_path: Path, folder: Path, created: list[Path]) -> int:
    """File descriptor of the locked file of the folder `real_path`; folders that are made for it
    are appended to `created`.

    folder: the path as the user wrote it, for messages. Raises InputError when the folder is locked
    by another run or not writable.
    """
    for attempt in itertools.count():
        try:
            _make(real_path, created)
            file = os.open(real_path / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
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
        if inode(real_path / LOCK) == inode(file):
            return file
        os.close(file)  # another run removed the file before it was locked: once more
    raise AssertionError  # the loop has no end of its own


def _lock(file: int) -> bool:
    """Locks the file without waiting; False if another run has locked it."""
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


def _make(real_path: Path, created: list[Path]) -> None:
    """Makes a folder with those above it; adds those that are new to `created`."""
    if os.path.isdir(real_path):
        return
    _make(real_path.parent, created)
    try:
        real_path.mkdir()
        created.append(real_path)
    except FileExistsError:
        if not real_path.is_dir():
            raise
