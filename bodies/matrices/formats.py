"""Files of matrices of other codes and their content."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, mmread
from scipy.sparse import coo_array, csr_array, load_npz

from sparsemor.bodies.mesh.formats.file_content import decoded
from sparsemor.bodies.mesh.formats.nastran import Card, cards
from sparsemor.core import Csr, FloatArray, InputError, IntArray, suggestions


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
    without remarks, with exponents E or D (Fortran); InputError with the number of the first line
    that has others, or without any line."""
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
    """True for a finite number, with an exponent E or D."""
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


def read_arrays(path: Path, name: str) -> FileMatrix:
    """NumPy and SciPy files, `.npy`, `.npz` of `numpy.savez` and of `scipy.sparse.save_npz`: the
    array called `name`, or the only one. No pickled objects are read."""
    if path.suffix.lower() == ".npy":
        return plain(np.load(path, allow_pickle=False))
    with np.load(path, allow_pickle=False) as stored:
        if {"format", "data", "shape"} <= set(stored.files):
            return plain(load_npz(path))
        return plain(stored[one_of(stored.files, name)])


def one_of(names: list[str], name: str) -> str:
    """`name`, or the only one of the names; InputError for another."""
    if name in names or (not name and len(names) == 1):
        return name or names[0]
    raise InputError(f"it has no array {name!r}: {suggestions(name, names, 'arrays')}" if name else
                     f"it has several arrays ({', '.join(names)[:200]}): say which, as in "
                     f"FILE:{names[0]}")


def read_matlab(path: Path, name: str) -> FileMatrix:
    """MATLAB files up to version 7: the variable called `name`, or the only one."""
    try:
        stored = loadmat(path)
    except NotImplementedError:
        raise InputError("it is of version 7.3 (HDF5): save it with `-v7`") from None
    return plain(stored[one_of([k for k in stored if not k.startswith("__")], name)])


def read_text(path: Path, name: str) -> FileMatrix:
    """Text files `.mtx`: Matrix Market, and what `*MATRIX GENERATE` of Abaqus writes.

    Abaqus writes `<job>_MASS<step>.mtx` and `<job>_STIF<step>.mtx`: with FORMAT=MATRIX INPUT
    (default) or LABELS an entry has row node, its direction, column node, its direction and value;
    with FORMAT=COORDINATE row, column and value, rows in the order of node numbers (Abaqus Analysis
    User's Guide, Generating matrices). A file has one matrix: `name` is not used.
    """
    text = path.read_text("latin-1")
    if text[:14].lower() == "%%matrixmarket":
        return plain(mmread(path, spmatrix=False))
    first = next((line for line in text.splitlines() if not remark(line)), "")
    if len(first.replace(",", " ").split()) < 5:
        return entries(table(text, 3))
    values = table(text, 5)
    at = whole(values[:, :4], "a node or direction,")
    return labelled(at[:, :2], at[:, 2:], values[:, 4])


def unknowns_of(path: Path) -> Path:
    """File with the unknowns of a matrix file."""
    return path.with_suffix(".dof")


def read_calculix(path: Path, name: str) -> FileMatrix:
    """Matrices that CalculiX writes for `*FREQUENCY, SOLVER=MATRIXSTORAGE`: `.sti` (stiffness) and
    `.mas` (mass) with row, column and value of the upper triangle, which the caller mirrors, and
    next to them `.dof` with the node and direction of each row, such as 12.3. A file has one
    matrix: `name` is not used."""
    beside = unknowns_of(path)
    if not beside.is_file():
        raise InputError(f"the file {beside.name}, which CalculiX writes with it, is missing")
    words = [line.strip().partition(".") for line in beside.read_text("latin-1").split("\n")]
    labels = np.array([(int(a), int(b)) for a, _, b in words if a], dtype=np.int64).reshape(-1, 2)
    found = entries(table(path.read_text("latin-1"), 3)).matrix
    if len(labels) < found.shape[0]:
        raise InputError(f"{beside.name} names {len(labels)} unknowns, and the matrix has "
                         f"{found.shape[0]}")
    # last rows without entries are not in the file: they become zero
    matrix = csr_array((found.data, found.indices, np.pad(
        found.indptr, (0, len(labels) - found.shape[0]), mode="edge")), shape=2 * (len(labels),))
    return FileMatrix(matrix, labels)


def read_ansys(path: Path, name: str) -> FileMatrix:
    """Mass and stiffness matrices of ANSYS, `K` or `M`: `.full` files, read by ansys-mapdl-reader
    (extra `ansys`). Constrained unknowns are left out, as their rows are. name: `K` or `M`. The
    matrix has one triangle, which the caller mirrors."""
    try:
        from ansys.mapdl.reader import read_binary
    except ImportError:
        raise InputError("it needs the package ansys-mapdl-reader, which is not installed: "
                         "pip install 'sparsemor[ansys]'") from None
    which = one_of(["K", "M"], name.upper())
    file = read_binary(str(path))
    found, *matrices = file.load_km(sort=True)
    matrix = matrices[which == "M"]
    if matrix is None:
        raise InputError(f"it has no matrix {which}")
    # node, and direction from 0 there and from 1 here; file.const: those of constrained unknowns
    labels = np.asarray(found, dtype=np.int64) + np.array([0, 1])
    held = {(int(n), int(d) + 1) for n, d in (file.const if file.const is not None else ())}
    free = np.array([i for i, (n, d) in enumerate(labels.tolist()) if (n, d) not in held],
                    dtype=np.int64)
    return FileMatrix(csr_array(matrix)[free][:, free].astype(np.float64),
                      np.asarray(labels[free], dtype=np.int64))


SQUARE, SYMMETRIC = 1, 6


def read_nastran(path: Path, name: str) -> FileMatrix:
    """Matrices DMIG of Nastran and OptiStruct in punch files, such as those of `EXTSEOUT(DMIGPCH)`
    and `PARAM, EXTOUT, DMIGPCH` (MSC Nastran Quick Reference Guide, DMIG): the one called `name`,
    or the only one. Scalar points are unknowns without a place, of direction 0. The header has the
    fields name, 0, form (square or symmetric) and type (1, 2: real); of a symmetric matrix a file
    may have either triangle."""
    found: dict[str, list[Card]] = {}
    for card in cards(decoded(path.read_bytes())):
        if card.name == "DMIG":
            found.setdefault(card.text(0).upper(), []).append(card)
    if not found:
        raise InputError("it has no matrix DMIG")
    which = one_of(list(found), name.upper())
    head, *columns = found[which]
    if head.text(1) != "0" or head.integer(2) not in (SQUARE, SYMMETRIC) or head.integer(3) > 2:
        raise head.fail(f"{which}: a square or symmetric real matrix is needed, whose first card "
                        "is its header")
    values: dict[tuple[tuple[int, int], tuple[int, int]], float] = {}
    for card in columns:
        column = card.integer(1), card.integer(2, 0)
        # fields: name, node and direction of the column, blank; then row node, direction, A, B
        for at in range(4, len(card.fields), 4):
            if card.text(at):
                row = card.integer(at), card.integer(at + 1, 0)
                pair = (row, column) if head.integer(2) == SQUARE else (
                    min(row, column), max(row, column))
                values[pair] = card.real(at + 2)
    if not values:
        raise head.fail(f"{which} has no entries")
    both = np.array(list(values), dtype=np.int64)
    return labelled(both[:, 0], both[:, 1], np.array(list(values.values())))
