"""Content of a matrix file, as all readers return it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array

from sparsemor.core import Csr, FloatArray, InputError, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class FileMatrix:
    """Matrix of a file. labels (n, 2): node number and direction (1 to 3 displacements, 4 to 6
    rotations) of each unknown; (0, 2) for a file that does not name its unknowns."""

    matrix: Csr
    labels: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))


def plain(value: Any) -> FileMatrix:
    """A sparse or dense matrix of real numbers; vectors become one column."""
    matrix = coo_array(np.atleast_2d(value).T if getattr(value, "ndim", 2) == 1 else value)
    if matrix.ndim != 2 or matrix.dtype.kind not in "fiu":
        raise InputError(f"a matrix of real numbers is needed, not one of {matrix.dtype} of shape "
                         f"{matrix.shape}")
    return FileMatrix(matrix.astype(np.float64).tocsr())


def labelled(rows: IntArray, columns: IntArray, values: FloatArray) -> FileMatrix:
    """Matrix from entries between labelled unknowns: rows, columns (k, 2) labels, values (k,)."""
    labels, at = np.unique(np.concatenate([rows, columns]), axis=0, return_inverse=True)
    i, j = np.split(at.reshape(-1), 2)
    return FileMatrix(coo_array((values, (i, j)), shape=(len(labels),) * 2).tocsr(), labels)


def table(text: str, columns: int) -> FloatArray:
    """(k, columns) finite numbers of a text with one entry a line, between commas or blanks,
    without remarks; InputError with the line of another."""
    lines = text.replace(",", " ").splitlines()
    kept = [line for line in lines if not remark(line)]
    try:
        values = np.array(" ".join(kept).upper().replace("D", "E").split(), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if kept and values.size == columns * len(kept) and np.isfinite(values).all():
        return values.reshape(-1, columns)
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not remark(line) and (len(words) != columns or not all(map(_number, words))):
            raise InputError(f":{number}: {line.strip()[:60]!r} is no entry of {columns} numbers")
    raise InputError("it has no entries")


def remark(line: str) -> bool:
    """True for a line without numbers: blank, or one that begins with *, # or % (comments, and
    keywords of Abaqus)."""
    return line.lstrip()[:1] in ("", "*", "#", "%")


def whole(values: FloatArray, what: str) -> IntArray:
    """Whole numbers of a file; InputError that names another one by `what`."""
    bad = values[(values != np.round(values)) | (np.abs(values) > 2.0**53)]
    if bad.size:
        raise InputError(f"{what} {bad[0]:g} is no whole number")
    return values.astype(np.int64)


def _number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word.upper().replace("D", "E"))))
    except ValueError:
        return False


def entries(values: FloatArray) -> FileMatrix:
    """Matrix from rows (k, 3) of row number, column number, from 1, and entry."""
    at = whole(values[:, :2], "a row or column number,") - 1
    if at.min() < 0:
        raise InputError("row and column numbers are whole numbers from 1")
    n = int(at.max()) + 1
    return FileMatrix(coo_array((values[:, 2], (at[:, 0], at[:, 1])), shape=(n, n)).tocsr())
