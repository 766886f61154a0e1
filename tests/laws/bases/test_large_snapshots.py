"""More snapshots than are held at once: written as they come, read and decomposed by stretches."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core import BlockData, Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg import snapshots as snapshots_module
from sparsemor.core.linalg.snapshots import SnapshotWriter, column_chunks
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import largest_coefficient
from sparsemor.core.testing.random_inputs import random_block
from sparsemor.plugins.bases.pod import Pod

SCENES = Path(__file__).parents[2] / "scenes"
N, M = 600, 120


@pytest.fixture
def few_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """1000 bytes count as much; stretches of 7 columns."""
    monkeypatch.setattr(snapshots_module, "HELD", 1000)
    monkeypatch.setattr(snapshots_module, "STRETCH", 8 * N * 7)


def matrix(decay: float) -> FloatArray:
    """(N, M) with singular values from 1 down to 10^-decay."""
    rng = np.random.default_rng(0)
    U, V = (np.linalg.qr(rng.standard_normal((n, M)))[0] for n in (N, M))
    return np.asarray((U * 10.0 ** -np.linspace(0.0, decay, M)) @ V.T)


def data(A: FloatArray) -> BlockData:
    return replace(random_block(np.random.default_rng(0)), snapshots=A)


def missed(A: FloatArray, d: Dictionary) -> float:
    rest = A - d.offset[:, None]
    return float(np.linalg.norm(rest - d.atoms @ (d.atoms.T @ rest)))


@pytest.mark.parametrize(("decay", "options"), [
    (1.0, {"count": 30}), (4.0, {"count": 12, "centred": True}), (12.0, {"count": 8})])
def test_as_good_as_the_exact_decomposition(
    decay: float, options: dict[str, Any], few_held: None
) -> None:
    A = matrix(decay)
    d = Pod(**options).build(data(A))
    rest = A - d.offset[:, None]
    s, k = np.linalg.svd(rest, compute_uv=False), options["count"]
    assert d.atoms.shape == (N, k)
    np.testing.assert_allclose(d.atoms.T @ d.atoms, np.eye(k), atol=1e-12)
    # no k columns miss less than the exact ones; these miss at most a thousandth more
    assert missed(A, d) <= 1.001 * np.linalg.norm(s[k:]) + 1e-13
    told = d.info["energy"]
    assert isinstance(told, float)
    assert abs(told - float(s[:k] @ s[:k] / (s @ s))) < 1e-4
    again = Pod(**options).build(data(A))
    assert np.array_equal(again.atoms, d.atoms)


def test_energy_decides_as_it_does_exactly(few_held: None, monkeypatch: pytest.MonkeyPatch) -> None:
    A = matrix(12.0)
    for energy in (0.9, 0.99, 0.9999):
        d = Pod(energy=energy).build(data(A))
        monkeypatch.setattr(snapshots_module, "HELD", 2**28)
        exact = Pod(energy=energy).build(data(A))
        monkeypatch.setattr(snapshots_module, "HELD", 1000)
        assert d.atoms.shape == exact.atoms.shape
        assert missed(A, d) <= 1.001 * missed(A, exact)


def test_all_columns_above_round_off_where_they_are_few(few_held: None) -> None:
    rng = np.random.default_rng(1)
    A = rng.standard_normal((N, 9)) * 10.0 ** -np.arange(9.0) @ rng.standard_normal((9, M))
    d = Pod().build(data(A))
    assert d.info["numerical_rank"] == 9
    assert d.atoms.shape[1] == 9 and missed(A, d) < 1e-12 * np.linalg.norm(A)
    weighted = Pod(weights="inverse_sqrt_norm").build(data(A))
    assert weighted.atoms.shape[1] == 9 and missed(A, weighted) < 1e-12 * np.linalg.norm(A)


def test_more_than_a_third_is_refused_in_words(few_held: None) -> None:
    with pytest.raises(InputError, match="limit their number by count or energy") as refused:
        Pod().build(data(matrix(2.0)))
    assert refused.value.faults[0].key == "count"


def test_faults_of_large_ones(few_held: None) -> None:
    A = matrix(12.0)
    A[3, 50] = np.nan
    with pytest.raises(InputError, match="snapshot 50"):
        Pod(count=3).build(data(A))
    with pytest.raises(InputError, match="are zero"):
        Pod(count=3).build(data(np.zeros((N, M))))


def test_rows_in_a_file_are_read_as_they_were_given(tmp_path: Path, few_held: None) -> None:
    rows = np.random.default_rng(0).standard_normal((23, N))
    writer = SnapshotWriter("disk.elastic", 23, N, lambda: tmp_path)
    for row in rows:
        writer.append(row)
    kept = writer.finished()
    assert isinstance(kept, np.memmap) and np.array_equal(kept, rows)
    found = list(column_chunks(kept.T))
    assert [at.stop - at.start for at, _ in found] == [7, 7, 7, 2]
    assert np.array_equal(np.concatenate([part for _, part in found], axis=1), rows.T)
    # what was read is no view of the map: its pages are not held
    assert not any(isinstance(part.base, np.memmap) for _, part in found)
    part = kept[3:].T
    assert np.array_equal(np.concatenate([p for _, p in column_chunks(part)], axis=1), rows[3:].T)
    d = Dictionary(np.eye(N)[:, :2], np.zeros(N), ("a", "b"))
    assert largest_coefficient(d, kept.T) == np.abs(rows[:, :2]).max()


def small(**changes: Any) -> Any:
    return load(SCENES / "heated_disk.yaml", {
        "bodies.disk.mesh.refine": 0.3, "time.end": 6e-3, "integrator": "generalized_alpha",
        "reducer.basis.count": 3, **changes})


@pytest.mark.full
def test_a_run_on_streamed_snapshots_keeps_them_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = simulate(small(), cache=Cache(tmp_path / "plain"))
    monkeypatch.setattr(snapshots_module, "HELD", 1000)
    cache = Cache(tmp_path / "cache")
    run = simulate(small(), cache=cache)
    for name in ("disk.elastic", "disk.thermal"):
        want = plain.block(name)
        assert np.abs(run.block(name) - want).max() <= 1e-6 * np.abs(want - want[0]).max()
    assert {e.kind for e in cache.entries()} == {
        "training", "basis", "galerkin_error", "trial_space"}
    assert not [f for d in cache.root.glob(".sparsemor-tmp.*") for f in d.iterdir()]
    again = simulate(small(), cache=cache)
    assert again.summary["cache"] == {
        "basis": "hit", "galerkin_error": "hit", "trial_space": "hit"}
    assert np.array_equal(again.block("disk.elastic"), run.block("disk.elastic"))


def test_scratch_of_a_process_that_is_gone_is_removed(tmp_path: Path) -> None:
    kept = TemporaryFolder(tmp_path), TemporaryFolder(tmp_path)
    own = kept[0].path
    gone = own.with_name(own.name.replace(f".{os.getpid()}.", ".4194305."))  # above Linux's limit
    gone.mkdir()
    (gone / "a.npy").write_bytes(b"1")
    other = TemporaryFolder(tmp_path)
    assert own.exists() and other.path.exists() and not gone.exists()
    del kept, other
    assert not list(tmp_path.iterdir())
