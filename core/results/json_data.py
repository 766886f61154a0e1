"""Plain data as JSON."""

import json
import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


def finite(value: Any) -> Any:
    """Plain data with None instead of nan and infinity, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    return [finite(v) for v in value] if isinstance(value, list | tuple) else value


def to_json(document: object) -> bytes:
    """JSON as UTF-8: numpy scalars and arrays become numbers and lists. Raises ValueError for
    nan."""
    return json.dumps(document, allow_nan=False, default=_plain, indent=1).encode("utf-8")


def checksum_of(document: object) -> int:
    """CRC-32 of plain data, whatever spaces its JSON has."""
    text = json.dumps(document, allow_nan=False, default=_plain, separators=(",", ":"))
    return zlib.crc32(text.encode("utf-8"))


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    raise TypeError(f"a {type(value).__name__} cannot be stored in a result's attributes")
