"""Writer of a result on disk (stored_arrays.py), which can be read at any moment, even after a
kill.

An append replaces the last file of steps by a longer one, or adds one: the rename is the commit.
This is safe if the process is killed; a power failure may lose recent files. The run ends with an
OSError if its store is moved, removed or replaced meanwhile.
"""

import errno
import os
import uuid
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.results.atomic_files import writing
from sparsemor.core.results.checkpoint import (
    Checkpoint,
    Saved,
    SavedError,
    checkpoint_file,
    load_checkpoint,
    save_checkpoint,
)
from sparsemor.core.results.continuation import extended, refusal
from sparsemor.core.results.files.replaceable_files import move, own_store, remove
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.files.written_files import in_the_way
from sparsemor.core.results.metadata import RunHeader, load_layout
from sparsemor.core.results.npz_archive import is_archive, write_archive
from sparsemor.core.results.output_lock import FixedFolder
from sparsemor.core.results.result_variables import (
    fixed_arrays,
    started_attributes,
    steps_per_chunk,
    time_arrays,
)
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stored_arrays import (
    FIXED,
    HEADER,
    TIME,
    StoredArrays,
    over_time,
    read_header,
    refuse_older,
    steps_file,
    steps_files,
    write_header,
)
from sparsemor.core.scene.run_identity import Identity
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class ChunkOfSteps:
    """Data of j consecutive steps to be stored.

    times (j,): s; x (j, n): unknowns of the step solver; iterations (j,); remaining (j,): estimated
    relative errors that these leave; step_seconds (j,): computing times, s; supports: block -> (j,
    k) active basis vectors (an absent reduced block uses all of them); probes: name -> (j,
    components); contacts: `contact.resultant` -> (j,); forces: force element -> (j,); given: body
    -> (j, functions) prescribed temperatures, K; estimates: block -> (j,) norms of its estimated
    error.
    """

    times: FloatArray
    x: FloatArray
    iterations: IntArray
    remaining: FloatArray
    step_seconds: FloatArray
    supports: Mapping[str, BoolArray] = field(default_factory=dict)
    probes: Mapping[str, FloatArray] = field(default_factory=dict)
    contacts: Mapping[str, FloatArray] = field(default_factory=dict)
    forces: Mapping[str, FloatArray] = field(default_factory=dict)
    given: Mapping[str, FloatArray] = field(default_factory=dict)
    estimates: Mapping[str, FloatArray] = field(default_factory=dict)


