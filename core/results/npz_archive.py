"""Archive of arrays: an `.npz` file, which `numpy.load` opens, with the mark of its run.

Reading an array verifies the CRC-32 that the zip format has for it. The comment of the archive is
the mark: `sparsemor RUN CRC`, with the identifier of the run and the CRC-32 of all bytes before.
A file is therefore known to be whole and ours without a list.
"""

import errno
import io
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.results.files.written_files import written_in

_FAULTS = (zipfile.BadZipFile, zlib.error, ValueError, LookupError, RuntimeError, EOFError,
           OverflowError)
"""What `zipfile` and the reader of `.npy` raise for damaged bytes."""
_DIGITS = 8
"""Digits of a CRC-32."""


class ArchiveError(ValueError):
    """Error: an archive is damaged, or has not the array that is read."""


def write_archive(path: Path, arrays: Mapping[str, NDArray[Any]], run: str) -> None:
    """Replaces the file `path` by an archive of arrays, not compressed, in the order of C. run:
    identifier of the run in the mark at its end, before the CRC-32 of all bytes before."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.comment = _mark(run) + b"0" * _DIGITS
        for name, values in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=(
                    values.nbytes >= zipfile.ZIP64_LIMIT)) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(values), (1, 0),
                                          allow_pickle=False)
    data = buffer.getbuffer()
    data[-_DIGITS:] = _crc(zlib.crc32(data[:-_DIGITS]))
    replace_file(path, data)


def read_array(path: Path, name: str) -> NDArray[Any]:
    """Array of an archive; nothing in the file is executed, and none is larger than the file.
    Raises ArchiveError."""
    try:
        with zipfile.ZipFile(path) as archive:
            member = archive.getinfo(f"{name}.npy")
            if member.compress_type != zipfile.ZIP_STORED:
                raise ArchiveError("it is compressed")
            raw = archive.read(member)
        stream = io.BytesIO(raw)
        np.lib.format.read_magic(stream)
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        if fortran or math.prod(shape) * dtype.itemsize != len(raw) - stream.tell():
            raise ArchiveError("its shape is not that of its bytes")
        return np.frombuffer(raw, dtype, offset=stream.tell()).reshape(shape)
    except ArchiveError:
        raise
    except _FAULTS as error:
        raise ArchiveError(f"{type(error).__name__}: {error}") from None
    except OSError as error:
        if error.errno != errno.EINVAL:  # a damaged offset points before the file
            raise
        raise ArchiveError(str(error)) from None


def is_archive(path: Path, run: str, *, checked: bool = True) -> bool:
    """True if a file is an archive as it was written in a run: by the mark at its end and, if
    `checked`, by the CRC-32 of its bytes."""
    mark = _mark(run)
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            if size < len(mark) + _DIGITS:
                return False
            file.seek(size - len(mark) - _DIGITS)
            found, digits = file.read(len(mark)), file.read()
        return found == mark and (
            not checked or digits == _crc(written_in(path, size - _DIGITS)[1]))
    except OSError:
        return False


def _mark(run: str) -> bytes:
    return f"sparsemor {run} ".encode()


def _crc(value: int) -> bytes:
    return b"%08x" % value
