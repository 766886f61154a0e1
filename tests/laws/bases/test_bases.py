"""POD finds known subspaces down to round-off; what the law kit of bases catches."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sparsemor.core import BlockData, Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_basis
from sparsemor.core.testing.random_inputs import random_block
from sparsemor.plugins.bases.pod import Pod
from sparsemor.plugins.bases.snapshot_svd import round_off_level


@pytest.mark.parametrize(
    "pod",
    [
        Pod(centred=True),
        Pod(complete=True),
        Pod(energy=0.99),
        Pod(count=3),
        Pod(energy=1.0, centred=True),
        Pod(window=2),
    ],
    ids=repr,
)
def test_pod_keeps_the_laws_with_every_option(pod: Pod) -> None:
    check_basis(pod, seed=1, trials=3)


def block_of(snapshots: FloatArray) -> BlockData:
    n = snapshots.shape[0]
    block = random_block(np.random.default_rng(0))
    return replace(
        block, snapshots=snapshots, coordinates=np.arange(float(n))[:, None], name="link.thermal"
    )


def decaying(n: int, M: int, s: FloatArray, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Left singular vectors and the (n, M) matrix with singular values s."""
    rng = np.random.default_rng(seed)
    U = np.linalg.qr(rng.standard_normal((n, s.size)))[0]
    V = np.linalg.qr(rng.standard_normal((M, s.size)))[0]
    return U, (U * s) @ V.T


@pytest.mark.parametrize(("n", "M"), [(500, 400), (200, 700), (1000, 150), (60, 50)])
def test_directions_are_found_down_to_the_round_off_level(n: int, M: int) -> None:
    """Those below it are cut, and the cut is reported."""
    s = 10.0 ** -np.linspace(0.0, 16.0, 40)
    U, A = decaying(n, M, s)
    dictionary = Pod().build(block_of(A))
    kept = int((s > round_off_level(n, M)).sum())
    info = dictionary.info
    assert info["kept"] == info["numerical_rank"] == kept and info["snapshots"] == M
    assert "round-off" in str(info["cut"])
    Q = dictionary.atoms
    assert np.abs(Q.T @ Q - np.eye(kept)).max() < 1e-13
    missed = np.linalg.norm(U[:, :kept] - Q @ (Q.T @ U[:, :kept]), axis=0)
    # a direction of singular value s is known to round-off / s, whatever the method
    assert (missed < 50.0 * np.finfo(float).eps / s[:kept] + 1e-13).all()
    assert np.linalg.norm(A - Q @ (Q.T @ A), 2) < 1.1 * round_off_level(n, M)


def test_energy_and_count_keep_as_few_columns_as_they_allow() -> None:
    s = np.array([1.0, 0.1, 0.01, 0.001])
    _, A = decaying(50, 40, s)

    def build(**options: Any) -> Dictionary:
        return Pod(**options).build(block_of(A))

    assert build(energy=0.99).atoms.shape[1] == 1
    assert build(energy=0.9999).atoms.shape[1] == 2
    assert build(energy=1.0).atoms.shape[1] == 4
    assert build(energy=0.9999, count=1).info["cut"] == "count"
    assert build(energy=0.99, count=3).info["cut"] == "energy"
    assert build(count=9).info["kept"] == 4
    assert build(count=2).info["energy"] == pytest.approx(1.01 / (s @ s), rel=1e-12)


def test_the_mean_of_centred_snapshots_is_the_offset() -> None:
    _, A = decaying(80, 60, np.array([1.0, 0.1]))
    A = A + 293.0
    centred, plain = Pod(centred=True).build(block_of(A)), Pod().build(block_of(A))
    np.testing.assert_allclose(centred.offset, A.mean(axis=1))
    assert not plain.offset.any()
    assert (centred.atoms.shape[1], plain.atoms.shape[1]) == (2, 3)


def test_round_off_of_a_large_mean_is_not_taken_for_motion() -> None:
    A = np.full((60, 50), 293.0) + 5.6e-14 * np.random.default_rng(0).integers(-1, 2, (60, 50))
    A = A.astype(np.float64)
    with pytest.raises(InputError, match="do not differ from their mean"):
        Pod(centred=True).build(block_of(A))


