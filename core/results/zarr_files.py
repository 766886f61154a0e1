"""Zarr format 3 written as plain files, so that one file replacement commits all arrays at once.

The Zarr library rewrites one metadata file per array, so a run killed between two of them leaves
arrays of unequal length. Here the shapes of all arrays are stored in the consolidated metadata of
the group: one file, replaced as a whole after the data are written. Chunks are raw little-endian
C-order bytes and their CRC-32C (codecs `bytes`, `crc32c`); the metadata have a CRC-32C of their own
in the attribute `checksum`. Damaged or missing files raise `Damaged` with the path. Specification:
zarr-specs.readthedocs.io, core protocol version 3.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import google_crc32c
import numpy as np
from numpy.typing import NDArray

from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.results.atomic_files import replace_file

GROUP_FILE = "zarr.json"
FORMAT = 2
"""Version of the stored format. Version 1 had no checksums, and 0 as fill value."""
_FILL: dict[str, Any] = {"float64": "NaN", "int64": -(2**63), "bool": False}
"""Fill value: returned by other Zarr readers for a missing chunk; here a missing chunk is an
error."""
_CHECKED = {"name": "crc32c"}


def array_metadata(
    shape: Sequence[int], chunk: Sequence[int], dtype: str, dimensions: Sequence[str],
    attributes: Mapping[str, Any],
) -> dict[str, Any]:
    """Zarr metadata document of one array; `dtype` is float64, int64 or bool."""
    endian = {} if dtype == "bool" else {"configuration": {"endian": "little"}}
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": [int(s) for s in shape],
        "data_type": dtype,
        "chunk_grid": {
            "name": "regular",
            "configuration": {"chunk_shape": [max(1, int(c)) for c in chunk]},
        },
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": _FILL[dtype],
        "codecs": [{"name": "bytes", **endian}, dict(_CHECKED)],
        "attributes": dict(attributes),
        "dimension_names": list(dimensions),
        "storage_transformers": [],
    }


def chunk_shape(metadata: Mapping[str, Any]) -> tuple[int, ...]:
    return tuple(metadata["chunk_grid"]["configuration"]["chunk_shape"])


def write_chunk(
    root: Path, name: str, metadata: Mapping[str, Any], number: int, values: NDArray[Any]
) -> None:
    """Writes chunk `number` along the first axis; the other axes are not divided. Missing rows are
    filled."""
    full = np.full(chunk_shape(metadata), _fill(metadata), dtype=_stored(metadata))
    full[tuple(slice(0, s) for s in values.shape)] = values
    raw, file = full.tobytes(), chunk_file(root, name, metadata, number)
    if _checked(metadata):
        raw += checksum(raw).to_bytes(4, "little")
    try:
        replace_file(file, raw)
    except FileNotFoundError:
        for folder in list(file.relative_to(root).parents)[-2::-1]:  # never `root` itself
            (root / folder).mkdir(exist_ok=True)
        replace_file(file, raw)


def read_chunk(
    root: Path, name: str, metadata: Mapping[str, Any], number: int, count: int
) -> NDArray[Any]:
    """First `count` rows of chunk `number`, as a writable copy.

    Raises Damaged, with the file, the array and its rows, if the chunk is missing or damaged.
    """
    file = chunk_file(root, name, metadata, number)
    try:
        raw = file.read_bytes()
    except FileNotFoundError:
        raise Damaged(_what(file, "is missing", name, metadata, number)) from None
    size = chunk_bytes(metadata)
    trailer = 4 if _checked(metadata) else 0
    if len(raw) != size + trailer:
        raise Damaged(_what(
            file, f"is damaged: {len(raw)} bytes where {size + trailer} were written", name,
            metadata, number))
    if trailer and checksum(raw[:size]) != int.from_bytes(raw[size:], "little"):
        raise Damaged(_what(
            file, "is damaged: its checksum is not that of its bytes", name, metadata, number))
    full = np.frombuffer(raw, dtype=_stored(metadata), count=size // _stored(metadata).itemsize)
    inner = tuple(slice(0, s) for s in metadata["shape"][1:])
    part = full.reshape(chunk_shape(metadata))[(slice(0, count), *inner)]
    return np.array(part, dtype=metadata["data_type"])


def is_chunk(file: Path, metadata: Mapping[str, Any], checked: bool = True) -> bool:
    """True if a file is a whole chunk of the array, by its size and, if `checked`, by its
    checksum."""
    size = chunk_bytes(metadata)
    try:
        if not _checked(metadata) or os.stat(file).st_size != size + 4:
            return False
        raw = file.read_bytes() if checked else b""
    except OSError:
        return False
    return not checked or checksum(raw[:size]) == int.from_bytes(raw[size:], "little")


def check_chunks(root: Path, arrays: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises Damaged for the first committed chunk whose file is missing or has the wrong size."""
    for name, metadata in arrays.items():
        size = chunk_bytes(metadata) + (4 if _checked(metadata) else 0)
        for number in range(chunk_count(metadata)):
            file = chunk_file(root, name, metadata, number)
            try:
                found = os.stat(file).st_size
            except (FileNotFoundError, NotADirectoryError):
                raise Damaged(_what(file, "is missing", name, metadata, number)) from None
            if found != size:
                raise Damaged(_what(
                    file, f"is damaged: {found} bytes where {size} were written", name, metadata,
                    number))


