"""Temporary folders, removed with the object that holds them, at the latest when its process ends.

A process that is killed leaves its folders. Their names have its number, so the next process that
makes one at the same place removes them.
"""

import os
import platform
import re
import shutil
import tempfile
import uuid
import weakref
from pathlib import Path

NAME = re.compile(r"\.sparsemor-tmp\.(?P<host>.*)\.(?P<pid>\d+)\.[0-9a-f]{32}")
"""Name of a temporary folder: host, process and a random number."""


class TemporaryFolder:
    """New folder in `parent`, which is created if missing, or in that of the system for temporary
    files if None; removed with this object.

    Those of processes of this machine that are gone are removed first.
    """

    def __init__(self, parent: Path | None = None) -> None:
        place = Path(tempfile.gettempdir()) if parent is None else parent
        place.mkdir(parents=True, exist_ok=True)
        remove_left(place)
        name = f".sparsemor-tmp.{_host()}.{os.getpid()}.{uuid.uuid4().hex}"
        self.path = (place / name).absolute()
        self.path.mkdir(mode=0o700 if parent is None else 0o777)
        self._end = weakref.finalize(self, _remove, self.path, os.getpid())

    def remove(self) -> None:
        """Removes the folder now."""
        self._end()

    def keep_until_exit(self) -> None:
        """Keeps the folder until this process ends, for copies of what refers to it."""
        _kept.append(self)

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.remove()


_kept: list[TemporaryFolder] = []


def remove_left(place: Path) -> None:
    """Removes the temporary folders in `place` that killed processes of this machine left."""
    for old in place.glob(".sparsemor-tmp.*"):
        found = NAME.fullmatch(old.name)
        if found and found["host"] == _host() and not _alive(int(found["pid"])) and (
                not old.is_symlink()):
            shutil.rmtree(old, ignore_errors=True)


def remove_of(folder: Path, process: int) -> None:
    """Removes a temporary folder of a process that is gone, where others may still write."""
    found = NAME.fullmatch(folder.name)
    if found and int(found["pid"]) == process and not folder.is_symlink():
        for _ in range(3):
            shutil.rmtree(folder, ignore_errors=True)


def _remove(path: Path, process: int) -> None:
    if os.getpid() == process:  # not in a copy of the process
        shutil.rmtree(path, ignore_errors=True)


def _host() -> str:
    return platform.node().replace(os.sep, "-") or "-"


def _alive(pid: int) -> bool:
    """False if there is certainly no process with this number."""
    if os.name == "nt":  # where signal 0 is no question
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True
