"""A pad on a small spinning disk in two stages: every reducer under loads that move around it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared

BRAKE = Path(__file__).parents[2] / "scenes" / "small_brake.yaml"
POD = {"use": "pod", "count": 25}
SPARSE: dict[str, Any] = {
    "use": "sparse", "basis": POD, "sampler": {"use": "deim", "required": False},
    "budgets": {"*": {"rows": 32, "atoms": 25}}}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def full(cache: Cache) -> RunResult:
    return simulate(load(BRAKE, {"reducer": "full"}), cache=cache)


def errors(run: RunResult, reference: RunResult) -> dict[str, float]:
    """Largest error of each block, relative to its own largest value."""
    return {b.name: float(np.abs(run.block(b.name) - reference.block(b.name)).max()
                          / np.abs(reference.block(b.name)).max()) for b in reference.layout}


@pytest.mark.full
@pytest.mark.parametrize(("reducer", "allowed"), [
    ({"use": "full", "method": "newton"}, 1e-11),
    ({"use": "deim", "basis": POD}, 1e-4),
    ({"use": "ecsw", "constant": "weighted", "basis": POD}, 1e-4),
    (SPARSE, 1e-3),
    (SPARSE | {"budgets": {"*": {"rows": 32, "atoms": 20}}}, 1e-2),
], ids=["newton", "deim", "ecsw", "sparse", "selecting"])
def test_each_reducer_repeats_the_full_run(full, cache, reducer, allowed):
    run = simulate(load(BRAKE, {"reducer": reducer}), cache=cache)
    assert run.summary["cache"]["rigid_stage"] == "hit"
    assert {b.field for b in run.layout} == {"elastic", "thermal"}
    found = errors(run, full)
    assert max(found.values()) < allowed, found


@pytest.mark.full
def test_nothing_is_left_to_the_general_path(cache):
    model, _ = prepared(load(BRAKE), cache, new_manager())
    assert model.separated.other == () and model.separated.border_size == 0
    moving = {m.name: m for m in model.separated.moving}
    assert {n: m.frame.rigid_size for n, m in moving.items()} == {"disk": 4, "pad": 7}
    for m in moving.values():
        assert m.guide is not None and m.operators is not None and len(m.operators.tables) == 1


@pytest.mark.full
def test_the_elastic_disk_is_loaded_with_the_resultants_of_the_contact(full, cache):
    """Nodal forces in body axes, turned into space, add up to pressure and friction."""
    stage = full.stage()
    held = {"hold": {"seat": "xyz", "centre": "xy", "probe_1": "y"}}  # nothing under the pad
    model, _ = prepared(load(BRAKE, {"bodies.disk.reference": held, "reducer": "full"}), cache,
                        new_manager())
    disk = next(m for m in model.separated.moving if m.name == "disk")
    component = model.geometry["disk.elastic"][1]
    for k in (1, 17, 30):
        load_now = disk.operators.tables[0].at(float(stage.times[k]))
        force = np.array([load_now[component == i].sum() for i in range(3)])
        assert force[2] == pytest.approx(-stage.contacts["brake"]["normal"][k], rel=1e-6)
        turn = stage.frames["disk"].pose[k, 3]
        assert np.hypot(*force[:2]) == pytest.approx(stage.contacts["brake"]["friction"][k],
                                                     rel=0.2)
        across = np.array([np.cos(turn) * force[0] - np.sin(turn) * force[1],
                           np.sin(turn) * force[0] + np.cos(turn) * force[1]])
        assert across[0] > 0 and abs(across[1]) < 0.2 * across[0]
