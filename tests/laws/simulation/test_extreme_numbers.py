"""Numbers far from physics end in a status or in an error that names its place, never in a
traceback."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reduced_runs import learnt
from sparsemor import SolveFailed, Status, load, simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import BlockData
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import march
from sparsemor.core.testing.random_inputs import TEMPERATURES, random_block
from sparsemor.plugins.bases.pod import Pod
from tiers import quick

SCENES = Path(__file__).parents[2] / "scenes"


def tiny(changes: dict[str, Any]) -> Scene:
    return load(SCENES / "tiny.yaml", {"time.end": 0.003, **changes})


def radiating(surroundings: float, changes: dict[str, Any]) -> Scene:
    radiation = {"use": "radiation", "on": ["bar:top"], "emissivity": 0.5,
                 "surroundings": surroundings}
    return tiny({"loads.hot": radiation, **changes})


@pytest.mark.parametrize("surroundings", quick((1e78, 1e166, 1e245), 1e78))
def test_surroundings_whose_fourth_power_overflows(here: Path, surroundings: float) -> None:
    with pytest.raises(SolveFailed) as found:
        simulate(radiating(surroundings, {}))
    assert found.value.status is Status.NOT_FINITE and found.value.block == "bar.thermal"


def test_a_body_that_begins_so_hot(here: Path) -> None:
    with pytest.raises(SolveFailed) as found:
        simulate(radiating(300.0, {"bodies.bar.initial_temperature": 1e166}))
    assert found.value.status is Status.NOT_FINITE and found.value.block == "bar.thermal"


@pytest.mark.parametrize("method", ["bordered", "newton"])
@pytest.mark.parametrize("flux", quick((1e120, 1e190), 1e190))
def test_radiation_of_a_body_heated_so_much(here: Path, flux: float, method: str) -> None:
    scene = radiating(300.0, {"loads.heating.flux": flux})
    with pytest.raises(SolveFailed) as found:
        simulate(scene.using({"reducer": {"use": "full", "method": method}}))
    assert found.value.status is Status.NOT_FINITE and found.value.block.startswith("bar.")


def test_a_training_run_heated_so_much(here: Path) -> None:
    with pytest.raises(SolveFailed, match="training") as found:
        simulate(radiating(300.0, {"loads.heating.flux": 1e190, "reducer": "galerkin"}))
    assert found.value.status is Status.NOT_FINITE


@pytest.mark.full
def test_a_stiffness_beside_which_mass_is_nothing(here: Path) -> None:
    scene = load(SCENES / "small_brake.yaml", {
        "time.end": 0.001, "reducer": "full", "bodies.disk.material.E": 1e235})
    with pytest.raises(SolveFailed) as found:
        simulate(scene)
    assert found.value.status is Status.SINGULAR and found.value.block == "disk.elastic"


@pytest.mark.parametrize("flux", quick((1e-287, 1e-170, 1e-100, 1e100, 1e160), 1e-287, 1e160))
def test_temperatures_of_any_size_have_the_same_modes(flux: float) -> None:
    """T and its heat are in proportion: the reduced run is that of a flux of 1, times the flux."""
    def run(size: float) -> tuple[list[FloatArray], FloatArray]:
        scene = tiny({"loads": {"heating": {"use": "heat_flux", "on": ["bar:right"],
                                            "flux": size}},
                      "bodies.bar.fields": ["thermal"], "bodies.bar.frame": "fixed",
                      "bodies.bar.reference": None, "joints": {},
                      "bodies.bar.reference_temperature": 0.0})
        reference = march(scene)
        reduced = scene.using({"reducer": {"use": "galerkin", "basis": "pod"}})
        end = march(reduced, model=reference.model, snapshots=learnt(reference))
        (d,) = end.solver.dictionaries.values()
        atoms = [d.atoms @ np.diag(1.0 / np.linalg.norm(d.atoms, axis=0))]
        return atoms, (d.offset + d.atoms @ end.x[-1]) / size

    (got,), T = run(flux)
    (want,), exact = run(1.0)
    np.testing.assert_allclose(T, exact, rtol=1e-8, atol=1e-8 * np.abs(exact).max())
    assert got.shape == want.shape


@pytest.mark.parametrize("exponent", [-950, -600, -301, 0, 301, 600, 950])
def test_atoms_do_not_depend_on_the_unit_of_snapshots(exponent: int) -> None:
    rng = np.random.default_rng(2)
    block: BlockData = random_block(rng, TEMPERATURES)
    A = rng.standard_normal((block.size, 9)) * 0.5 ** np.arange(9)
    for centred in (False, True):
        pod = Pod(count=5, centred=centred)
        want = pod.build(replace(block, snapshots=A))
        got = pod.build(replace(block, snapshots=np.ldexp(A, exponent)))
        np.testing.assert_array_equal(got.atoms, want.atoms)
        np.testing.assert_array_equal(got.offset, np.ldexp(want.offset, exponent))
