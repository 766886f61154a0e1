"""The cache returns what was made, or makes it again; never something half."""

import json
import logging
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.scene.digest import digest
from sparsemor.core.simulation.cache import Cache, cache_folder

ARRAYS = {"link1.elastic": np.arange(12.0).reshape(3, 4), "empty": np.zeros((0, 3)),
          "flag": np.array([True, False])}


class Maker:
    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> dict[str, np.ndarray]:
        self.calls += 1
        return ARRAYS


def same(given: dict[str, np.ndarray]) -> bool:
    return given.keys() == ARRAYS.keys() and all(
        np.array_equal(given[k], v) and given[k].dtype == v.dtype for k, v in ARRAYS.items())


def test_made_once_then_found(tmp_path: Path) -> None:
    cache, make = Cache(tmp_path / "c"), Maker()
    arrays, hit = cache.get_or_make("snapshots", "k1", make)
    assert same(arrays) and not hit
    arrays, hit = Cache(tmp_path / "c").get_or_make("snapshots", "k1", make)
    assert same(arrays) and hit and make.calls == 1
    cache.get_or_make("snapshots", "k2", make)
    assert make.calls == 2


def test_large_arrays_are_mapped_read_only(tmp_path: Path) -> None:
    large = {"x": np.arange(2**21, dtype=np.float64)}
    Cache(tmp_path).get_or_make("k", "large", lambda: large)
    arrays, hit = Cache(tmp_path).get_or_make("k", "large", lambda: large)
    assert hit and isinstance(arrays["x"], np.memmap) and not arrays["x"].flags.writeable
    assert np.array_equal(arrays["x"], large["x"])


@pytest.mark.parametrize("harm", ["truncate", "remove", "garble manifest", "no manifest"])
def test_a_damaged_entry_is_made_again(
    tmp_path: Path, harm: str, caplog: pytest.LogCaptureFixture
) -> None:
    cache, make = Cache(tmp_path), Maker()
    cache.get_or_make("k", "e", make)
    entry = tmp_path / "k" / "e"
    if harm == "truncate":
        (entry / "000.npy").write_bytes((entry / "000.npy").read_bytes()[:-8])
    elif harm == "remove":
        (entry / "000.npy").unlink()
    elif harm == "garble manifest":
        (entry / "manifest.json").write_text("{", encoding="utf-8")
    else:
        (entry / "manifest.json").unlink()
    with caplog.at_level(logging.WARNING):
        arrays, hit = cache.get_or_make("k", "e", make)
    assert same(arrays) and not hit and make.calls == 2 and "made again" in caplog.text
    assert cache.get_or_make("k", "e", make)[1]


def test_a_failing_maker_leaves_nothing(tmp_path: Path) -> None:
    def fail() -> dict[str, np.ndarray]:
        raise RuntimeError("no")

    with pytest.raises(RuntimeError):
        Cache(tmp_path).get_or_make("k", "e", fail)
    assert Cache(tmp_path).entries() == []


def test_listing_and_clearing(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "none yet")
    assert cache.entries() == [] and cache.clear() == 0
    cache.get_or_make("a", "1", Maker())
    cache.get_or_make("b", "2", Maker())
    assert [(e.kind, e.key) for e in cache.entries()] == [("a", "1"), ("b", "2")]
    assert all(e.size > ARRAYS["link1.elastic"].nbytes for e in cache.entries())
    assert cache.clear("a") == cache.entries()[0].size
    assert [e.kind for e in cache.entries()] == ["b"]


def test_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"
    monkeypatch.delenv("SPARSEMOR_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sparsemor"


class Choice(Plugin):
    rows: int = 3


class Other(Plugin):
    rows: int = 3


def test_digest_tells_apart_what_differs_and_nothing_else() -> None:
    x = np.arange(6.0)
    assert digest({"a": 1, "b": [x]}) == digest({"b": [x.copy()], "a": 1})
    assert digest(x[::2]) == digest(x[::2].copy())
    different = [
        (x,), (x.astype(np.float32),), (x.reshape(2, 3),), (x[:5],), ("a", "bc"), ("ab", "c"),
        ("a",), (["a"],), (1,), (1.0,), (True,), (None,), ("1",), (b"1",), ({"a": 1},),
        (Choice(),), (Choice(rows=4),), (Other(),), (sp.csr_array(np.eye(3)),),
        (sp.csr_array(2.0 * np.eye(3)),), (0.1,), (np.nextafter(0.1, 1.0).item(),)]
    assert len({digest(*parts) for parts in different}) == len(different)
    with pytest.raises(TypeError, match="cannot digest a object"):
        digest(object())


FORGED: dict[str, object] = {
    "a list": [], "a number": 3, "no table": {"checksum": 0}, "a table of text": "abc",
    "files elsewhere": {"flag": ["../../thesis.tex", 0]}, "no checksum": {"flag": ["000.npy"]},
    "a name that is null": {"flag": [None, 0]}, "an empty file": b"", "no array": b"{}",
    "objects": b"\x93NUMPY\x01\x00\x3e\x00{'descr': '|O', 'fortran_order': False, "
               b"'shape': (1,)}   \n",
    "a huge array": b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': "
                    b"(1000000000000000,), }" + b" " * 45 + b"\n",
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_entry_is_a_miss(tmp_path: Path, name: str) -> None:
    """Whoever can write to a shared cache can sign what they like: it is made again."""
    forged, make = FORGED[name], Maker()
    place = tmp_path / "k" / "x"
    place.mkdir(parents=True)
    manifest: object = forged
    if isinstance(forged, bytes):
        (place / "000.npy").write_bytes(forged)
        manifest = {"flag": ["000.npy", zlib.crc32(forged)]}
    if isinstance(manifest, dict | str) and manifest != {"checksum": 0}:
        manifest = {"files": manifest, "checksum": zlib.crc32(json.dumps(manifest).encode())}
    (place / "manifest.json").write_text(json.dumps(manifest))
    arrays, hit = Cache(tmp_path).get_or_make("k", "x", make)
    assert same(arrays) and not hit and make.calls == 1