def test_completion_is_orthonormal_and_named() -> None:
    _, A = decaying(30, 20, np.array([1.0, 0.1, 0.01]))
    dictionary = Pod(complete=True).build(block_of(A))
    assert dictionary.atoms.shape == (30, 30)
    assert np.abs(dictionary.atoms.T @ dictionary.atoms - np.eye(30)).max() < 1e-13
    assert dictionary.provenance[:4] == ("pod 0", "pod 1", "pod 2", "completion 0")
    assert dictionary.info["completed"] == 27
    assert Pod(complete=True, count=7).build(block_of(A)).atoms.shape == (30, 7)


def test_atoms_of_windows_are_orthonormal_and_a_travelling_source_needs_few() -> None:
    """Each snapshot is represented to the tolerance, and takes a quarter of the atoms that it takes
    of the leading vectors of the whole run."""
    x, centres = np.linspace(0.0, 1.0, 400), np.linspace(0.1, 0.9, 240)
    A = np.exp(-0.5 * ((x[:, None] - centres) / 0.01) ** 2)
    made = Pod(window=20, tolerance=1e-5).build(block_of(A))
    few, whole = made.atoms, Pod(count=made.atoms.shape[1]).build(block_of(A)).atoms
    assert np.abs(few.T @ few - np.eye(few.shape[1])).max() < 1e-13
    assert made.info["windows"] == 12 and made.provenance[0] == "window 0, pod 0"
    size = np.linalg.norm(A, axis=0).max()

    def needed(Q: FloatArray) -> int:
        """Largest number of coefficients of a snapshot for an error of 1e-3."""
        c = np.sort(np.abs(Q.T @ A), axis=0)[::-1]
        rest = np.maximum(np.sum(A * A, axis=0) - np.cumsum(c * c, axis=0), 0.0)
        return int((np.sqrt(rest) > 1e-3 * size).sum(axis=0).max())

    assert np.linalg.norm(A - few @ (few.T @ A), axis=0).max() < 1e-3 * size
    assert needed(few) < 0.25 * needed(whole)
    with pytest.raises(ValidationError, match="leave out count"):
        Pod(window=20, count=3)


def test_the_largest_entry_of_each_atom_is_positive() -> None:
    _, A = decaying(40, 30, np.array([1.0, 0.5, 0.1]))
    for snapshots in (A, -A):
        atoms = Pod(complete=True).build(block_of(snapshots)).atoms
        assert (atoms[np.abs(atoms).argmax(axis=0), np.arange(40)] > 0).all()


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_snapshots_whose_squares_are_no_numbers_are_refused(size: float) -> None:
    _, A = decaying(40, 30, np.array([1.0, 0.5, 0.1]))
    with pytest.raises(InputError, match="take other units"):
        Pod(count=2).build(block_of(size * A))


@pytest.mark.parametrize(
    "options",
    [{"energy": 0.0}, {"energy": 1.5}, {"count": 0}, {"energy": 0.9, "complete": True}],
    ids=str,
)
def test_options_out_of_range_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Pod.model_validate(options)


class Broken(Pod):
    """Each fault, one law."""

    fault: str

    def build(self, data: BlockData) -> Dictionary:
        if self.fault == "accepts anything" and not (
            np.isfinite(data.snapshots).all() and data.snapshots.any()
        ):
            n = data.snapshots.shape[0]
            return Dictionary(np.eye(n), np.zeros(n), tuple("x" * n))
        good = super().build(data)
        if self.fault == "not unit":
            return replace(good, atoms=2.0 * good.atoms)
        if self.fault == "provenance":
            return replace(good, provenance=good.provenance[1:])
        if self.fault == "claims too much":
            return replace(good, atoms=good.atoms[:, :1], provenance=good.provenance[:1])
        if self.fault == "writes":
            data.snapshots[0, 0] += 1.0
        if self.fault == "forgets the mean":
            return replace(good, offset=good.offset + 1.0)
        if self.fault == "not repeatable":
            rng = np.random.default_rng()
            flip = np.where(rng.random(good.atoms.shape[1]) < 0.5, -1.0, 1.0)
            return replace(good, atoms=good.atoms * flip * rng.choice([-1.0, 1.0]))
        return good


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("not unit", "unit columns"),
        ("provenance", "provenances"),
        ("claims too much", "reported energy"),
        ("writes", "wrote to its argument"),
        ("forgets the mean", "reported energy"),
        ("not repeatable", "differ"),
        ("accepts anything", "expected an InputError"),
    ],
)
def test_a_broken_basis_fails_its_law(fault: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_basis(Broken(fault=fault))
