"""NumPy and SciPy files: `.npy`, `.npz` of `numpy.savez` and of `scipy.sparse.save_npz`. No pickled
objects are read."""

from pathlib import Path

import numpy as np
from scipy.sparse import load_npz

from sparsemor.bodies.matrices.formats.content import FileMatrix, plain
from sparsemor.core import InputError, suggestions


def read(path: Path, name: str) -> FileMatrix:
    """The array called `name`, or the only one."""
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
