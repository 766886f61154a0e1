"""Files of ours in a folder: written, and listed in FOLDER/.sparsemor.jsonl before they get their
names (core/results/files/written_files.py)."""

import json
import os
import stat
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sparsemor.core.results.atomic_files import append_synced, replace_file
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.files.written_files import (
    LISTING,
    VERSION,
    Listing,
    Written,
    in_the_way,
    is_as_listed,
    is_free,
    is_kind,
    is_listing,
    read_listing,
    require_ours,
    written_in,
)


def add_to_listing(folder: Path, lines: Sequence[Mapping[str, Any]], kind: str = "") -> None:
    """Adds lines to the list of a folder, which is begun if there is none, with the kind of its
    content at the head. Raises InputError (key `out`) if a file of somebody else has its name."""
    file = folder / LISTING
    if os.path.lexists(file):
        if not is_listing(file):
            raise in_the_way(folder, [LISTING])
    else:
        lines = [{"sparsemor": VERSION, "kind": kind}, *lines]
    text = "".join(f"{json.dumps(line)}\n" for line in lines)
    with file.open("ab") as out:
        # what a process that was killed wrote last may be no whole line
        out.write((b"\n" if out.tell() else b"") + text.encode())


def add_part(folder: Path, name: str, kind: str = "") -> None:
    """Lists a folder in `folder` as its part, before something is written there. A folder that is
    there already and is no part remains somebody else's."""
    known = read_listing(folder)
    if known is not None and name in known.parts or os.path.lexists(folder / name):
        return
    add_to_listing(folder, [{"part": name}], kind)


def write_listed(folder: Path, name: str, data: bytes, *, synced: bool = False) -> Written:
    """Writes a file of ours into a folder, atomically, and lists it; returns its size and CRC-32.
    Raises InputError (key `out`) instead of replacing a file that is not ours."""
    require_ours(folder, [name])
    written = len(data), zlib.crc32(data)
    add_to_listing(folder, [line_of(name, written)])
    replace_file(folder / name, data, synced=synced)
    return written


def remove_listed(folder: Path, name: str) -> None:
    """Removes a file of ours from a folder. Raises InputError (key `out`) if it is not ours."""
    require_ours(folder, [name])
    (folder / name).unlink(missing_ok=True)


def append_listed(folder: Path, name: str, data: bytes, before: Written) -> Written:
    """Appends to a file of ours, flushed to disk, and lists it as it then is; returns its size and
    CRC-32. before: those that it had. The list grows before the file does: one that was changed in
    between is not ours."""
    written = before[0] + len(data), zlib.crc32(data, before[1])
    add_to_listing(folder, [line_of(name, written)])
    append_synced(folder / name, data)
    return written


@contextmanager
def publishing(folder: Path, kind: str = "", *, alone: bool = False) -> Iterator[Path]:
    """Context manager: temporary folder, whose files are moved to `folder` at the end and listed
    there. kind: of the content of a folder that has no list yet; alone: they belong to no result.

    Raises InputError (key `out`), moving nothing, if one would replace a file that is not ours.
    """
    with TemporaryFolder(folder) as fresh:
        yield fresh
        found = sorted(p.relative_to(fresh).as_posix() for p in fresh.rglob("*") if p.is_file())
        require_ours(folder, found)
        if found:
            add_to_listing(folder, [
                line_of(name, written_in(fresh / name), alone) for name in found], kind)
        for name in found:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(fresh / name, folder / name)


def list_file(file: Path, *, alone: bool = False) -> None:
    """Lists a file that this program has written into its folder. alone: it belongs to no
    result."""
    add_to_listing(file.parent, [line_of(file.name, written_in(file), alone)])


def line_of(name: str, written: Written, alone: bool = False) -> dict[str, Any]:
    """Line of a list for a file that is written with this size and CRC-32."""
    line = {"file": name, "size": written[0], "crc32": written[1]}
    return {**line, "alone": True} if alone else line


def drop_cut_line(folder: Path, name: str) -> None:
    """Cuts what follows the last whole line from a file of ours, if the lines are as listed."""
    written = (read_listing(folder) or Listing()).files.get(name, ())
    file = folder / name
    if written and not is_free(folder, name) and not is_as_listed(folder, name, written):
        last = file.read_bytes().rfind(b"\n") + 1
        if is_kind(file, stat.S_ISREG) and written_in(file, last) in written:
            os.truncate(file, last)
