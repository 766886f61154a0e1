"""Damaged bytes in results and cache entries: named, or harmless; never other numbers."""

import logging
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from sparsemor import InputError, load, open_result, simulate
from sparsemor.core.cli import app
from sparsemor.core.errors import Damaged
from sparsemor.core.results import zarr_files
from sparsemor.core.results.run_result import RunResult
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
    files = sorted(p for p in (result / "result.zarr").rglob("*") if p.is_file())
    group = result / "result.zarr" / "zarr.json"
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
    assert named > 90  # the others: bytes replaced by themselves, metadata of single arrays
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
    chunk = result / "result.zarr" / "bar.thermal.coefficients" / "c" / "0" / "0"
    chunk.unlink()
    run = open_result(result)
    assert run.status is Status.DONE  # of the metadata, which are whole
    for read in (lambda: run.times, lambda: run.block("bar.thermal"), run.to_xarray):
        with pytest.raises(Damaged, match="is missing; rows 0 to 10 of bar.thermal.coeff") as error:
            read()
        assert str(chunk) in str(error.value)
    with xr.open_zarr(result / "result.zarr", chunks=None) as data:  # any other reader
        assert np.isnan(data["bar.thermal.coefficients"].to_numpy()).all()


def test_other_zarr_readers_see_the_checksums(result: Path) -> None:
    store = result / "result.zarr"
    with xr.open_zarr(store, chunks=None) as data:
        assert np.array_equal(data["bar.thermal.coefficients"],
                              open_result(result).coefficients("bar.thermal"))
    chunk = store / "bar.thermal.coefficients" / "c" / "0" / "0"
    raw = bytearray(chunk.read_bytes())
    raw[11] ^= 4
    chunk.write_bytes(raw)
    with (xr.open_zarr(store, chunks=None) as data,
          pytest.raises(ValueError, match="checksum")):
        data["bar.thermal.coefficients"].to_numpy()


@pytest.mark.full
def test_a_damaged_result_is_bad_input_of_commands(result: Path, tmp_path: Path) -> None:
    group = result / "result.zarr" / "zarr.json"
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


def test_results_of_format_1_are_read_and_others_refused(result: Path) -> None:
    store = result / "result.zarr"
    reference, document = everything(open_result(result)), zarr_files.read_group(store)
    document["attributes"]["format"] = 1
    for name, metadata in zarr_files.arrays_of(document).items():
        metadata["codecs"] = metadata["codecs"][:1]
        metadata["fill_value"] = {"float64": 0.0, "int64": 0, "bool": False}[metadata["data_type"]]
        for number in range(zarr_files.chunk_count(metadata)):
            file = zarr_files.chunk_file(store, name, metadata, number)
            file.write_bytes(file.read_bytes()[:-4])
    zarr_files.write_group(store, document)
    assert "checksum" not in (store / "zarr.json").read_text(encoding="utf-8")
    found = everything(open_result(result))
    for each in (found, reference):
        each["attributes"].pop("format")
    assert same(found, reference)
    (store / "bar.rigid" / "c" / "0" / "0").unlink(missing_ok=True)
    with pytest.raises(Damaged, match="is missing; rows 0 to 10 of bar.rigid"):
        open_result(result).block("bar.rigid")
    document["attributes"]["format"] = 3
    zarr_files.write_group(store, document)
    with pytest.raises(InputError, match="has format 3; this version reads formats 1 to 2"):
        _ = open_result(result).status


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