class ResultWriter:
    """Writer that appends steps to a store; at most one per store. `stored`: number of committed
    steps."""

    def __init__(self, path: Path) -> None:
        """path: of an existing store, which is continued after its committed steps.

        _arrays: name -> entry of the header, of the arrays over time; _per_file: steps of a full
        file; _number: number of the file that is written next.
        """
        self.path = path
        self._folder = FixedFolder(path)
        self._document = read_header(path)
        self._arrays = {n: e for n, e in self._document["arrays"].items() if over_time(e)}
        self._layout = load_layout(self._document["attributes"], "layout")
        kept = StoredArrays(path)
        self._per_file = kept.per_file
        self._number, rest = divmod(kept.steps, self._per_file)
        last = slice(kept.steps - rest, None)
        self._tail = {name: kept.read(name, last) for name in self._arrays}
        """Steps of the last file, number `_number`, which is not full."""
        self._last_time = float(kept.read(TIME, slice(-1, None))[0]) if kept.steps else -np.inf

    @classmethod
    def create(cls, path: str | Path, header: RunHeader) -> "ResultWriter":
        """Writer of a new, empty store at `path`, which is created atomically.

        Raises InputError if there is a store already.
        """
        target = Path(path).absolute()
        if (target / HEADER).exists():
            raise InputError(
                f"{path} already contains a result: continue it with --resume, choose another "
                "directory, or remove it", key="out")
        target.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFolder(target.parent) as folder:
            fresh = folder / target.name
            fresh.mkdir()
            _write_empty(fresh, header)
            if target.is_dir() and (taken := [
                    p.name for p in (target / FIXED, *steps_files(target).values())
                    if os.path.lexists(p)]):
                raise in_the_way(target, taken)
            checkpoint_file(target).unlink(missing_ok=True)
            if target.is_dir():  # somebody else's files are in it
                move(own_store(fresh), fresh, target, back=True)
            else:
                os.replace(fresh, target)
        return cls(target)

    @classmethod
    def resume(
        cls, path: str | Path, scene: Scene | None = None, header: RunHeader | None = None
    ) -> tuple["ResultWriter", Checkpoint]:
        """Writer of a stored run, truncated to its last checkpoint, and that checkpoint.

        scene, header: those of the continued run, None for the stored ones. Raises InputError if
        there is nothing to resume, or if the continued run would not be that of `scene` from its
        start: other settings than a later end, other code, plugins or input files.
        """
        target = Path(path).absolute()
        document, checkpoint = resumable(target, scene)
        kept = document["attributes"]["scene"]
        if header is not None and header.scene["time"]["end"] != kept["time"]["end"]:
            if why := extended(target, document, header):
                raise _refused(target, why)
        document["attributes"].update(
            status=Status.INTERRUPTED.value, summary={}, steps_stored=checkpoint.stored)
        write_header(target, document)
        _truncate(target, document, checkpoint.stored)
        return cls(target), checkpoint

    @property
    def attributes(self) -> Mapping[str, Any]:
        """Attributes of the result, as plain data."""
        return dict(self._document["attributes"])

    @property
    def stored(self) -> int:
        return self._number * self._per_file + len(self._tail[TIME])

    def append(self, steps: ChunkOfSteps) -> None:
        """Stores and commits steps. Raises ValueError, storing nothing, for values that are not
        finite."""
        self._append(columns_of(steps, self._layout, self._arrays))

    def _append(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Writes steps, name -> values over time, to the files of the chunks to which they belong;
        the last one, whose steps are `_tail` and which is not full, is written again."""
        times = columns[TIME]
        for name, values in columns.items():
            check_column(name, self._arrays[name], values, len(times))
        self._check_times(times)
        if len(times) == 0:
            return
        rows = {name: np.concatenate([self._tail[name], values])
                for name, values in columns.items()}
        with self._folder.kept(self._last_time):
            for start in range(0, len(rows[TIME]), self._per_file):
                self._write({name: values[start:start + self._per_file]
                             for name, values in rows.items()})
        self._last_time = float(times[-1])

    def continued(
        self, header: RunHeader, maps: Mapping[str, FloatArray]
    ) -> "ResultWriter":
        """Writer of the same result in other unknowns of the step solver, for the steps to come.
        The stored steps are converted (`converted`); a process that is killed during the exchange
        leaves them in the folder `.NAME.old`."""
        known = self.result()
        folder, old = TemporaryFolder(self.path.parent), _old_folder(self.path)
        fresh = folder.path / self.path.name
        fresh.mkdir()
        _write_empty(fresh, header)
        writer = ResultWriter(fresh)
        for first in range(0, self.stored, writer._per_file):
            writer._append(converted(
                known, writer._arrays, maps,
                slice(first, min(first + writer._per_file, self.stored))))
        with self._folder.kept(self._last_time):  # still in its place
            pass
        os.replace(self.path, old)
        os.replace(fresh, self.path)
        remove(own_store(old), old)
        for path in old.iterdir():  # somebody else's files
            if not os.path.lexists(self.path / path.name):
                os.replace(path, self.path / path.name)
        with suppress(OSError):
            old.rmdir()
        folder.remove()
        return ResultWriter(self.path)

    def checkpoint(
        self, arrays: Mapping[str, NDArray[Any]], memory: object = None, extra: int = 0
    ) -> None:
        """Saves the state from which the run can continue after the last appended step.

        arrays: state of the time integrator; memory: state of the step solver; extra: number of
        appended steps that a longer run does not store. Raises TypeError for a state that cannot be
        serialized (checkpoint.py).
        """
        run, stored = self._document["attributes"]["run"], self.stored - extra
        with self._folder.kept(self._last_time), writing(checkpoint_file(self.path)):
            save_checkpoint(self.path, Checkpoint(run, stored, arrays, Saved.from_value(memory)))

    def finish(self, status: Status, summary: Mapping[str, Any]) -> None:
        """Writes the final status and summary of the run.

        Raises OSError if the store was moved or removed, or if one of its files is missing.
        """
        with self._folder.kept(self._last_time):
            self._document["attributes"].update(
                status=status.value, summary=dict(summary), steps_stored=self.stored)
            try:
                StoredArrays(self.path, least=self.stored).check()
            except Damaged as error:
                raise OSError(errno.EIO, str(error)) from None
            write_header(self.path, self._document)

    def result(self) -> RunResult:
        """Reader of what is committed."""
        return RunResult(self.path)

    def discard(self) -> None:
        """Removes the store and its checkpoint, unless the store was moved or replaced."""
        if self._folder.in_place():
            checkpoint_file(self.path).unlink(missing_ok=True)
            remove_store(self.path)

    def _check_times(self, times: FloatArray) -> None:
        """Raises ValueError for times (j,), s, that do not grow."""
        before = np.concatenate([[self._last_time], times])
        if np.any(np.diff(before) <= 0.0):
            raise ValueError(f"time: must grow, after {self._last_time} s came {times}")

    def _write(self, rows: dict[str, NDArray[Any]]) -> None:
        """Replaces or adds the last file of steps."""
        file = steps_file(self.path, self._number)
        if len(self._tail[TIME]) == 0 and os.path.lexists(file):
            raise FileExistsError(errno.EEXIST, "not written by this run", str(file))
        write_archive(file, rows, self._document["attributes"]["run"])
        if len(rows[TIME]) == self._per_file:
            self._number, rows = self._number + 1, {n: v[:0] for n, v in rows.items()}
        self._tail = {name: values.copy() for name, values in rows.items()}


def columns_of(
    steps: ChunkOfSteps, layout: Layout, arrays: Mapping[str, object]
) -> dict[str, NDArray[Any]]:
    """Name -> values of each array over time. layout: that of the step solver; arrays: those that
    the header declares. Raises ValueError where steps and header disagree."""
    j = len(steps.times)
    if steps.x.shape != (j, layout.size):
        raise ValueError(f"x: shape {steps.x.shape}, expected {(j, layout.size)}")
    columns: dict[str, NDArray[Any]] = {
        TIME: steps.times, "iterations": steps.iterations,
        "remaining_error": steps.remaining, "step_seconds": steps.step_seconds}
    for b in layout:
        values = steps.x[:, layout[b.name]]
        if b.name in arrays:
            columns[b.name] = values
        else:
            columns[f"{b.name}.coefficients"] = values
            everything = np.ones(values.shape, dtype=np.bool_)
            columns[f"{b.name}.active"] = steps.supports.get(b.name, everything)
    columns |= {f"probe.{name}": values for name, values in steps.probes.items()}
    columns |= {f"contact.{name}": values for name, values in steps.contacts.items()}
    columns |= {f"force.{name}": values for name, values in steps.forces.items()}
    columns |= {f"error_estimate.{n}": values for n, values in steps.estimates.items()}
    columns |= {f"{body}.given": values for body, values in steps.given.items()}
    if columns.keys() != arrays.keys():
        odd = ", ".join(sorted(columns.keys() ^ arrays.keys()))
        raise ValueError(f"the steps and the header disagree on: {odd}")
    return columns


def converted(
    known: RunResult, arrays: Iterable[str], maps: Mapping[str, FloatArray], steps: slice
) -> dict[str, NDArray[Any]]:
    """Name -> values, at some steps of a result, of the arrays over time for other unknowns of the
    step solver. maps: block -> matrix (l, k) from its coefficients to those of other atoms; a block
    without one is converted to all its unknowns."""
    columns: dict[str, NDArray[Any]] = {}
    for name in arrays:
        values = known.over_time(name, steps)
        block, _, what = name.rpartition(".")
        if values is None:  # unknowns of a block that was reduced before
            values = known.block(name, steps)
        elif block in maps and what == "coefficients":
            values = values @ maps[block].T
        elif block in maps and what == "active":
            values = values @ (maps[block].T != 0.0)  # new atoms to which an active one contributes
        columns[name] = values
    return columns


def check_column(
    name: str, entry: Mapping[str, Any], values: NDArray[Any], count: int
) -> None:
    """Raises ValueError for values of an array over `count` steps that are of another shape or not
    finite."""
    expected = (count, *entry["shape"][1:])
    if values.shape != expected:
        raise ValueError(f"{name}: shape {values.shape}, expected {expected}")
    if entry["dtype"] == "float64" and not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values.reshape(count, -1)).all(axis=1))[0])
        raise ValueError(f"{name}: not finite in row {row} of the {count} steps to store")


def _write_empty(path: Path, header: RunHeader) -> None:
    """Writes a result without steps: its header and the arrays that do not depend on time."""
    growing, fixed = time_arrays(header), fixed_arrays(header)
    for name, (_, values) in fixed.items():
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: not finite")
        if name in growing:
            raise ValueError(f"two arrays of the result are named {name!r}: rename the probe")
    attributes = started_attributes(header) | {
        "steps_per_chunk": steps_per_chunk(header), "steps_stored": 0}
    # first the header by which a file of a process that is killed here is known to be ours
    entries = growing | {name: entry for name, (entry, _) in fixed.items()}
    write_header(path, {"attributes": attributes, "arrays": entries})
    write_archive(path / FIXED, {n: values for n, (_, values) in fixed.items()}, attributes["run"])


def _truncate(store: Path, document: Mapping[str, Any], steps: int) -> None:
    """Removes all stored steps but the first `steps`: files after them, the last one first, so that
    what a killed process leaves has no gap; then the file in which they end is written again."""
    kept, run = StoredArrays(store), document["attributes"]["run"]
    number, rest = divmod(steps, kept.per_file)
    beyond = [p for n, p in steps_files(store).items() if n >= number + bool(rest)]
    if foreign := [p.name for p in beyond if not is_archive(p, run)]:
        raise in_the_way(store, foreign)
    tail = {name: kept.read(name, slice(steps - rest, steps))
            for name, entry in kept.arrays.items() if over_time(entry)}
    for file in reversed(beyond):
        file.unlink()
    if rest:
        write_archive(steps_file(store, number), tail, run)


def remove_store(store: Path) -> None:
    """Removes the files of a store that are ours, and the folder if it is then empty."""
    remove(own_store(store), store)
    with suppress(OSError):
        store.rmdir()


def _old_folder(store: Path) -> Path:
    """New folder next to a store, for what it held, without what a killed process left in it."""
    folder = store.with_name(f".{store.name}.old")
    if folder.is_dir() and not folder.is_symlink():
        remove_store(folder)
    if os.path.lexists(folder):  # somebody else's
        folder = folder.with_name(f"{folder.name}-{uuid.uuid4().hex}")
    folder.mkdir()
    return folder


def _refused(target: Path, why: str) -> InputError:
    """Error for a result that cannot be resumed."""
    return InputError(f"{target} cannot be resumed: {why}", key="resume")


def resumable(target: Path, scene: Scene | None) -> tuple[dict[str, Any], Checkpoint]:
    """Header and checkpoint of a stored run that can be continued as `scene`, None for its own.
    Raises InputError if it cannot; changes nothing."""
    def refuse(why: str) -> InputError:
        return _refused(target, why)

    if not (target / HEADER).exists():
        refuse_older(target.parent)
        raise refuse("there is no result; start the run without --resume")
    document = read_header(target)
    attributes = document["attributes"]
    if scene is not None:
        if why := refusal(attributes, scene):
            raise refuse(why)
        if changed := Identity.from_scene(scene).changes(attributes.get("identity", {})):
            raise refuse(f"since it was stopped, {'; '.join(changed)}. Start the run again, with "
                         "--force or into another directory")
    try:
        checkpoint = load_checkpoint(target)
    except SavedError as error:
        raise refuse(f"{checkpoint_file(target).name}: {error}; start again, with --force or into "
                     "another directory") from None
    if checkpoint is None or checkpoint.run != attributes["run"]:
        raise refuse("it was stopped before its first checkpoint; start again, with --force or "
                     "into another directory")
    StoredArrays(target, least=checkpoint.stored).check()
    return document, checkpoint


__all__ = ["Checkpoint", "ChunkOfSteps", "ResultWriter", "RunHeader"]
