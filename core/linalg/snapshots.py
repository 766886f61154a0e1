"""Snapshots of one body's field: in memory if they are small, else in a file that is written during
the run and read by column chunks."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray

HELD = 2**28
"""Size of a snapshot matrix, bytes, up to which it is held in memory and decomposed as a whole."""
STRETCH = 2**25
"""Size of the column chunks, bytes, in which a larger matrix is read."""


def needs_chunks(A: FloatArray) -> bool:
    """True if a snapshot matrix is larger than those held in memory as a whole."""
    return A.nbytes > HELD


class SnapshotWriter:
    """Writer of M snapshots of n unknowns, one after another.

    folder: function that returns the folder for a large array; it is not called for a small one.
    """

    def __init__(self, name: str, M: int, n: int, folder: Callable[[], Path]) -> None:
        self.shape, self._count = (M, n), 0
        self._rows: FloatArray | None = None
        if 8 * M * n <= HELD:
            self._rows = np.empty((M, n))
            return
        self._path = folder() / f"{name}.npy"
        self._file = self._path.open("wb")
        head = {"descr": "<f8", "fortran_order": False, "shape": (M, n)}
        np.lib.format.write_array_header_1_0(self._file, head)

    def append(self, row: FloatArray) -> None:
        if self._rows is not None:
            self._rows[self._count] = row
        else:
            self._file.write(np.ascontiguousarray(row, dtype="<f8").data)
        self._count += 1

    def finished(self) -> FloatArray:
        """Snapshots (M, n), a read-only memory map if they are in a file."""
        assert self._count == self.shape[0]
        if self._rows is not None:
            return self._rows
        self._file.close()
        rows: FloatArray = np.load(self._path, mmap_mode="r")
        return rows

    def close(self) -> None:
        """Closes the file after a run that failed."""
        if self._rows is None:
            self._file.close()


def column_chunks(A: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
    """Column chunks of A (n, M): the slice and the values of each; one chunk where A is small.

    Snapshots in a file are read, not memory-mapped, so that their memory is freed after use.
    """
    n, M = A.shape
    step = max(1, M) if not needs_chunks(A) else max(1, STRETCH // (8 * n))
    for first in range(0, M, step):
        columns = slice(first, min(first + step, M))
        yield columns, _read(A, columns)


def _read(A: FloatArray, columns: slice) -> FloatArray:
    place = _place(A) if needs_chunks(A) else None
    if place is None:
        return A[:, columns]
    n, count = A.shape[0], columns.stop - columns.start
    values = np.fromfile(place[0], A.dtype, n * count, offset=place[1] + 8 * n * columns.start)
    return values.reshape(count, n).T


def _place(A: Any) -> tuple[Path, int] | None:
    """File and offset, bytes, of a memory-mapped A^T that fills the file, row by row; None for
    other arrays, such as slices, whose offset is unknown."""
    if not isinstance(A, np.memmap) or A.filename is None or not A.T.flags.c_contiguous:
        return None
    file, offset = Path(A.filename), int(A.offset)
    whole = file.exists() and offset + A.nbytes == file.stat().st_size
    return (file, offset) if whole else None
