"""A small block on a plate in two stages: every reducer under loads that move over the mesh."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.status import SolveFailed

pytestmark = pytest.mark.full

SLIDER = Path(__file__).parents[2] / "scenes" / "small_slider.yaml"
POD = {"use": "pod", "count": 25}
ROWS: dict[str, Any] = {"rows": 18, "atoms": 25}
SPARSE: dict[str, Any] = {"use": "sparse", "basis": POD, "sampler": "deim", "budgets": {"*": ROWS}}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def full(cache: Cache) -> RunResult:
    return simulate(load(SLIDER, {"reducer": "full"}), cache=cache)


def errors(run: RunResult, reference: RunResult) -> dict[str, float]:
    """Largest error of each block, relative to its own largest value."""
    return {b.name: float(np.abs(run.block(b.name) - reference.block(b.name)).max()
                          / np.abs(reference.block(b.name)).max()) for b in reference.layout}


@pytest.mark.parametrize(("reducer", "allowed"), [
    ({"use": "full", "method": "newton"}, 1e-11),
    ({"use": "galerkin", "basis": POD}, 1e-8),
    ({"use": "deim", "basis": POD}, 1e-8),
    ({"use": "gnat", "basis": POD}, 1e-7),
    ({"use": "ecsw", "constant": "weighted", "basis": POD}, 1e-4),
    (SPARSE, 1e-7),
    (SPARSE | {"sampler": "random", "resample": 10}, 1e-6),
    (SPARSE | {"budgets": {"*": {"rows": 18, "atoms": 15}}}, 1e-4),
    (SPARSE | {"budgets": {"*": {"rows": 18, "atoms": 15}}, "selection": "joint"}, 1e-4),
], ids=["newton", "galerkin", "deim", "gnat", "ecsw", "sparse", "resampled", "selecting", "joint"])
def test_each_reducer_repeats_the_full_run_under_moving_loads(full, cache, reducer, allowed):
    run = simulate(load(SLIDER, {"reducer": reducer}), cache=cache)
    assert run.summary["cache"]["rigid_stage"] == "hit"
    assert set(run.summary["note_kinds"]) <= {"stiff_in_bending"}
    found = errors(run, full)
    assert max(found.values()) < allowed, found


def test_the_contact_carries_the_load_and_heats_both_bodies(full):
    stage = full.stage()
    assert stage is not None
    contact, late = stage.contacts["sole"], slice(20, None)
    weight = 2700 * 9.81 * 1.25e-3**3
    assert abs(contact["normal"][late].mean() / (1e7 * 1.25e-3**2 + weight) - 1) < 2e-3
    assert full.nodal_temperature("slider", -1).max() > 0.5
    assert full.nodal_temperature("plate", -1).max() > 0.5
    # what was rubbed is what both bodies hold, the sun's share aside: BDF1 sums heat at step ends
    dark = {"loads.sun.flux": 0.0, "reducer": "full"}
    run, h = simulate(load(SLIDER, dark)), 7.5e-6
    models, _ = prepared(load(SLIDER, dark), Cache(), new_manager())
    held = sum(float(b.capacity.sum(axis=0) @ run.block(b.thermal)[-1])
               for b in models.separated.heat)
    stage = run.stage()
    assert stage is not None
    rubbed = h * float(stage.contacts["sole"]["power"][1:].sum())
    assert abs(held / rubbed - 1) < 1e-6


def test_both_stages_have_their_own_error_controlled_steps(cache):
    """Where the stage cannot hold the tolerance, the advice that the failure gives is enough."""
    short = load(SLIDER, {"time.end": 3.0e-5, "training.end": 3.0e-5})
    run = simulate(short.using({"time.control": {"tolerance": 0.1}, "reducer": "full"}),
                   cache=cache)
    assert run.summary["control"]["substeps"] >= 8
    fine = {"tolerance": 0.01, "max_halvings": 2, "rigid": 1e-6, "elastic": 1e-6}
    tight = short.using({"time.control": fine, "reducer": "full"})
    with pytest.raises(SolveFailed, match="rigid_stage: {overrides: {time.control: null}}") as told:
        simulate(tight, cache=cache)
    assert told.value.detail.startswith("rigid stage") and "time.control.rigid" in str(told.value)
    kept = simulate(tight.using({
        "rigid_stage.overrides": {"time.control": None}, "time.control.elastic": 1e-4}),
        cache=cache)
    assert kept.summary["control"]["largest_error"] <= 1.0


@pytest.mark.parametrize(("slider", "plate"), [
    (["elastic"], ["elastic", "thermal"]), ([], ["elastic", "thermal"])])
def test_each_field_alone_takes_its_part_of_the_contact(full, cache, slider, plate):
    changes: dict[str, Any] = {
        "bodies.slider.fields": slider, "bodies.plate.fields": plate, "reducer": "full"}
    on = [f"{b}:right" for b, fields in (("plate", plate), ("slider", slider))
          if "thermal" in fields]
    run = simulate(load(SLIDER, changes | {"loads.sun.on": on}), cache=cache)
    assert {b.name for b in run.layout} == {
        f"{b}.{f}" for b, fields in (("slider", slider), ("plate", plate)) for f in fields}
    for b in run.layout:
        if b.field == "thermal":  # heat does not ask what else a body carries
            assert errors_of(b.name, run, full) < 1e-12
        elif len({"slider": slider, "plate": plate}[b.owner]) == 2:
            assert errors_of(b.name, run, full) < 1e-12


def errors_of(name: str, run: RunResult, reference: RunResult) -> float:
    own = np.abs(reference.block(name)).max()
    return float(np.abs(run.block(name) - reference.block(name)).max() / own)


def test_conduction_between_the_surfaces_is_solved_for_along_the_given_motion(full, cache):
    """It cannot be tabled, as it asks for temperatures: both ways to solve a step agree, and heat
    goes from the warmer body to the other without loss."""
    film = {"contacts.sole.heat.conductance": 1e5}
    run = simulate(load(SLIDER, film | {"reducer": "full"}), cache=cache)
    newton = simulate(
        load(SLIDER, film | {"reducer": {"use": "full", "method": "newton"}}), cache=cache)
    assert max(errors(newton, run).values()) < 1e-10
    assert errors_of("slider.thermal", run, full) > 1e-3
    model, _ = prepared(load(SLIDER, film | {"reducer": "full"}), cache, new_manager())
    held = [sum(float(b.capacity.sum(axis=0) @ r.block(b.thermal)[-1])
                for b in model.separated.heat) for r in (run, full)]
    assert abs(held[0] / held[1] - 1) < 1e-9
