"""List of the files that this program wrote into a folder: FOLDER/.sparsemor.jsonl.

Each line is a JSON object. The first has the kind of the result. Those of files have their size and
CRC-32, and are written before the file gets its name. A folder with a result of its own that
belongs to the one above (a run of a comparison or study, an export) is listed as its part. What
stands on runs writes such lists (plugins/publishing/listed_files.py). A file that is not listed, or
is not as it was written, is somebody else's. Symbolic links are never followed.
"""

import json
import os
import re
import stat
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

from sparsemor.core.errors import InputError

LISTING = ".sparsemor.jsonl"
VERSION = 2
"""Version of the list. Version 1 had other checksums: its files count as somebody else's."""
_PIECE = 2**22
Written = tuple[int, int]
"""Size and CRC-32 of a file."""


@dataclass(frozen=True, slots=True)
class Listing:
    """Content of a list. kind: kind of the result; files: path -> size and CRC-32 at each time it
    was written; parts: folders with lists or stores of their own; alone: files as in `files` that
    belong to no result, such as kept models."""

    kind: str = ""
    files: Mapping[str, Sequence[Written]] = field(default_factory=dict)
    parts: Sequence[str] = ()
    alone: Mapping[str, Sequence[Written]] = field(default_factory=dict)


def read_listing(folder: Path) -> Listing | None:
    """List of a folder; None if it has none."""
    file = folder / LISTING
    if not is_kind(file, stat.S_ISREG):
        return None
    try:
        lines = [_parsed(line) for line in file.read_bytes().splitlines()]
    except OSError:
        return None
    if not lines or lines[0].get("sparsemor") != VERSION:
        return None
    files: dict[str, list[Written]] = {}
    alone: dict[str, list[Written]] = {}
    parts: dict[str, None] = {}
    for line in lines:  # paths that would leave the folder are no entries
        if _inside(line.get("part")):
            parts[line["part"]] = None
        if _inside(line.get("file")):
            (alone if line.get("alone") else files).setdefault(line["file"], []).append(
                (line.get("size", -1), line.get("crc32", -1)))
    kind = lines[0].get("kind")
    return Listing(kind if isinstance(kind, str) else "", files, tuple(parts), alone)


def is_listing(file: Path) -> bool:
    """True if a file begins as a list does."""
    if not is_kind(file, stat.S_ISREG):
        return False
    with file.open("rb") as lines:
        return bool(_parsed(lines.readline()).get("sparsemor") == VERSION)


def require_ours(folder: Path, names: Sequence[str]) -> None:
    """Raises InputError (key `out`) if something is at one of these paths in `folder` that this
    program did not write or that was changed since."""
    known = read_listing(folder) or Listing()
    taken = [n for n in names if not is_free(folder, n) and not is_as_listed(
        folder, n, (*known.files.get(n, ()), *known.alone.get(n, ())))]
    if taken:
        raise in_the_way(folder, taken)


def in_the_way(folder: Path, names: Sequence[str]) -> InputError:
    """InputError (key `out`) that names files which a command would have to replace."""
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return InputError(f"{folder / names[0]}{more}: not written by sparsemor, or changed since, and "
                      "therefore not replaced: move it away, or choose another --out", "out")


# ------------------------------------------------------------------ files and paths


def is_as_listed(folder: Path, name: str, written: Sequence[Written]) -> bool:
    """True if a file, which no symbolic link leads to, is as it was written at some time, or as it
    is where the end of the process, or a full disk, cut what was being appended to it. written:
    its size and CRC-32 each time that it was written, in that order."""
    file, parent = folder / name, PurePosixPath(name).parent.as_posix()
    if not is_kind(file, stat.S_ISREG) or parent != "." and not real_folder(folder, parent):
        return False
    try:
        size = os.lstat(file).st_size
        exact = any(w[0] == size for w in written) and written_in(file) in written
        return exact or any(before[0] < size < after[0] and written_in(file, before[0]) == before
                            for before, after in pairwise(written))
    except OSError:
        return False


def is_free(folder: Path, name: str) -> bool:
    """True if nothing is at a path in a folder, and a file can be written there."""
    parts = PurePosixPath(name).parts
    for i in range(1, len(parts)):
        place = folder.joinpath(*parts[:i])
        if not os.path.lexists(place):
            return True
        if not is_kind(place, stat.S_ISDIR):
            return False
    return not os.path.lexists(folder / name)


def written_in(file: Path, most: int | None = None) -> Written:
    """Size and CRC-32 of a file, or of its first `most` bytes; it is read in pieces."""
    size = found = 0
    with file.open("rb") as data:
        while piece := data.read(_PIECE if most is None else min(_PIECE, most - size)):
            size, found = size + len(piece), zlib.crc32(piece, found)
    return size, found


def is_kind(path: Path, kind: Callable[[int], bool]) -> bool:
    """True if the mode of a path, symbolic links not followed, is of a kind: `stat.S_ISREG`, .."""
    try:
        return bool(kind(os.lstat(path).st_mode))
    except (OSError, ValueError):
        return False


def real_folder(folder: Path, name: str) -> bool:
    """True for a folder below `folder` that is reached through no symbolic link."""
    parts = PurePosixPath(name).parts
    return all(is_kind(folder.joinpath(*parts[:i + 1]), stat.S_ISDIR) for i in range(len(parts)))


def _inside(name: object) -> bool:
    """True for a relative path that stays below its folder."""
    if not isinstance(name, str) or re.search("\0", name):
        return False
    parts = PurePosixPath(name).parts
    return bool(parts) and not {"..", "/"} & set(parts) and "/".join(parts) == name


def _parsed(line: bytes) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
