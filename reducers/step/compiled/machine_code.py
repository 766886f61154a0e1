"""Machine code that is kept between runs: files that only their user can have written.

Compiled code is no data: who can write it can run anything as the user who loads it. The cache may
be shared, so each file must belong to the user and be writable by nobody else, and so must its
folder; otherwise the code is kept in the user's own cache folder, or not at all. The digest of a
file is checked before anything else is made of its bytes.
"""

import hashlib
import os
import stat
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from sparsemor.core.simulation.cache import MACHINE_CODE, cache_folder, own_cache_folder

_SUFFIX = ".code"
_READ = (os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
         | getattr(os, "O_BINARY", 0))
_WRITE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


class MachineCode:
    """Kept machine code with one name, a digest of its sources: bytes by key, which describes a
    function, its types and the processor. folder: the first private place that has some, else the
    first of all; None if no place is private. make: False not to make one."""

    def __init__(self, name: str, make: bool = True) -> None:
        places = [root / name for root in _roots()]
        filled = (f for p in places if (f := _own_folder(p, False)) and _holds_code(f))
        self.folder = next(filled, None) or next(
            (f for p in places if (f := _own_folder(p, make))), None)

    def __bool__(self) -> bool:
        """True if something is kept."""
        return self.folder is not None and _holds_code(self.folder)

    def read(self, key: str) -> bytes | None:
        """Bytes that `write` kept; None if there are none, they are damaged, or somebody else can
        have written them."""
        if self.folder is None:
            return None
        with suppress(OSError), os.fdopen(os.open(self._file(key), _READ), "rb") as file:
            if _private(os.fstat(file.fileno()), stat.S_ISREG):
                digest, data = file.read(32), file.read()
                return data if digest == _digest(key, data) else None
        return None

    def write(self, key: str, data: bytes) -> None:
        """Keeps bytes; a disk that is full or read-only keeps none."""
        if self.folder is None:
            return
        part = self.folder / f".{uuid.uuid4().hex}.part"
        try:
            with os.fdopen(os.open(part, _WRITE, 0o600), "wb") as file:
                file.write(_digest(key, data) + data)
            part.replace(self._file(key))
        except OSError:
            with suppress(OSError):
                part.unlink()

    def _file(self, key: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}{_SUFFIX}"


def _holds_code(folder: Path) -> bool:
    """True if a folder has machine code."""
    return any(folder.glob(f"*{_SUFFIX}"))


def _roots() -> Iterator[Path]:
    if hasattr(os, "geteuid"):  # else nothing says who has written to a folder that may be shared
        yield cache_folder() / MACHINE_CODE
    with suppress(RuntimeError):  # no home
        yield own_cache_folder() / MACHINE_CODE


def _own_folder(folder: Path, make: bool) -> Path | None:
    """The folder, made if need be and wanted; None unless it belongs to this user, who alone can
    write."""
    with suppress(OSError):
        if make:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileExistsError):
                folder.mkdir(mode=0o700)
        if _private(folder.lstat(), stat.S_ISDIR):
            return folder
    return None


def _private(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    """True for a file or folder that is the user's and that no other user can write. On systems
    without owners of files, that of the user's profile."""
    if not is_kind(found.st_mode):
        return False
    if not hasattr(os, "geteuid"):
        return True
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _digest(key: str, data: bytes) -> bytes:
    return hashlib.sha256(key.encode() + b"\0" + data).digest()
