"""Damaged bytes in results and cache entries: named, or harmless; never other numbers."""

import logging
import shutil
import zipfile
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sparsemor import InputError, load, open_result, simulate
from sparsemor.core.cli import app
from sparsemor.core.errors import Damaged
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stored_arrays import read_header, write_header
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.status import Status

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"
GALERKIN = {"time.end": 0.01, "check_stability": "off", "reducer": {
    "use": "galerkin", "basis": {"use": "pod", "count": 3}}}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A reduced run of ten steps and its result."""
    folder = tmp_path_factory.mktemp("whole")
    simulate(load(TINY, GALERKIN), out=folder / "run", cache=Cache(folder / "cache"))
    return folder


@pytest.fixture
def result(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole / "run", tmp_path / "run"))


def everything(run: RunResult) -> dict[str, Any]:
    """All that can be read: attributes, arrays, and fields that are rebuilt from them."""
    found: dict[str, Any] = {"attributes": run.attributes, "summary": run.summary}
    found |= {f"data {n}": v.to_numpy() for n, v in run.to_xarray().variables.items()}
    found |= {b.name: run.block(b.name) for b in run.layout}
    found |= {f"probe {n}": run.probe(n) for n in run.probes}
    found["nodes"] = run.nodal_displacement("bar", -1)
    found["kelvin"] = run.nodal_temperature("bar", -1)
    found["cells"], found["points"] = run.cells("bar"), run.points("bar")
    return found


def same(a: dict[str, Any], b: dict[str, Any]) -> bool:
    return a.keys() == b.keys() and all(
        np.array_equal(v, b[k]) if isinstance(v, np.ndarray) else v == b[k] for k, v in a.items())


def damage(file: Path, rng: np.random.Generator) -> str:
    """One bit turned, one byte replaced, some bytes swapped for zeros, cut, lengthened, or gone."""
    data = bytearray(file.read_bytes())
    kind = str(rng.choice(["bit", "byte", "zeros", "cut", "longer", "gone"],
                          p=[0.5, 0.2, 0.1, 0.1, 0.05, 0.05]))
    at = int(rng.integers(len(data)))
    if kind == "bit":
        data[at] ^= 1 << int(rng.integers(8))
    elif kind == "byte":
        data[at] = int(rng.integers(256))
    elif kind == "zeros":
        data[at:at + 16] = bytes(len(data[at:at + 16]))
    elif kind == "cut":
        del data[at:]
    elif kind == "longer":
        data += data[:8]
    file.write_bytes(data)
    if kind == "gone":
        file.unlink()
    return kind


@pytest.mark.full
def test_damaged_results_are_named_or_harmless(result: Path) -> None:
    rng, reference = np.random.default_rng(14), everything(open_result(result))
    files = sorted(p for p in (result / "result").rglob("*") if p.is_file())
    group = result / "result" / "header.json"
    named = 0
    for turn in range(150):
        file = group if turn % 3 == 0 else files[int(rng.integers(len(files)))]
        before = file.read_bytes()
        kind = damage(file, rng)
        try:
            found = everything(open_result(result))
        except InputError as error:
            named += 1
            missing = file == group and kind == "gone"
            assert missing or isinstance(error, Damaged) and str(file) in str(error), error
        else:
            assert same(found, reference), f"{turn}: {kind} in {file}"
        file.write_bytes(before)
    assert named > 90  # the others: bytes replaced by themselves, dates of the archive
    assert same(everything(open_result(result)), reference)


@pytest.mark.full
def test_damaged_cache_entries_are_made_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng = np.random.default_rng(14)
    arrays = {"bar.elastic": rng.normal(size=(24, 5)), "rows": np.arange(7),
              "flags": np.arange(9) % 2 == 0, "none": np.zeros((0, 3))}
    cache, made, harmless = Cache(tmp_path), 0, 0

    def make() -> dict[str, np.ndarray]:
        nonlocal made
        made += 1
        return arrays

    cache.get_or_make("basis", "k", make)
    files = sorted((tmp_path / "basis" / "k").iterdir())
    with caplog.at_level(logging.ERROR):
        for turn in range(150):
            file = files[turn % len(files)]
            before = made
            damage(file, rng)
            found, hit = cache.get_or_make("basis", "k", make)
            assert same(dict(found), arrays), turn
            assert hit is (made == before)
            harmless += hit
            shutil.rmtree(tmp_path / "basis" / "k")
            cache.get_or_make("basis", "k", make)
    assert harmless < 10  # bytes replaced by themselves


def test_a_missing_chunk_is_an_error_and_never_zeros(result: Path) -> None:
    chunk = result / "result" / "steps-000000.npz"
    chunk.unlink()
    run = open_result(result)
    assert run.status is Status.DONE  # of the metadata, which are whole
    for read in (lambda: run.times, lambda: run.block("bar.thermal"), run.to_xarray):
        with pytest.raises(Damaged, match="is missing; steps 0 to 10 are lost") as error:
            read()
        assert str(chunk) in str(error.value)


def test_other_readers_see_the_checksums(result: Path) -> None:
    chunk = result / "result" / "steps-000000.npz"
    with np.load(chunk) as data:
        kept = data["bar.thermal.coefficients"]
        assert np.array_equal(kept, open_result(result).coefficients("bar.thermal"))
    raw = chunk.read_bytes()
    at = raw.index(kept.tobytes())
    chunk.write_bytes(raw[:at + 11] + bytes([raw[at + 11] ^ 4]) + raw[at + 12:])
    with np.load(chunk) as data, pytest.raises(zipfile.BadZipFile, match="CRC-32"):
        data["bar.thermal.coefficients"]


@pytest.mark.full
def test_a_damaged_result_is_bad_input_of_commands(result: Path, tmp_path: Path) -> None:
    group = result / "result" / "header.json"
    text = group.read_text(encoding="utf-8")
    group.write_text(text.replace('"done"', '"dome"'), encoding="utf-8")
    for command in (["export", str(result), "--out", str(tmp_path / "x")],
                    ["run", str(TINY), "--out", str(result), "--resume"]):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 2
        assert done.stderr.startswith(f"{group} is damaged or was edited"), done.stderr
    group.write_text(text[:-40], encoding="utf-8")
    done = CliRunner().invoke(app, ["export", str(result), "--out", str(tmp_path / "x")])
    assert done.exit_code == 2 and done.stderr.startswith(f"{group} is damaged")
    again = ["run", str(TINY), "--set", "time.end=0.01", "--out", str(result), "--force"]
    done = CliRunner().invoke(app, again)  # nothing says any longer which files are ours
    assert done.exit_code == 2 and f"{group}: not written by sparsemor, or changed" in done.stderr
    assert group.read_text(encoding="utf-8") == text[:-40]
    shutil.rmtree(result)
    assert CliRunner().invoke(app, again).exit_code == 0


def test_results_of_other_formats_are_refused(result: Path) -> None:
    store = result / "result"
    document = read_header(store)
    document["attributes"]["format"] = 4
    write_header(store, document)
    with pytest.raises(InputError, match="has format 4; this version reads format 3"):
        _ = open_result(result).status
    store.rename(result / "result.zarr")  # as earlier versions wrote it, a Zarr group
    (result / "result.zarr" / "header.json").rename(result / "result.zarr" / "zarr.json")
    (result / "result.checkpoint").unlink()
    for place in (result, result / "result.zarr"):
        with pytest.raises(InputError, match=r"result.zarr is a result of an earlier format "
                           r"\(Zarr\) of sparsemor .+, which this version does not read") as said:
            open_result(place)
        assert f"sparsemor {version('sparsemor')}, which" in str(said.value)
    again = ["run", str(TINY), "--set", "time.end=0.01", "--out", str(result)]
    for more, words in (("--resume", "earlier format"), ("--quiet", "not empty"),
                       ("--force", "holds none")):
        done = CliRunner().invoke(app, [*again, more])
        assert done.exit_code == 2 and words in done.stderr, done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_arrays_of_a_result_are_read_only(result: Path) -> None:
    """A change in place would change what the result returns from then on."""
    run, before = open_result(result), everything(open_result(result))
    kept = [run.times, run.step_seconds, run.points("bar"),
            run.cells("bar"), run.iterations, run.support("bar.elastic")]
    for array in kept:
        with pytest.raises(ValueError, match="read-only"):
            array *= array
    with suppress(ValueError):
        run.coefficients("bar.elastic")[:] *= 1e3
    run.block("bar.elastic")[:] = 1e3  # one's own: it is computed at each call
    run.to_xarray()["bar.thermal.coefficients"].values[:] = 0.0
    assert same(everything(run), before)