def chunk_count(metadata: Mapping[str, Any]) -> int:
    """Number of chunk files of an array; 0 if it has no entries."""
    shape = metadata["shape"]
    fixed = metadata["dimension_names"][0] != "time"
    if not shape[0] or fixed and not math.prod(shape):
        return 0
    return -(-int(shape[0]) // chunk_shape(metadata)[0])


def chunk_bytes(metadata: Mapping[str, Any]) -> int:
    """Bytes of the values of one chunk, padding included."""
    return math.prod(chunk_shape(metadata)) * _stored(metadata).itemsize


def checksum(data: bytes, before: int = 0) -> int:
    """CRC-32C (Castagnoli) of `data`; `before`: CRC-32C of the preceding bytes, to be continued."""
    return int(google_crc32c.extend(before, data))


def _checked(metadata: Mapping[str, Any]) -> bool:
    return _CHECKED in metadata["codecs"]


def _what(
    file: Path, fault: str, name: str, metadata: Mapping[str, Any], number: int
) -> str:
    first = number * chunk_shape(metadata)[0]
    last = min(first + chunk_shape(metadata)[0], metadata["shape"][0]) - 1
    return (f"{file} {fault}; rows {first} to {last} of {name} are lost: restore the file, or "
            "remove the result and repeat the run")


def read_group(root: Path) -> dict[str, Any]:
    """Metadata document of the group. Raises Damaged, and InputError for an unknown format
    version."""
    file = root / GROUP_FILE
    try:
        document: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        form = document["attributes"]["format"]
        kept = document["attributes"].pop("checksum", None)
        same = kept == _checksum_of(document) or form == 1 and kept is None
        whole = all(map(_readable, arrays_of(document).values()))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as fault:
        raise Damaged(
            f"{file} is damaged, or no result's metadata ({type(fault).__name__}: {fault}): "
            "restore the file, or remove the result and repeat the run") from None
    if not (same and whole):
        raise Damaged(f"{file} is damaged or was edited: its checksum is not that of its "
                         "content. Restore the file, or remove the result and repeat the run")
    if form not in (1, FORMAT):
        raise InputError(f"{file} has format {form!r}; this version reads formats 1 to {FORMAT}: "
                         "open it with the version that wrote it")
    return document


def _readable(metadata: Mapping[str, Any]) -> bool:
    shape, dimensions = metadata["shape"], metadata["dimension_names"]
    return (metadata["data_type"] in _FILL and {"codecs", "fill_value"} <= metadata.keys()
            and len(shape) == len(dimensions) == len(chunk_shape(metadata)))


def _checksum_of(document: Mapping[str, Any]) -> int:
    text = json.dumps(document, allow_nan=False, default=_plain, separators=(",", ":"))
    return checksum(text.encode("utf-8"))


def arrays_of(document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Array name -> metadata of the array, from the metadata document of a group."""
    arrays: dict[str, dict[str, Any]] = document["consolidated_metadata"]["metadata"]
    return arrays


def group_document(
    attributes: Mapping[str, Any], arrays: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    return {
        "zarr_format": 3,
        "node_type": "group",
        "attributes": dict(attributes),
        "consolidated_metadata": {
            "kind": "inline",
            "must_understand": False,
            "metadata": {name: dict(m) for name, m in arrays.items()},
        },
    }


def write_group(root: Path, document: Mapping[str, Any]) -> None:
    """Commits: replaces the metadata document, which determines the content of the store."""
    attributes = document["attributes"]
    if attributes["format"] != 1:
        attributes = {**attributes, "checksum": _checksum_of(document)}
    replace_file(root / GROUP_FILE, to_json({**document, "attributes": attributes}))


def to_json(document: object) -> bytes:
    """JSON as UTF-8: numpy scalars and arrays become numbers and lists. Raises ValueError for
    nan."""
    text = json.dumps(document, allow_nan=False, default=_plain, indent=1)
    return text.encode("utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    raise TypeError(f"a {type(value).__name__} cannot be stored in a result's attributes")


def _stored(metadata: Mapping[str, Any]) -> np.dtype[Any]:
    name: str = metadata["data_type"]
    return np.dtype(name).newbyteorder("<")


def _fill(metadata: Mapping[str, Any]) -> Any:
    value = metadata["fill_value"]
    return float(value) if isinstance(value, str) else value


def chunk_file(root: Path, name: str, metadata: Mapping[str, Any], number: int) -> Path:
    """Path of the file of chunk `number` along the first axis."""
    inner = ["0"] * (len(metadata["shape"]) - 1)
    return root.joinpath(name, "c", str(number), *inner)
