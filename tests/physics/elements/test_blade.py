"""Twisted blade that spins at twice its first frequency: modes against CalculiX, and reduced steps
against full order (tests/benchmarks/blade.py, which has the large blade)."""

import sys
from pathlib import Path

import numpy as np
import pytest

import calculix
from sparsemor import simulate
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.simulation.cache import Cache

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import blade

SPIN = 608.0
CALCULIX = [116.680, 224.963, 344.528, 656.378]
"""Frequencies, Hz, by CalculiX 2.20 on 192 tetrahedra."""

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file: Path = tmp_path_factory.mktemp("blade") / "mesh.inp"
    assert blade.write_mesh(file, blade.SMALL) == 192
    return file


def test_it_spins_at_twice_its_first_frequency(mesh: Path) -> None:
    assert blade.first_spin(mesh) == SPIN


# prestressed: the stress is that of the undeformed blade, and twisted sections untwist
@pytest.mark.parametrize("strains, within", [("prestressed", 0.005), ("nonlinear", 0.002)])
def test_modes(mesh: Path, strains: str, within: float) -> None:
    np.testing.assert_allclose(blade.modes(mesh, strains, SPIN), CALCULIX, rtol=within)


def test_linear_strains_miss_the_stiffness_by_spin(mesh: Path) -> None:
    assert blade.modes(mesh, "linear", SPIN)[0] < 0.5 * CALCULIX[0]


@pytest.mark.skipif(not calculix.PRESENT, reason="CalculiX (ccx) is not installed")
def test_the_stored_numbers_are_those_of_calculix() -> None:
    np.testing.assert_allclose(blade.by_calculix(blade.SMALL, SPIN), CALCULIX, rtol=1e-5)


@pytest.mark.parametrize("strains", ["prestressed", "nonlinear"])
def test_reduced_steps(mesh: Path, strains: str, tmp_path: Path) -> None:
    scene = blade.blade(mesh, strains, SPIN).using({"time.end": 0.002})
    cache, bodies = Cache(tmp_path), BodyCache()
    want = simulate(scene, cache=cache, body_cache=bodies, keep_training=True).probe("tip")
    for name in ("galerkin", "ecsw"):
        reducer = {"use": name, "basis": {"use": "pod", "count": 8}}
        found = simulate(scene.using({"reducer": reducer}), cache=cache, body_cache=bodies)
        assert np.abs(found.probe("tip") - want).max() < 1e-3 * np.ptp(want, axis=0).max()
