"""Files that others see with their old bytes or the new ones, never with a part of them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Names `path` in errors of the operating system that name no file, such as a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A temporary file next to `path`: it takes its place at the end, and goes on an error.

    The folder must exist: one that is gone was moved or removed, and is not made again.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with writing(path):
            yield part
            os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def replace_file(path: Path, data: bytes, *, synced: bool = False) -> None:
    """Write `path` as a whole. synced: its bytes are on the disk before it takes its place, so that
    it also survives a loss of power."""
    with replaced(path) as part:
        part.write_bytes(data)
        if synced:
            _sync(part)


def append_synced(path: Path, data: bytes) -> None:
    """Add to the end of `path`; on return it is on the disk."""
    with writing(path):
        with path.open("ab") as file:
            file.write(data)
        _sync(path)


def _sync(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())
