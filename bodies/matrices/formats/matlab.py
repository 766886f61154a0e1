"""MATLAB files up to version 7."""

from pathlib import Path

from scipy.io import loadmat

from sparsemor.bodies.matrices.formats.arrays import one_of
from sparsemor.bodies.matrices.formats.content import FileMatrix, plain
from sparsemor.core import InputError


def read(path: Path, name: str) -> FileMatrix:
    """The variable called `name`, or the only one."""
    try:
        stored = loadmat(path)
    except NotImplementedError:
        raise InputError("it is of version 7.3 (HDF5): save it with `-v7`") from None
    return plain(stored[one_of([k for k in stored if not k.startswith("__")], name)])
