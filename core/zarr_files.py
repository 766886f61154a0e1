"""Zarr format 3 written as plain files, so that one rename is the only commit point.

The library's own calls rewrite one metadata file an array, and a run killed between two of them
leaves variables of unequal length. Here every array's shape stands in the group's consolidated
metadata, one file that is replaced as a whole after the data are in place. Chunks are raw
little-endian C-order bytes. Specification: zarr-specs.readthedocs.io, core protocol version 3.
"""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

GROUP_FILE = "zarr.json"
_FILL: dict[str, Any] = {"float64": 0.0, "int64": 0, "bool": False}


def replace_file(path: Path, data: bytes) -> None:
    """Write `path` so that others see the old bytes or the new ones, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(data)
    os.replace(part, path)


def array_metadata(
    shape: Sequence[int],
    chunk: Sequence[int],
    dtype: str,
    dimensions: Sequence[str],
    attributes: Mapping[str, Any],
) -> dict[str, Any]:
    """The metadata document of one array; `dtype` is float64, int64 or bool."""
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
        "codecs": [{"name": "bytes", **endian}],
        "attributes": dict(attributes),
        "dimension_names": list(dimensions),
        "storage_transformers": [],
    }


def chunk_shape(metadata: Mapping[str, Any]) -> tuple[int, ...]:
    return tuple(metadata["chunk_grid"]["configuration"]["chunk_shape"])


def write_chunk(
    root: Path, name: str, metadata: Mapping[str, Any], number: int, values: NDArray[Any]
) -> None:
    """Chunk `number` along the first axis; the other axes are one chunk. May be short."""
    full = np.zeros(chunk_shape(metadata), dtype=_stored(metadata))
    full[tuple(slice(0, s) for s in values.shape)] = values
    replace_file(_chunk_file(root, name, metadata, number), full.tobytes())


def read_chunk(
    root: Path, name: str, metadata: Mapping[str, Any], number: int, count: int
) -> NDArray[Any]:
    """The first `count` rows of a chunk, as a writable copy."""
    raw = _chunk_file(root, name, metadata, number).read_bytes()
    full = np.frombuffer(raw, dtype=_stored(metadata)).reshape(chunk_shape(metadata))
    inner = tuple(slice(0, s) for s in metadata["shape"][1:])
    return np.array(full[(slice(0, count), *inner)])


def read_group(root: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((root / GROUP_FILE).read_text(encoding="utf-8"))
    return document


def arrays_of(document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """name -> metadata of each array in a group's document."""
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
    """The commit: what this file says is what the store holds."""
    replace_file(root / GROUP_FILE, to_json(document))


def to_json(document: Any) -> bytes:
    """UTF-8 text; numpy scalars and arrays become numbers and lists, nan is refused."""
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


def _chunk_file(root: Path, name: str, metadata: Mapping[str, Any], number: int) -> Path:
    inner = ["0"] * (len(metadata["shape"]) - 1)
    return root.joinpath(name, "c", str(number), *inner)
