"""Files of matrices and nodes that the options of a body name as `FILE` or `FILE:NAME`."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.sparse import tril, triu

from sparsemor.bodies.matrices.formats import (
    FileMatrix,
    read_ansys,
    read_arrays,
    read_calculix,
    read_matlab,
    read_nastran,
    read_text,
    remark,
    table,
    unknowns_of,
    whole,
)
from sparsemor.bodies.mesh.formats import abaqus
from sparsemor.bodies.mesh.formats.file_content import Numbering, decoded
from sparsemor.bodies.mesh.formats.nastran import grids
from sparsemor.core import BoolArray, Csr, FloatArray, InputError, IntArray

T = TypeVar("T")
FORMATS: dict[str, Callable[[Path, str], FileMatrix]] = {
    ".npy": read_arrays, ".npz": read_arrays, ".mat": read_matlab, ".mtx": read_text,
    ".sti": read_calculix, ".mas": read_calculix, ".pch": read_nastran, ".full": read_ansys}
"""Reader of each ending."""
BULK = (".bdf", ".fem", ".nas", ".dat")
"""Endings of Nastran bulk data."""
TABLES = (".csv", ".txt")
"""Endings of tables of numbers."""
_NAMED = re.compile(r"(.+\.(?:npz|mat|pch|full)):(\w+)", re.IGNORECASE)
_LETTERS = 200


def place_of(base: Path, written: str) -> tuple[Path, str]:
    """Path and name of an array in it, of `FILE` or `FILE:NAME`."""
    named = _NAMED.fullmatch(written)
    return (base / named[1], named[2]) if named else (base / written, "")


def files_of(base: Path, written: str) -> list[Path]:
    """The file, and the one that belongs to it."""
    path = place_of(base, written)[0]
    return [path, *([unknowns_of(path)] if FORMATS.get(path.suffix.lower())
                    is read_calculix else [])]


def read_matrix(base: Path, written: str, key: str) -> FileMatrix:
    """Matrix of a file, `written` as FILE or FILE:NAME in the folder `base`, without stored zeros;
    InputError under the option `key`."""
    path, name = place_of(base, written)
    reader = FORMATS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"'{written}' has none of the supported formats: its name must end in "
                         f"{', '.join(FORMATS)} (with :NAME for one of several arrays)", key)
    found = _read(path, written, key, lambda: reader(path, name))
    if not np.isfinite(found.matrix.data).all():
        raise InputError(f"'{written}' has entries that are not finite", key)
    found.matrix.eliminate_zeros()
    return found


def symmetric(written: str, matrix: Csr, key: str) -> Csr:
    """The matrix with both its triangles: where no entry has a mirror image in the file, these are
    added. InputError, with the file `written` under `key`, for a matrix that is not square or not
    symmetric to 1e-6."""
    if matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"'{written}' is not square: {matrix.shape[0]} x {matrix.shape[1]}", key)
    upper, lower = triu(matrix, 1, format="csr"), tril(matrix, -1, format="csr")
    if upper.nnz + lower.nnz and not abs(upper).multiply(abs(lower.T)).nnz:
        return matrix + (upper + lower).T.tocsr()
    size = float(abs(matrix).max()) if matrix.nnz else 0.0
    off = float(abs(matrix - matrix.T).max()) if matrix.nnz else 0.0
    if off > 1e-6 * size:
        raise InputError(f"'{written}' is not symmetric: entries and their mirror images differ by "
                         f"up to {off:.3g}, the largest entry is {size:.3g}", key)
    return 0.5 * (matrix + matrix.T).tocsr()


@dataclass(frozen=True, slots=True, eq=False)
class FileNodes:
    """Nodes of a file: labels (N,), their numbers there, and positions X (N, 2 or 3) in its unit;
    sets: name -> rows in both; numbering: finds the row of a number."""

    labels: IntArray
    X: FloatArray
    sets: Mapping[str, IntArray] = field(default_factory=dict)

    @property
    def numbering(self) -> Numbering:
        return Numbering(self.labels)

    def only(self, some: BoolArray) -> "FileNodes":
        """Some of the nodes (N,), and the sets that have some of them."""
        new = np.cumsum(some) - 1
        left = {name: new[rows[some[rows]]] for name, rows in self.sets.items()}
        return FileNodes(self.labels[some], self.X[some],
                         {name: rows for name, rows in left.items() if rows.size})


def read_nodes(base: Path, written: str, key: str) -> FileNodes:
    """Nodes of a file: an array (N, 2 or 3), numbered from 1; lines `number, x, y, z` of a `.csv`
    or `.txt`; *NODE and *NSET of an Abaqus or CalculiX input file; or GRID of Nastran bulk data.
    InputError under `key`."""
    path, name = place_of(base, written)
    kind = path.suffix.lower()
    allowed = (".inp", *BULK, *TABLES, ".npy", ".npz", ".mat")
    if kind not in allowed:
        raise InputError(f"'{written}': nodes are in a file {', '.join(allowed)}", key)
    if kind == ".inp":
        found = _read(path, written, key,
                      lambda: FileNodes(*abaqus.nodes(decoded(path.read_bytes()))))
    elif kind in BULK:
        found = _read(path, written, key,
                      lambda: FileNodes(*grids(path.read_bytes(), written)))
    elif kind in TABLES:
        found = _read(path, written, key, lambda: _lines("\n".join(decoded(path.read_bytes()))))
    else:
        X = read_matrix(base, written, key).matrix.toarray()
        found = FileNodes(np.arange(1, len(X) + 1), X)
    if found.X.ndim != 2 or found.X.shape[1] not in (2, 3) or not len(found.X):
        raise InputError(f"'{written}': nodes have two or three coordinates (got an array of shape "
                         f"{found.X.shape})", key)
    again = found.numbering.repeated()
    if again is not None:
        raise InputError(f"'{written}': there are two nodes {again}", key)
    return found


def _lines(content: str) -> FileNodes:
    """Nodes of a text with lines `number, x, y` or `number, x, y, z`."""
    first = next((line for line in content.splitlines() if not remark(line)), "")
    values = table(content, 4 if len(first.replace(",", " ").split()) > 3 else 3)
    return FileNodes(whole(values[:, 0], "the number of a node,"), values[:, 1:])


def read_table(base: Path, written: str, columns: int, key: str) -> FloatArray:
    """(k, columns) numbers of a text file; InputError under `key`."""
    path = base / written
    return _read(path, written, key, lambda: table("\n".join(decoded(path.read_bytes())), columns))


def read_unknowns(base: Path, written: str, key: str) -> IntArray:
    """(n, 2) node number and direction of each unknown; node 0 for one without a place."""
    if Path(written).suffix.lower() in TABLES:
        values = read_table(base, written, 2, key)
    else:
        values = read_matrix(base, written, key).matrix.toarray()
    if values.shape[1] != 2 or (values != np.round(values)).any():
        raise InputError(f"'{written}': unknowns are rows of two whole numbers, node and direction "
                         "(1 to 6)", key)
    return values.astype(np.int64)


def _read(path: Path, written: str, key: str, read: Callable[[], T]) -> T:
    """What `read` returns of a file; whatever fails in it becomes an InputError under `key` that
    names the file as `written` in the scene, with the line where a reader tells it (`:line:
    message`)."""
    if not path.is_file():
        raise InputError(
            f"there is no file '{written}'; paths start at the folder of the scene", key)
    try:
        return read()
    except InputError as error:
        text = error.faults[0].message
        raise InputError(f"{written}{text}" if text.startswith(":") else f"'{written}': {text}",
                         key) from None
    except Exception as error:  # each reader fails in its own way; whatever it is, it is the file
        text = " ".join(str(error).replace(str(path), written).split())[:_LETTERS]
        raise InputError(f"'{written}' cannot be read as {path.suffix}: {text} "
                         f"({type(error).__name__})", key) from None

