"""Output directories: write access, and replacement of an earlier result.

With `--force` the files of the earlier result (files/replaceable_files.py) are kept in
OUT/.replaced until the new run has ended; whatever else is in OUT stays where it is. A process that
is killed at any moment leaves either the earlier result in OUT, or the earlier result in
OUT/.replaced and the steps that the new run stored in OUT. Only the process that holds the lock of
OUT changes it (output_lock.py).
"""

import json
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from sparsemor.core.errors import InputError
from sparsemor.core.results.checkpoint import SavedError, checkpoint_file, load_checkpoint
from sparsemor.core.results.files.replaceable_files import STORE, OwnFiles, move, own_files, remove
from sparsemor.core.results.files.temporary_folders import NAME as TEMPORARY
from sparsemor.core.results.files.written_files import (
    LISTING,
    Listing,
    in_the_way,
    read_listing,
    require_ours,
)
from sparsemor.core.results.output_lock import LOCK, lost, owned
from sparsemor.core.results.stored_arrays import HEADER
from sparsemor.core.status import SolveFailed, Status

KEPT, MOVING = ".replaced", ".replaced.part"
COMPARISON = "comparison"
"""Kind of the list of a comparison."""
_TABLES = ("errors.csv", "table.csv")
"""Files that mark a complete comparison (`errors.csv`) or study (`table.csv`)."""
_SCRATCH = f".{STORE}."


