"""Output directories: who may write to one, and what becomes of the result that was there.

With `--force` the earlier result is kept in OUT/.replaced until the new run has ended. A kill at
any moment leaves either the earlier result in place, or it in OUT/.replaced and what the new run
stored in OUT. All of this is done by the owner of OUT (output_lock.py).
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
"""Written at the end of a comparison, and of a study."""
_SCRATCH = f".{STORE}."


class OutputDirectory:
    """Directory that a run, comparison, study, survey, export or new package is written to."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    # ------------------------------------------------------------------ what is there

    @property
    def store(self) -> Path:
        """Store of the result of a run."""
        return self.path / STORE

    def entries(self) -> list[Path]:
        """Files and folders of a run or a user: no locks, no leftovers of a killed run."""
        return [p for p in sorted(self.path.iterdir()) if not _nothing(p)]

    def is_result(self) -> bool:
        """True for a directory that an earlier `run` or `compare` left."""
        path = self.path
        inside = [path, *(p for p in path.iterdir() if p.is_dir())] if path.is_dir() else []
        return any((p / STORE).is_dir() or (p / GROUP_FILE).is_file() for p in inside
                   if p.name not in (KEPT, MOVING))

    def kept_note(self) -> str:
        """For messages: where an earlier result is kept; empty where none is."""
        kept = self.path / KEPT
        return f"; the earlier one is kept in {kept}" if kept.is_dir() else ""

    # ------------------------------------------------------------------ who may write

    def occupied(self) -> bool:
        """True if something is there that writing would change."""
        return self.path.exists() and (not self.path.is_dir() or bool(self.entries()))

    def make(self) -> None:
        """Make the directory and its parents. Raises InputError (key `out`) where it cannot."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be made ({error.strerror}): choose another "
                             "--out", "out") from None

    def require_empty(self, advice: str) -> None:
        """Raises InputError (key `out`) for a file, and where something is there; the latter ends
        in `advice`."""
        if self.path.exists() and not self.path.is_dir():
            raise InputError(f"{self.path}: this is a file: choose a directory", "out")
        if self.occupied():
            raise InputError(f"{self.path}: output directory is not empty: {advice}", "out")

    def require_replaceable(
        self, force: bool, advice: str, replaceable: Callable[[], bool], kind: str
    ) -> None:
        """The same, unless `force` and the directory holds only what is `replaceable`."""
        if not force:
            self.require_empty(advice)
        elif self.occupied() and not replaceable():
            raise InputError(f"{self.path}: --force replaces {kind}", "out")

    def require_writable(self) -> None:
        """Raises InputError (key `out`) where no result can be written."""
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
        """The directory, owned until the end, with room for a new result unless `resume`.

        Refuses to overwrite. With `force` an earlier result is kept in OUT/.replaced until the new
        one has ended, and put back if none came about. Of what was not made here nothing is
        removed. replaceable: whether the directory may be replaced, if it is not that of a run or a
        comparison; kind: what may be, for the message.
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
        """Remove the result of a run that this process made, and the folder if nothing else is in
        it."""
        with owned(self.path):
            checkpoint_file(self.store).unlink(missing_ok=True)
            shutil.rmtree(self.store, ignore_errors=True)
        if not any(self.path.iterdir()):
            self.path.rmdir()

    # ------------------------------------------------------------------ the earlier result

    def _recover(self) -> None:
        """Put the earlier result back where nothing new took its place."""
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
        """Move the result to OUT/.replaced. Where a new run was killed before its end, that one
        goes and the earlier result stays kept. Raises InputError when a part is being written."""
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
        """Remove the earlier result: the new one has ended."""
        shutil.rmtree(self.path / KEPT, ignore_errors=True)

    def _ended(self) -> bool:
        """True where the run, comparison or study here came to an end of its own."""
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
