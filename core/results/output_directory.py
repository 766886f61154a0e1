"""Output directories: write access, and replacement of an earlier result.

With `--force` the earlier result is kept in OUT/.replaced until the new run has ended. A process
that is killed at any moment leaves either the earlier result in OUT, or the earlier result in
OUT/.replaced and the steps that the new run stored in OUT. Only the process that holds the lock of
OUT changes it (output_lock.py).
"""

import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from sparsemor.core.errors import InputError
from sparsemor.core.results.checkpoint import checkpoint_file
from sparsemor.core.results.output_lock import LOCK, lost, owned
from sparsemor.core.results.zarr_files import GROUP_FILE
from sparsemor.core.status import SolveFailed, Status

KEPT, MOVING = ".replaced", ".replaced.part"
STORE = "result.zarr"
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
        """Path of the Zarr store that contains the result of a run."""
        return self.path / STORE

    def entries(self) -> list[Path]:
        """Files and folders of a run or a user, sorted; without lock files and leftovers of a
        killed run."""
        return [p for p in sorted(self.path.iterdir()) if not _nothing(p)]

    def is_result(self) -> bool:
        """True if the directory, or a folder directly in it, contains the result of an earlier
        `run` or `compare`."""
        path = self.path
        inside = [path, *(p for p in path.iterdir() if p.is_dir())] if path.is_dir() else []
        return any((p / STORE).is_dir() or (p / GROUP_FILE).is_file() for p in inside
                   if p.name not in (KEPT, MOVING))

    def kept_note(self) -> str:
        """Clause for error messages that names the folder of the kept earlier result; empty where
        there is none."""
        kept = self.path / KEPT
        return f"; the earlier one is kept in {kept}" if kept.is_dir() else ""

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
        if not force:
            self.require_empty(advice)
        elif self.occupied() and not replaceable():
            raise InputError(f"{self.path}: --force replaces {kind}", "out")

    def require_writable(self) -> None:
        """Raises InputError (key `out`) if the directory contains a result already or is not
        writable."""
        if self.store.exists():
            raise InputError(f"{self.path} already contains a result: use --resume to continue, "
                             "--force to overwrite, or choose another --out", "out")
        place = self.path
        while not place.exists():
            place = place.parent
        if not place.is_dir() or not os.access(place, os.W_OK):
            raise InputError(f"{self.path}: {place} is not writable: choose another --out", "out")

    @contextmanager
    def claimed(
        self, *, resume: bool, force: bool, replaceable: Callable[[], bool] | None = None,
        kind: str = "results only, and this holds none",
    ) -> Iterator[None]:
        """Context manager: exclusive use of the directory, emptied for a new result unless
        `resume`.

        Raises InputError (key `out`) rather than overwrite. With `force` an earlier result is kept
        in OUT/.replaced until the new one has ended, and restored if the new run stores nothing.
        Files that no run wrote are never removed. replaceable: test whether `force` may replace the
        content (default: the result of a run or comparison); kind: content that may be replaced,
        for the message.
        """
        with owned(self.path):
            self._recover()
            if not resume and self.entries():
                self.require_replaceable(
                    force, "use --resume to continue, --force to overwrite, or choose another "
                    "--out", replaceable or self.is_result, kind)
                self._set_aside()
            try:
                yield
            except BaseException as error:
                if not lost(self.path):
                    self._recover()
                    if isinstance(error, SolveFailed) and error.status is not Status.INTERRUPTED:
                        self._drop()
                raise
            if not lost(self.path):
                self._drop()

    def remove_result(self) -> None:
        """Removes the store and checkpoint of a run that this process made, and the directory if it
        is then empty."""
        with owned(self.path):
            checkpoint_file(self.store).unlink(missing_ok=True)
            shutil.rmtree(self.store, ignore_errors=True)
        if not any(self.path.iterdir()):
            self.path.rmdir()

    # ------------------------------------------------------------------ the earlier result

    def _recover(self) -> None:
        """Moves the earlier result back if the new run stored nothing."""
        out = self.path
        if (out / KEPT).is_dir() and not (out / MOVING).is_dir() and not self.entries():
            os.replace(out / KEPT, out / MOVING)
        if (out / MOVING).is_dir():
            for path in sorted((out / MOVING).iterdir()):
                target = out / path.name
                if target.is_dir() and not OutputDirectory(target).entries():
                    shutil.rmtree(target)  # locks of killed runs
                os.replace(path, target)
            (out / MOVING).rmdir()

    def _set_aside(self) -> None:
        """Moves the earlier result to OUT/.replaced.

        If a new run was killed before its end, its files are removed and the result in
        OUT/.replaced stays. Raises InputError while another process writes to a part of the result.
        """
        out, found = self.path, self.entries()
        for part in (p for p in found if OutputDirectory(p).is_result()):
            with owned(part):
                pass
        if (out / KEPT).is_dir():
            if not self._ended():
                for path in found:
                    shutil.rmtree(path) if path.is_dir() else path.unlink()
                return
            shutil.rmtree(out / KEPT)
        (out / MOVING).mkdir()
        for path in found:
            os.replace(path, out / MOVING / path.name)
        os.replace(out / MOVING, out / KEPT)

    def _drop(self) -> None:
        """Removes the earlier result after the new run has ended."""
        shutil.rmtree(self.path / KEPT, ignore_errors=True)

    def _ended(self) -> bool:
        """True if the run, comparison or study in the directory ended without being interrupted."""
        if not self.store.is_dir():
            return any((self.path / name).is_file() for name in _TABLES)
        try:
            document = json.loads((self.store / GROUP_FILE).read_text(encoding="utf-8"))
            return bool(document["attributes"]["status"] != Status.INTERRUPTED.value)
        except (OSError, ValueError, KeyError, TypeError):
            return False


def _nothing(path: Path) -> bool:
    if path.name in (LOCK, KEPT, MOVING) or path.name.startswith(_SCRATCH):
        return True
    inside = list(path.iterdir()) if path.is_dir() else []
    return bool(inside) and all(map(_nothing, inside))  # stops at the first file
