"""The earlier result that `--force` replaces: kept in OUT/.replaced until the new run has ended.

A kill at any moment leaves either the earlier result in place, or it in OUT/.replaced and what the
new run stored in OUT. All of this is done by the owner of OUT.
"""

import json
import os
import shutil
from pathlib import Path

from sparsemor.core.checkpoint import checkpoint_file
from sparsemor.core.owner import LOCK, owned
from sparsemor.core.status import Status
from sparsemor.core.zarr_files import GROUP_FILE

KEPT, MOVING = ".replaced", ".replaced.part"
STORE = "result.zarr"
_TABLES = ("errors.csv", "table.csv")
"""Written at the end of a comparison, and of a study."""
_SCRATCH = f".{STORE}."


def entries(out: Path) -> list[Path]:
    """Files and folders of a run or a user in `out`: no locks, no leftovers of a killed run."""
    return [p for p in sorted(out.iterdir()) if not _nothing(p)]


def _nothing(path: Path) -> bool:
    if path.name in (LOCK, KEPT, MOVING) or path.name.startswith(_SCRATCH):
        return True
    inside = list(path.iterdir()) if path.is_dir() else []
    return bool(inside) and all(map(_nothing, inside))  # stops at the first file


def is_result(path: Path) -> bool:
    """True for a directory that an earlier `run` or `compare` left."""
    inside = [path, *(p for p in path.iterdir() if p.is_dir())] if path.is_dir() else []
    return any((p / STORE).is_dir() or (p / GROUP_FILE).is_file() for p in inside
               if p.name not in (KEPT, MOVING))


def remove_result(out: Path) -> None:
    """Remove the result of a run that this process made, and the folder if nothing else is in it.
    """
    with owned(out):
        checkpoint_file(out / STORE).unlink(missing_ok=True)
        shutil.rmtree(out / STORE, ignore_errors=True)
    if not any(out.iterdir()):
        out.rmdir()


def recover(out: Path) -> None:
    """Put the earlier result back where nothing new took its place."""
    if (out / KEPT).is_dir() and not (out / MOVING).is_dir() and not entries(out):
        os.replace(out / KEPT, out / MOVING)
    if (out / MOVING).is_dir():
        for path in sorted((out / MOVING).iterdir()):
            target = out / path.name
            if target.is_dir() and not entries(target):
                shutil.rmtree(target)  # locks of killed runs
            os.replace(path, target)
        (out / MOVING).rmdir()


def set_aside(out: Path) -> None:
    """Move the result in `out` to OUT/.replaced. Where a new run was killed before its end, that
    one goes and the earlier result stays kept. Raises InputError when a part is being written."""
    found = entries(out)
    for part in (p for p in found if is_result(p)):
        with owned(part):
            pass
    if (out / KEPT).is_dir():
        if not _ended(out):
            for path in found:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            return
        shutil.rmtree(out / KEPT)
    (out / MOVING).mkdir()
    for path in found:
        os.replace(path, out / MOVING / path.name)
    os.replace(out / MOVING, out / KEPT)


def kept_note(out: Path) -> str:
    """For messages: where an earlier result is kept; empty where none is."""
    kept = out / KEPT
    return f"; the earlier one is kept in {kept}" if kept.is_dir() else ""


def drop(out: Path) -> None:
    """Remove the earlier result: the new one has ended."""
    shutil.rmtree(out / KEPT, ignore_errors=True)


def _ended(out: Path) -> bool:
    """True where the run, comparison or study in `out` came to an end of its own."""
    if not (out / STORE).is_dir():
        return any((out / name).is_file() for name in _TABLES)
    try:
        document = json.loads((out / STORE / GROUP_FILE).read_text(encoding="utf-8"))
        return bool(document["attributes"]["status"] != Status.INTERRUPTED.value)
    except (OSError, ValueError, KeyError, TypeError):
        return False
