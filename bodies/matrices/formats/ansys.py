"""Mass and stiffness matrices of ANSYS: `.full` files, read by ansys-mapdl-reader (extra `ansys`).
Constrained unknowns are left out, as their rows are."""

from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.matrices.formats.arrays import one_of
from sparsemor.bodies.matrices.formats.content import FileMatrix
from sparsemor.core import InputError


def read(path: Path, name: str) -> FileMatrix:
    """The matrix `K` or `M`."""
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
    labels = np.asarray(found, dtype=np.int64) + np.array([0, 1])
    held = {(int(n), int(d) + 1) for n, d in (file.const if file.const is not None else ())}
    free = np.array([i for i, (n, d) in enumerate(labels.tolist()) if (n, d) not in held],
                    dtype=np.int64)
    return FileMatrix(csr_array(matrix)[free][:, free].astype(np.float64),
                      np.asarray(labels[free], dtype=np.int64))
