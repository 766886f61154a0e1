"""Digests of plain data, arrays, sparse matrices and plugins: the keys of cached products."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel
from scipy.sparse import issparse

from sparsemor.core.scene.run_identity import origin


def digest(*parts: object) -> str:
    """Digest of all that a cached product depends on: plain data, arrays, sparse matrices, plugins.

    A plugin of another distribution counts with its version and its sources. Mappings count by
    content, not order; arrays by type, shape and bytes. Raises TypeError for anything whose content
    cannot be determined.
    """
    state, waiting = hashlib.sha256(), list[Any]([parts])  # the last one is next
    while waiting:
        part = waiting.pop()
        # Each piece is announced by its type and length, so that no two inputs run together.
        if part is None or isinstance(part, bool | int | float | str):
            text = json.dumps(part)
            state.update(f"{type(part).__name__}:{len(text)}:{text}".encode())
        elif isinstance(part, bytes):
            state.update(b"bytes:%d:" % len(part) + part)
        elif isinstance(part, Mapping):
            state.update(b"map:%d:" % len(part))
            for key in sorted(part, key=str, reverse=True):
                waiting += part[key], str(key)
        elif isinstance(part, np.ndarray | np.generic):
            array = np.ascontiguousarray(part)
            if array.dtype.hasobject:
                raise TypeError("an array of objects has no bytes to digest")
            state.update(f"array:{array.dtype.str}:{np.shape(part)}:".encode())
            state.update(array.view(np.uint8).data if array.size else b"")
        elif isinstance(part, Sequence):
            state.update(b"list:%d:" % len(part))
            waiting += reversed(part)
        elif issparse(part):
            csr = part.tocsr().sorted_indices()
            waiting.append(("csr", csr.shape, csr.indptr, csr.indices, csr.data))
        elif isinstance(part, BaseModel):
            options = {name: getattr(part, name) for name in type(part).model_fields}
            waiting.append((f"{type(part).__module__}.{type(part).__qualname__}", options,
                            origin(type(part))))
        else:
            raise TypeError(f"cannot digest a {type(part).__name__}: pass its plain data")
    return state.hexdigest()[:32]
