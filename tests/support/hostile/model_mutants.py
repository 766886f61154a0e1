"""Files of reduced models that were changed and signed again, so that their digest fits."""

import hashlib
import json
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from sparsemor.core.results.model_file import MAGIC

LEAVES: tuple[Any, ...] = (
    None, 0, -1, 3, 10**6, 10**12, 10**30, True, "", "a\0b", "\ud800", "x" * 3000, "bar.elastic",
    [], {}, {"list": []}, {"tuple": []}, {"map": []}, {"float": "nan"}, {"float": "inf"},
    {"float": "0x1p+900"}, {"array": 0}, {"array": 5}, {"scalar": 3}, {"slice": [0, 10**9, 1]},
    {"slice": [None, None, -1]}, {"set": [1]}, {"again": 0}, {"swapped": 2})
TYPES = (">f8", "<f4", "<f2", "<i8", "<u1", "|b1", "|O", "<U4", "<c16", "<M8[s]", "|V8", "f8", "",
         None, 8)

KINDS = ("leaf", "leaf", "leaf", "node", "head", "head", "arrays", "about", "drop")


def parts(data: bytes) -> tuple[list[Any], bytes]:
    """Head (about, tree, used, heads) and bytes of the arrays."""
    body = zlib.decompress(data[len(MAGIC) + 65:])
    size = int.from_bytes(body[:8], "little")
    return json.loads(body[8 : 8 + size]), body[8 + size:]


def signed(head: object, arrays: bytes, level: int = 6) -> bytes:
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    payload = zlib.compress(len(text).to_bytes(8, "little") + text + arrays, level)
    return MAGIC + hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload


def forged(data: bytes, seed: int) -> bytes:
    """A file in which one thing is changed, or a few."""
    rng = np.random.default_rng(seed)
    head, arrays = parts(data)
    for _ in range(1 + seed % 3 // 2):
        kind = rng.choice(KINDS)
        about, tree, _, heads = head
        if kind in ("leaf", "about", "drop", "node"):
            places = list(_places(about["scene"] if kind == "about" else tree))
            leaves = [p for p in places if not isinstance(p[0][p[1]], list | dict)]
            where, key = _one(rng, leaves if kind in ("leaf", "about") else places)
            if kind == "drop":
                del where[key]
            elif kind == "node":
                other, of = _one(rng, places)
                where[key] = json.loads(json.dumps(other[of]))
            else:
                where[key] = _one(rng, LEAVES)
        elif kind == "head":
            _change(_one(rng, heads), len(heads), rng)
        else:
            arrays = _changed(arrays, rng)
    return signed(head, arrays)


def _one(rng: np.random.Generator, of: Any) -> Any:
    return of[int(rng.integers(len(of)))]


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every place in a tree, as a container and its key."""
    for key in (range(len(node)) if isinstance(node, list) else list(node)):
        yield node, key
        if isinstance(node[key], list | dict):
            yield from _places(node[key])


def _change(head: list[Any], count: int, rng: np.random.Generator) -> None:
    kind = int(rng.integers(4))
    if kind == 0:
        head[0] = _one(rng, TYPES)
    elif kind == 1:
        shape, size = head[1], max(1, int(np.prod(head[1])))
        head[1] = _one(rng, [shape[::-1], [*shape, 1], [1] * 40, [size], [size, 1], [-1], shape[1:],
                             [10**18], [0, 10**12], [1.5], None, [2**32, 2**32], [True], "ab"])
    elif kind == 2:
        head[2] = _one(rng, ["F", "C", "K", None, 1])
    else:
        head[3] = _one(rng, [[int(rng.integers(count)), int(rng.integers(count)), True], [0, 1],
                             [-1, -1, False], 7, "x", [10**9, 0, False], [0, 0, None]])


def _changed(arrays: bytes, rng: np.random.Generator) -> bytes:
    made, kind = bytearray(arrays), int(rng.integers(4))
    at = int(rng.integers(len(made)))
    if kind == 0:
        return bytes(made[:at])
    if kind == 1:
        return bytes(made) + rng.bytes(at + 1)
    for i in rng.integers(0, len(made), 1 if kind == 2 else 200):
        made[i] = int(rng.choice([0, 255, 127, 128]))
    return bytes(made)
