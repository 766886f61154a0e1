"""Files of reduced models that were forged and signed again: each is refused in one line, or is a
model that runs; none takes much memory."""

import tracemalloc
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from hostile.model_mutants import forged, parts, signed
from small_scenes import tiny
from sparsemor import InputError, ReducedModel, SolveFailed, load_model, reduce
from sparsemor.plugins.kept_models.serializer import SMALL, Packed


@cache
def model() -> bytes:
    """File of the tiny scene with few atoms and steps."""
    scene = tiny().using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}},
        "probes": {"end": {"body": "bar", "at": "end_b"}}, "training.end": 0.02})
    return saved(reduce(scene))


def saved(made: ReducedModel) -> bytes:
    with TemporaryDirectory() as folder:
        made.save(Path(folder, "m"))
        return Path(folder, "m").read_bytes()


def refusal(file: Path, data: bytes, run: bool = True) -> str:
    """The line in which a file is refused, when it is read or by its first run; "" if it runs."""
    file.write_bytes(data)
    try:
        read = load_model(file)
        if run:
            read.run({"time.end": 0.01}).to_xarray()
            read.run({"time.end": 0.01}, out=file.with_suffix(""))
    except InputError as error:
        return str(error)
    except SolveFailed:
        pass
    return ""


def check(folder: Path, seed: int) -> str:
    said = refusal(folder / "forged.model", forged(model(), seed))
    assert "\n" not in said and "Traceback" not in said
    if said:  # and nothing is written
        assert "forged.model" in said and not (folder / "forged").exists()
    return said


@pytest.mark.parametrize("seed", range(12))
def test_a_forged_file_is_refused_in_one_line_or_runs(tmp_path: Path, seed: int) -> None:
    check(tmp_path, seed)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
def test_no_forged_file_ends_in_a_traceback(tmp_path: Path) -> None:
    refused = 0
    for seed in range(400):
        folder = tmp_path / str(seed)
        folder.mkdir()
        refused += bool(check(folder, seed))
    assert refused > 300


def with_leaf(path: tuple[Any, ...], value: object) -> bytes:
    head, arrays = parts(model())
    node = head[1]
    for key in path[:-1]:
        node = next(v for k, v in node["map"] if k == key) if isinstance(key, str) and (
            "map" in node) else node[key]
    node[path[-1]] = value
    return signed(head, arrays)


HEADER = ("header", "fields", 1)


@pytest.mark.parametrize(("value", "said"), [
    (None, "RunHeader.reducer is None"), (3, "RunHeader.reducer is 3"),
    ({"float": "inf"}, "RunHeader.reducer is inf"), ("a\0b", "a text holds the character NUL"),
    ("\ud800", "surrogates not allowed"), (10**30, "an integer has more than 64 bits"),
    ({"array": 0}, "RunHeader.reducer is an array of float64")])
def test_names_that_are_none(tmp_path: Path, value: object, said: str) -> None:
    assert said in refusal(tmp_path / "m", with_leaf((*HEADER, "reducer"), value), run=False)


HEADS: list[tuple[int, Any, str]] = [
    (0, ">f8", "an array of '>f8'"), (0, "|O", "an array of '|O'"), (0, "<c16", "an array of"),
    (1, [10**15], "which such a file cannot hold"), (1, [0, 10**15], "cannot hold"),
    (1, [2**33, 2**33], "cannot hold"), (1, [-1], "of the shape [-1]"), (1, [1] * 40, "the shape"),
    (1, [1.0], "of the shape [1.0]"), (1, [], "bytes than its arrays have"),
    (3, [0, 1, False], "as a product of"), (3, [-1, 0, False], "cannot be read"),
    (3, [10**9, 0, False], "cannot be read")]


@pytest.mark.parametrize(("at", "value", "said"), HEADS)
def test_arrays_that_are_none(tmp_path: Path, at: int, value: object, said: str) -> None:
    head, arrays = parts(model())
    large = max(head[3], key=lambda h: len(h[1]) * 1000 + np.prod(h[1]))
    large[at] = value
    assert said in refusal(tmp_path / "m", signed(head, arrays), run=False)


def nested(levels: int) -> bytes:
    return b'[{"scene":{},"name":""},' + b"[" * levels + b"]" * levels + b",[],[]]"


def zeros() -> bytes:
    head, arrays = parts(model())
    return signed(head, arrays + bytes(2**28), 9)


def many_products() -> bytes:
    """One matrix of 0.1 MB, and 10 000 arrays that are its product with a vector."""
    heads = [["<f8", [100, 100], "C", None], ["<f8", [100], "C", None],
             *[["<f8", [100, 100], "C", [0, 1, False]]] * 10_000]
    head, _ = parts(model())
    return signed([*head[:3], heads], np.random.default_rng(0).bytes(8 * 10_100))


def many_copies(of: str) -> bytes:
    """One array of 0.5 MB that is named 10 000 times."""
    n = 2**16
    heads = [["<f8", [n], "C", None], ["<i8", [n], "C", None], ["<i8", [2], "C", None],
             ["<f8", [1, 2, n // 2], "C", None]]
    data = np.random.default_rng(0).bytes(8 * n)
    arrays = data + np.arange(n).tobytes()  # bytes in another order, which is no matter here
    head, _ = parts(model())
    node: Any = {"swapped": 3} if of == "swapped" else {"csr": [0, 1, 2, [1, n]]}
    return signed([head[0], {"list": [node] * 10_000}, [], heads],
                  arrays + np.array([0, n]).tobytes() + data)


BOMBS = {
    "zeros": zeros, "products": many_products, "swapped": lambda: many_copies("swapped"),
    "matrices": lambda: many_copies("csr"), "nested": lambda: signed(nested(900), b""),
    "nested deeper": lambda: signed(nested(100_000), b""),
    "lists": lambda: signed(b"[{},[" + b"[]," * 5_000_000 + b"[]],[],[]]", b""),
    "numbers": lambda: signed(b"[{},[" + b"0," * 10_000_000 + b"0],[],[]]", b""),
    "head": lambda: signed(b" " * 10_000_000, b""),
}


@pytest.mark.full
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_takes_no_memory(tmp_path: Path, name: str) -> None:
    """At most twice what the file may hold: 64 times its bytes for what compresses as no number
    does, which is less than 20 MB here; it would be up to 1 GB."""
    data = BOMBS[name]()
    tracemalloc.start()
    try:
        assert "is no reduced model that this program can use" in refusal(tmp_path / "m", data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2e7 + 3 * len(data), peak


def test_memory_is_at_most_twice_the_content() -> None:
    rng = np.random.default_rng(0)
    arrays = tuple(rng.random((100, 250)) for _ in range(20))
    packed = Packed({"list": []}, arrays, frozenset(), {"scene": {}, "name": ""})
    data, content = packed.dump(), sum(a.nbytes for a in arrays)
    tracemalloc.start()
    try:
        read = Packed.load(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert all(map(np.array_equal, read.arrays, arrays)) and peak < 2 * content, peak


def test_arrays_that_compress_well_are_read() -> None:
    """A file of zeros, as of a model whose coupling vanishes, is stored as it is."""
    packed = Packed(None, (np.zeros((500, 600)),), frozenset(), {"scene": {}, "name": ""})
    data = packed.dump()
    assert len(data) > SMALL and Packed.load(data).arrays[0].shape == (500, 600)
