"""Bases side by side: nothing that one of them holds is lost, and every atom tells its origin."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from small_scenes import tiny
from sparsemor.core import Basis, BlockData, Dictionary
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.simulation.offline import Offline, largest_coefficient
from sparsemor.core.testing import check_basis
from sparsemor.core.testing.random_inputs import DISPLACEMENTS, random_block, random_dictionary
from sparsemor.plugins.bases.modal import Modal
from sparsemor.plugins.bases.pod import Pod
from sparsemor.plugins.bases.static import Static
from sparsemor.plugins.bases.union import Overcomplete


class Given(Basis):
    """A basis of given columns."""

    columns: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...] = ()
    name: str = "given"

    @property
    def needs_snapshots(self) -> bool:
        return False

    def build(self, data: BlockData) -> Dictionary:
        A = np.array(self.columns).T
        offset = np.array(self.offset) if self.offset else np.zeros(len(A))
        names = tuple(f"{self.name} {i}" for i in range(A.shape[1]))
        return Dictionary(A / np.linalg.norm(A, axis=0), offset, names)


def block(n: int = 4) -> BlockData:
    data = random_block(np.random.default_rng(0), DISPLACEMENTS)
    return replace(data, coordinates=np.zeros((n, 1)), mass=data.mass[:n, :n],
                   stiffness=data.stiffness[:n, :n], snapshots=data.snapshots[:n],
                   component=data.component[:n], loads=data.loads[:n])


def outside(x: FloatArray, d: Dictionary) -> float:
    """Part of x (n, j) that offset + atoms c misses, worst column."""
    x = x - d.offset[:, None]
    rest = x - d.atoms @ np.linalg.lstsq(d.atoms, x, rcond=None)[0]
    return float((np.linalg.norm(rest, axis=0) / np.linalg.norm(x, axis=0)).max())


@pytest.mark.parametrize("basis", [
    Overcomplete(bases=[Pod(centred=True), Modal(count=3)]),
    Overcomplete(bases=[Pod(), Modal(), Static(rates=(0.0, 5.0))], orthonormal=True),
    Overcomplete(bases=[Overcomplete(), Pod(complete=True)]), Overcomplete(tolerance=0.3)],
    ids=["centred+modal", "orthonormal", "nested", "coarse"])
def test_laws_with_every_option(basis: Overcomplete) -> None:
    check_basis(basis, seed=2, trials=3)


@pytest.mark.parametrize("orthonormal", [False, True])
@pytest.mark.parametrize("centred", [False, True])
def test_what_each_basis_holds_the_dictionary_holds(centred: bool, orthonormal: bool) -> None:
    rng = np.random.default_rng(3)
    data = random_block(rng, DISPLACEMENTS)
    bases = [Pod(count=4, centred=centred), Modal(count=5), Static()]
    whole = Overcomplete(bases=bases, orthonormal=orthonormal).build(data)
    for basis in bases:
        own = basis.build(data)
        x = own.offset[:, None] + own.atoms @ rng.standard_normal((own.atoms.shape[1], 3))
        assert outside(x, whole) < 1e-10
    if orthonormal:
        assert np.abs(whole.atoms.T @ whole.atoms - np.eye(whole.atoms.shape[1])).max() < 1e-12


def test_near_duplicates_are_merged_and_named() -> None:
    first = Given(columns=((1, 0, 0, 0), (0, 1, 0, 0)), name="pod")
    twin = Given(columns=((-1, 0, 0, 0), (0, 1, 1e-5, 0), (0, 0, 0, 1)), name="mode")
    merged = Overcomplete(bases=[first, twin], tolerance=1e-4).build(block())
    assert merged.provenance == ("pod 0 (also mode 0)", "pod 1 (also mode 1)", "mode 2")
    assert merged.info["merged"] == 2 and merged.info["atoms"] == 3
    kept = Overcomplete(bases=[first, twin], tolerance=1e-6).build(block())
    assert kept.provenance == ("pod 0 (also mode 0)", "pod 1", "mode 1", "mode 2")
    # 1 - cosine is 5e-11: from cosines alone it would be lost in a few digits
    assert float(kept.info["coherence"]) == pytest.approx(1.0 - 5e-11, abs=1e-15)


def test_rank_and_coherence_are_reported() -> None:
    skew = Given(columns=((1, 0, 0, 0), (0, 1, 0, 0), (1, 1, 0, 0)))
    built = Overcomplete(bases=[skew]).build(block())
    assert (built.info["numerical_rank"], built.info["atoms"]) == (2, 3)
    assert built.info["coherence"] == pytest.approx(np.sqrt(0.5), rel=1e-14)
    clean = Overcomplete(bases=[skew], orthonormal=True).build(block())
    assert clean.provenance == ("given 0", "given 1") and clean.info["dependent"] == 1


def test_offsets_stay_or_become_atoms() -> None:
    a = Given(columns=((1, 0, 0, 0),), offset=(0, 0, 2, 0), name="pod")
    b = Given(columns=((0, 1, 0, 0),), offset=(0, 0, 2, 0), name="mode")
    c = Given(columns=((0, 1, 0, 0),), name="mode")
    d = Given(columns=((0, 1, 0, 0),), offset=(0, 0, 0, -3), name="mode")
    shared = Overcomplete(bases=[a, b]).build(block())
    assert shared.offset.tolist() == [0, 0, 2, 0] and shared.atoms.shape[1] == 2
    mixed = Overcomplete(bases=[a, c]).build(block())
    assert not mixed.offset.any()
    assert mixed.provenance == ("pod 0", "mode 0", "pod offset")
    assert mixed.atoms[:, 2].tolist() == [0, 0, 1, 0]
    two = Overcomplete(bases=[a, d]).build(block())
    assert two.provenance[2:] == ("pod offset", "mode offset") and not two.offset.any()


def test_no_basis_and_odd_tolerances_are_refused() -> None:
    for options in ({"bases": []}, {"tolerance": -1.0}, {"tolerance": 1.0}, {"bases": ["nothing"]}):
        with pytest.raises(ValidationError):
            Overcomplete.model_validate(options)


def test_snapshots_are_needed_when_one_basis_needs_them() -> None:
    assert Overcomplete().needs_snapshots
    assert not Overcomplete(bases=[Modal(), Static()]).needs_snapshots


def test_largest_coefficient_of_coherent_atoms_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    skew = random_dictionary(30, 5, rng)
    c = rng.standard_normal((5, 40))
    assert largest_coefficient(skew, skew.atoms @ c) == pytest.approx(np.abs(c).max(), rel=1e-10)
    twice = Dictionary(np.hstack([skew.atoms, skew.atoms]), np.ones(30), ("",) * 10)
    # least norm: both copies take half
    found = largest_coefficient(twice, 1.0 + skew.atoms @ c)
    assert found == pytest.approx(0.5 * np.abs(c).max(), rel=1e-10)
    Q = replace(skew, atoms=np.linalg.qr(skew.atoms)[0])
    S = rng.standard_normal((30, 6))
    assert largest_coefficient(Q, S) == pytest.approx(np.abs(Q.atoms.T @ S).max(), rel=1e-14)
    assert largest_coefficient(skew, np.zeros((30, 0))) == 0.0


def test_limits_exist_only_where_there_are_snapshots() -> None:
    model = assemble(tiny())
    snapshots = {n: np.outer(np.arange(1.0, 1 + model.block_data(n).size), [1.0, 2.0])
                 for n in model.reducible()}
    offline = Offline.from_snapshots(model, snapshots)
    assert offline.dictionary("bar.elastic", Modal(count=2))[1] == 0.0
    top = offline.dictionary("bar.elastic", Pod())[1]
    assert top == pytest.approx(np.linalg.norm(snapshots["bar.elastic"][:, 1]), rel=1e-12)
