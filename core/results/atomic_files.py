"""Atomic file replacement: other processes read either the old content or the new one, never a
part."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context manager that adds `path` to operating-system errors that name no file, such as a full
    disk."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Context manager: temporary file next to `path` that replaces `path` at the end and is removed
    on an error.

    The folder must exist: a missing folder was moved or removed during the run and is not created
    again.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with writing(path):
            yield part
            os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def unfinished(name: str) -> bool:
    """True for the name of a temporary file of `replaced`, which a killed process leaves."""
    return bool(re.fullmatch(r"\..+\.\d+\.part", name))


def replace_file(path: Path, data: bytes | memoryview, *, synced: bool = False) -> None:
    """Replaces the file `path` by `data`. synced: flush the bytes to disk before the replacement,
    so that the file survives a loss of power."""
    with replaced(path) as part:
        part.write_bytes(data)
        if synced:
            _sync(part)


def append_synced(path: Path, data: bytes) -> None:
    """Appends `data` to the file `path` and flushes it to disk before returning."""
    with writing(path):
        with path.open("ab") as file:
            file.write(data)
        _sync(path)


def _sync(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())