class OutputDirectory:
    """Directory that a command (run, comparison, study, stability survey, export or new plugin
    package) writes to."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    # ------------------------------------------------------------------ what is there

    @property
    def store(self) -> Path:
        """Path of the folder that contains the result of a run."""
        return self.path / STORE

    def entries(self) -> list[Path]:
        """Files and folders of a run or a user, sorted; without lock files and leftovers of a
        killed run."""
        return [p for p in sorted(self.path.iterdir()) if not _nothing(p)]

    def is_result(self) -> bool:
        """True if the directory contains the result of a run."""
        return (self.store / HEADER).is_file()

    def is_run_or_comparison(self) -> bool:
        """True if the directory contains the result of a run or of a comparison."""
        listing = read_listing(self.path)
        return self.is_result() or listing is not None and listing.kind == COMPARISON

    def kept_note(self) -> str:
        """Clause for error messages that names the folder of the kept earlier result; empty where
        there is none."""
        kept = self.path / KEPT
        return f"; the earlier one is kept in {kept}" if own_files(kept).results else ""

    # ------------------------------------------------------------------ who may write

    def occupied(self) -> bool:
        """True if the path is a file, or a directory with files of a run or a user."""
        return self.path.exists() and (not self.path.is_dir() or bool(self.entries()))

    def make(self) -> None:
        """Creates the directory and its parents. Raises InputError (key `out`) on failure."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be made ({error.strerror}): choose another "
                             "--out", "out") from None

    def require_empty(self, advice: str) -> None:
        """Raises InputError (key `out`) if the path is a file, or a directory that is not empty;
        the message for the latter ends in `advice`."""
        if self.path.exists() and not self.path.is_dir():
            raise InputError(f"{self.path}: this is a file: choose a directory", "out")
        if self.occupied():
            raise InputError(f"{self.path}: output directory is not empty: {advice}", "out")

    def require_replaceable(
        self, force: bool, advice: str, replaceable: Callable[[], bool], kind: str
    ) -> None:
        """Raises InputError (key `out`) unless the directory is empty, or `force` is set and
        `replaceable()` is true.

        advice: end of the message without `force`; kind: kind of content that `force` may replace,
        for the message.
        """
        if not force or self.path.exists() and not self.path.is_dir():
            self.require_empty(advice)
        elif self.occupied() and not replaceable():
            raise InputError(f"{self.path}: --force replaces {kind}", "out")

    def require_writable(self) -> None:
        """Raises InputError (key `out`) if the directory contains a result already, or something
        where one would be written, or is not writable."""
        if self.is_result():
            raise InputError(f"{self.path} already contains a result: use --resume to continue, "
                             "--force to overwrite, or choose another --out", "out")
        if os.path.lexists(self.store) and not stat.S_ISDIR(os.lstat(self.store).st_mode):
            raise in_the_way(self.path, [STORE])
        try:
            # read to see that it is ours: one without its store is removed by the new run
            load_checkpoint(self.store)
        except (SavedError, OSError):
            raise in_the_way(self.path, [checkpoint_file(self.store).name]) from None
        place = self.path
        while not place.exists():
            place = place.parent
        if not place.is_dir() or not os.access(place, os.W_OK):
            raise InputError(f"{self.path}: {place} is not writable: choose another --out", "out")

    @contextmanager
    def claimed(
        self, *, resume: bool | None, force: bool, replaceable: Callable[[], bool] | None = None,
        kind: str = "results only, and this holds none", writes: Sequence[str] = (),
        parts: Sequence[str] = (),
    ) -> Iterator[None]:
        """Context manager: exclusive use of the directory, from which an earlier result is removed
        for a new one unless `resume`, which is None where no run can be continued.

        Raises InputError (key `out`) rather than overwrite. With `force` the files of an earlier
        result are kept in OUT/.replaced until the new one has ended, and put back if the new run
        stores nothing. Files that no run wrote, or that somebody changed since, are never touched.
        replaceable: test whether `force` may replace the content (default: the result of a run or
        comparison); kind: content that may be replaced, for the message; writes, parts: files
        and folders with results that the command will write, of which none may be somebody else's.
        """
        with owned(self.path):
            self._recover()  # what a killed run has set aside
            if not resume and self.entries():
                self.require_replaceable(
                    force, f"use {'' if resume is None else '--resume to continue, '}--force to "
                    "overwrite, or choose another --out",
                    replaceable or self.is_run_or_comparison, kind)
                self._set_aside(writes, parts)
            elif writes:
                require_ours(self.path, writes)
            try:
                yield
            except BaseException as error:
                if not lost(self.path):  # the directory itself was not moved or removed
                    self._recover()  # the earlier result returns if the new run stored nothing
                    begun = own_files(self.path)
                    if not begun.results:
                        remove(begun, self.path)
                    # what a failed run has stored is its result, in place of the earlier one
                    if isinstance(error, SolveFailed) and error.status is not Status.INTERRUPTED:
                        self._drop()
                raise
            if not lost(self.path):
                self._drop()  # the earlier result

    def remove_result(self) -> None:
        """Removes the files of the result in the directory, and the directory if it is then
        empty."""
        with owned(self.path):
            remove(own_files(self.path), self.path)
        if self.path.is_dir() and not any(self.path.iterdir()):
            self.path.rmdir()

    # ------------------------------------------------------------------ the earlier result

    def _recover(self) -> None:
        """Moves the earlier result back if the new run stored nothing. It is in the folder `KEPT`,
        and in `MOVING` while it is moved there or back."""
        out = self.path
        renamed = False
        if _folder(out / KEPT) and not os.path.lexists(out / MOVING) and (
                own_files(out / KEPT).results):
            begun = own_files(out)
            if not begun.results:
                remove(begun, out)
                os.replace(out / KEPT, out / MOVING)
                renamed = True
        if _folder(out / MOVING):
            move(own_files(out / MOVING), out / MOVING, out, back=True)
            if not any((out / MOVING).iterdir()):
                (out / MOVING).rmdir()
            elif renamed:  # somebody else's files are in it
                os.replace(out / MOVING, out / KEPT)

    def _set_aside(self, writes: Sequence[str], parts: Sequence[str]) -> None:
        """Moves the files of the earlier result to OUT/.replaced. writes, parts: files and folders
        that the new one will write.

        If a new run was killed before its end, its files are removed and the result in
        OUT/.replaced stays. Raises InputError, changing nothing, for files of somebody else that
        the new result would replace, and while another process writes to a part of the result.
        """
        out, earlier = self.path, own_files(self.path)
        if earlier.changed:
            raise in_the_way(out, earlier.changed)
        listed_parts = {p for p in (read_listing(out) or Listing()).parts if _folder(out / p)}
        foreign = [n for n in writes if os.path.lexists(out / n) and n not in earlier.files]
        foreign += [n for n in parts if os.path.lexists(out / n) and n not in listed_parts]
        if foreign:
            raise in_the_way(out, foreign)
        stores = {(out / p).parent for p in earlier.files if Path(p).name == HEADER}
        for part in {out / p for p in listed_parts} | {s.parent for s in stores if s.name == STORE}:
            with owned(part):  # raises InputError while another process writes there
                pass
        if os.path.lexists(out / KEPT):
            replaced = own_files(out / KEPT) if _folder(out / KEPT) else OwnFiles({}, ())
            # a new run was killed before its end: its files go, the result before it stays
            if replaced.results and not self._ended(earlier):
                remove(earlier, out)
                return
            remove(replaced, out / KEPT)
            if _folder(out / KEPT) and not any((out / KEPT).iterdir()):
                (out / KEPT).rmdir()
        for name in (KEPT, MOVING):
            if os.path.lexists(out / name):
                raise in_the_way(out, [name])
        (out / MOVING).mkdir()
        move(earlier, out, out / MOVING)
        os.replace(out / MOVING, out / KEPT)

    def _drop(self) -> None:
        """Removes the earlier result after the new run has ended."""
        kept = self.path / KEPT
        with suppress(OSError):
            if _folder(kept):
                remove(own_files(kept), kept)
                kept.rmdir()  # unless somebody else's files are in it

    def _ended(self, own: OwnFiles) -> bool:
        """True if the run, comparison or study in the directory ended without being interrupted."""
        if f"{STORE}/{HEADER}" not in own.files:
            return any(name in own.files for name in _TABLES)
        try:
            document = json.loads((self.store / HEADER).read_text(encoding="utf-8"))
            return bool(document["attributes"]["status"] != Status.INTERRUPTED.value)
        except (OSError, ValueError, KeyError, TypeError):
            return False


def _folder(path: Path) -> bool:
    """True for a folder that is no symbolic link."""
    return path.is_dir() and not path.is_symlink()


def _nothing(path: Path) -> bool:
    """True for a file that holds no result, such as a lock or a temporary file, and for a folder
    with such files alone; False for an empty folder."""
    name = path.name
    if name in (LOCK, KEPT, MOVING, LISTING) or path.name.startswith(_SCRATCH) or (
            TEMPORARY.fullmatch(name)):
        return True
    if not _folder(path):
        return False
    inside = list(path.iterdir())
    return bool(inside) and all(map(_nothing, inside))  # stops at the first file
