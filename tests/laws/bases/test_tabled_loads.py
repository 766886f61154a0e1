"""Atoms for loads that cover many nodes: shapes that the tables have, in place of unit loads, and
responses to the tables."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from sparsemor import load
from sparsemor.core import Basis, BlockData
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.model import StepFactors
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.testing import check_basis
from sparsemor.core.testing.in_memory_run import march
from sparsemor.plugins.bases.attachment import Attachment
from sparsemor.plugins.bases.impulse import Impulse
from sparsemor.plugins.bases.load_patterns import tabled_loads
from sparsemor.plugins.bases.static import Static
from sparsemor.plugins.bases.union import Overcomplete

BRAKE = Path(__file__).parents[2] / "scenes" / "small_brake.yaml"
H = 1e-3


@pytest.mark.parametrize("basis", [
    Impulse(tabled=2), Impulse(tabled=3, substeps=2, count=4),
    Attachment(tabled=2, thermal=Impulse(tabled=2, count=4), count=5), Attachment(tabled=3),
    Impulse(superposed=True, count=4),
], ids=repr)
def test_laws_with_the_options(basis: Basis) -> None:
    check_basis(basis, seed=1, trials=3)


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> tuple[BlockData, BlockData, FloatArray,
                                                            FloatArray]:
    """Displacements and temperatures of the small disk, and their full run, (n, T) each."""
    scene = load(BRAKE, {"reducer": "full"})
    model, _ = prepared(scene, Cache(tmp_path_factory.mktemp("cache")), new_manager())
    run, step = march(scene, model=model), StepFactors(H, 1 / H, 1 / H**2, 1 / H)
    data = [model.block_data(f"disk.{field}", step=step) for field in ("elastic", "thermal")]
    return data[0], data[1], run.block("disk.elastic").T, run.block("disk.thermal").T


def left_out(atoms: FloatArray, states: FloatArray) -> float:
    """Largest part of a state that the atoms do not hold, of the largest state."""
    Q = np.linalg.qr(atoms)[0]
    rest = states - Q @ (Q.T @ states)
    return float(np.linalg.norm(rest, axis=0).max() / np.linalg.norm(states, axis=0).max())


@pytest.mark.full
@pytest.mark.parametrize("field", [0, 1])
def test_all_shapes_have_the_second_moment_of_the_table(disk, field: int) -> None:
    data = disk[field]
    (moving,) = data.moving
    G = np.asarray(moving.columns @ moving.table.values.T)
    F, names = tabled_loads(data, 1000)
    assert F.shape[1] == len(names) <= min(G.shape)
    want = G @ G.T / G.shape[1]
    assert np.abs(F @ F.T - want).max() < 1e-10 * np.abs(want).max()
    few, _ = tabled_loads(data, 3)
    np.testing.assert_allclose(few, F[:, :3], rtol=1e-12, atol=1e-14 * np.abs(F).max())


@pytest.mark.full
def test_shapes_need_fewer_atoms_than_places(disk) -> None:
    """The temperatures of a run that neither basis has seen, less the uniform start."""
    data, T = disk[1], disk[3] - disk[3][:, :1]
    shapes = left_out(Impulse(tabled=20, count=20).build(data).atoms, T)
    places = left_out(Impulse(count=20).build(data).atoms, T)
    assert shapes < 2e-2 and shapes < 0.5 * places, (shapes, places)


@pytest.mark.full
def test_superposed_responses_represent_the_run_with_few_atoms(disk) -> None:
    """The full-order run steps the same equations; its displacements have other loads, too."""
    T = disk[3] - disk[3][:, :1]
    every, few = (Impulse(superposed=True, count=k).build(disk[1]) for k in (None, 12))
    shapes = Impulse(tabled=20, count=12).build(disk[1])
    assert left_out(every.atoms, T) < 1e-6
    assert left_out(few.atoms, T) < 0.5 * left_out(shapes.atoms, T)
    own = Overcomplete(bases=[Static(), Impulse(superposed=True)], orthonormal=True)
    assert left_out(own.build(disk[0]).atoms, disk[2]) < 1e-3
    for data in (disk[0], disk[1]):
        still = tuple(replace(m, table=m.table.over(np.inf)) for m in data.moving)
        heat = None if data.heat is None else replace(data.heat, moving=())
        with pytest.raises(InputError, match="no load moves"):
            Impulse(superposed=True).build(replace(data, moving=still, heat=heat))


@pytest.mark.full
def test_longer_steps_between_delays_lose_little(disk) -> None:
    data, T = disk[1], disk[3] - disk[3][:, :1]
    exact, longer = (Impulse(tabled=20, count=30, substeps=s).build(data) for s in (None, 3))
    assert exact.info["delays"] == longer.info["delays"]
    assert left_out(longer.atoms, T) < 1.5 * left_out(exact.atoms, T) + 1e-4


@pytest.mark.parametrize(("basis", "given"), [
    (Impulse, {"positions": 3}), (Attachment, {"patches": 3})])
def test_places_or_shapes(basis, given) -> None:
    with pytest.raises((InputError, ValidationError), match="not both"):
        basis(tabled=3, **given)
