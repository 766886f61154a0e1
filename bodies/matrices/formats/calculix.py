"""Matrices that CalculiX writes for `*FREQUENCY, SOLVER=MATRIXSTORAGE`: `.sti` (stiffness) and
`.mas` (mass) with row, column and value of the upper triangle, and next to them `.dof` with the
node and direction of each row, such as 12.3."""

from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.matrices.formats.content import FileMatrix, entries, table
from sparsemor.core import InputError


def unknowns_of(path: Path) -> Path:
    """File with the unknowns of a matrix file."""
    return path.with_suffix(".dof")


def read(path: Path, name: str) -> FileMatrix:
    beside = unknowns_of(path)
    if not beside.is_file():
        raise InputError(f"the file {beside.name}, which CalculiX writes with it, is missing")
    words = [line.strip().partition(".") for line in beside.read_text("latin-1").split("\n")]
    labels = np.array([(int(a), int(b)) for a, _, b in words if a], dtype=np.int64).reshape(-1, 2)
    found = entries(table(path.read_text("latin-1"), 3)).matrix
    if len(labels) < found.shape[0]:
        raise InputError(f"{beside.name} names {len(labels)} unknowns, and the matrix has "
                         f"{found.shape[0]}")
    whole = csr_array((found.data, found.indices, np.pad(
        found.indptr, (0, len(labels) - found.shape[0]), mode="edge")), shape=2 * (len(labels),))
    return FileMatrix(whole, labels)
