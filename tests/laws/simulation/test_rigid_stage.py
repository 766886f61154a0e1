"""Frames that are given, and the stage that gives them: its cache, its failures, its results."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import InputError, SolveFailed, Status, load, open_result, simulate
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.prescribed_quantities import Followed
from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.rigid_stage import rigid_scene
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.testing.in_memory_run import march
from tests.laws.simulation.test_rigid_stage_in_space import stage_of

SCENES = Path(__file__).parents[2] / "scenes"
SLIDER, EVERYTHING = SCENES / "small_slider.yaml", SCENES / "everything.yaml"
SHORT: dict[str, Any] = {"time.end": 7.5e-5, "training.end": 7.5e-5, "reducer": "full"}


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf1", "generalized_alpha"])
def test_a_run_that_follows_its_own_motion_is_the_same_run(integrator):
    """Every joint (moments too), every load."""
    scene = load(EVERYTHING, {"time": {"end": 0.01, "step": 1e-3}, "integrator": integrator,
                              "reducer": "full"})
    free = march(scene)
    given = march(scene, model=assemble(scene, Followed(stage_of(free))))
    fields = {b.field for b in given.model.layout}
    assert fields == {"elastic", "thermal"}  # neither rigid unknowns nor multipliers
    for b in given.model.layout:
        x, y = free.block(b.name), given.block(b.name)
        assert np.abs(x - y).max() < 1e-10 * np.abs(x - x[0]).max(), b.name
    rates = given.v[-1][given.model.layout["plate.elastic"]]
    np.testing.assert_allclose(rates, free.v[-1][free.model.layout["plate.elastic"]],
                               rtol=1e-6, atol=1e-9 * np.abs(rates).max())


def test_the_rigid_scene_has_no_heat_and_forgets_what_motion_does_not_depend_on():
    scene = load(SLIDER)
    rigid = rigid_scene(scene)
    assert set(rigid.loads) == {"press", "held", "weight"}
    assert all(b.fields == [] for b in rigid.bodies.values())
    assert rigid.rigid_stage is None and rigid.probes == {}
    same = scene.using({"seed": 9, "output.every": 5, "probes": {}, "training.every": 2,
                        "loads.sun.flux": 5.0, "reducer": "galerkin"})
    assert rigid_scene(same).digest() == rigid.digest()
    assert rigid_scene(scene.using({"loads.press.pressure": 5.0})).digest() != rigid.digest()
    changed = scene.using({"rigid_stage.overrides": {"contacts.sole.friction.coefficient": 0.1}})
    assert rigid_scene(changed).contacts["sole"].friction.coefficient == 0.1
    assert changed.contacts["sole"].friction.coefficient == 0.2


class Phases:
    def __init__(self):
        self.seen = []

    @hookimpl
    def on_start(self, run):
        self.seen.append(run.phase)


@pytest.mark.full
def test_one_stage_serves_training_and_runs_and_is_part_of_the_offline_cost(tmp_path):
    cache, pod = Cache(tmp_path), {"use": "galerkin", "basis": {"use": "pod", "count": 6}}
    first, again, other = Phases(), Phases(), Phases()
    run = simulate(load(SLIDER, SHORT | {"reducer": pod}), cache=cache, observers=[first])
    assert first.seen == ["rigid stage", "training", "run"]
    again_run = simulate(load(SLIDER, SHORT | {"reducer": pod, "seed": 4}), cache=cache,
                         observers=[again])
    assert again.seen == ["run"]
    assert again_run.summary["cache"]["rigid_stage"] == "hit"
    # as if nothing had been in the cache: stage and training count for the second run as well
    cost = again_run.summary["offline_whole_s"]
    assert cost > 0.9 * run.summary["offline_s"]["rigid_stage"]
    trained = {"training.overrides": {"loads.press.pressure": 8e6}}
    simulate(load(SLIDER, SHORT | trained | {"reducer": pod}), cache=cache, observers=[other])
    assert other.seen == ["rigid stage", "training", "run"]  # the training's own, the run's is kept


@pytest.mark.full
def test_a_result_tells_the_stage_and_where_bodies_are(tmp_path):
    result = simulate(load(SLIDER, SHORT), out=tmp_path / "a", cache=Cache(tmp_path / "c"))
    stage = result.stage()
    assert stage is not None and len(stage.times) == 11
    np.testing.assert_array_equal(stage.times, result.times)
    assert stage.moves == {"slider"} and set(stage.frames) == {"slider", "plate"}
    assert stage.reactions["drive"].shape == (11, 1)
    contact = stage.contacts["sole"]
    assert set(contact) == {"normal", "friction", "power", "length", "pressure"}
    np.testing.assert_allclose(contact["friction"][-5:], 0.2 * contact["normal"][-5:], rtol=1e-6)
    pose = stage.frames["slider"].pose[-1]
    np.testing.assert_array_equal(result.pose("slider", -1), pose)
    assert abs(pose[0] - 7.5e-5) < 1e-6
    u = result.nodal_displacement("slider", -1)
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    placed = pose[:2] + (result.points("slider") + u) @ turn.T
    np.testing.assert_allclose(result.positions("slider", -1), placed, rtol=0, atol=1e-15)
    corner = np.argmin(np.abs(result.points("slider") - [1.25e-3, 1.25e-3]).sum(axis=1))
    np.testing.assert_allclose(result.probe("front")[-1, :2], placed[corner], atol=1e-15)
    assert open_result(tmp_path / "a").stage().contacts["sole"]["normal"][-1] > 0
    one_stage = simulate(load(SCENES / "tiny.yaml", {"time.end": 2e-3}), out=tmp_path / "b")
    assert one_stage.stage() is None


@pytest.mark.full
def test_a_stage_that_fails_says_so(tmp_path):
    scene = load(SLIDER, SHORT | {"rigid_stage.overrides": {
        "reducer": {"use": "full", "method": "newton", "max_iterations": 1}}})
    with pytest.raises(SolveFailed) as failed:
        simulate(scene, cache=Cache(tmp_path))
    assert failed.value.detail.startswith("rigid stage")
    assert failed.value.status is Status.NOT_CONVERGED


@pytest.mark.full
def test_an_interrupted_run_goes_on_to_the_same_numbers(tmp_path):
    class Stop:
        @hookimpl
        def on_step(self, step):
            if step == 6:
                signal.raise_signal(signal.SIGINT)

    scene, cache = load(SLIDER, SHORT), Cache(tmp_path / "c")
    whole = simulate(scene, cache=cache)
    with pytest.raises(SolveFailed) as stopped:
        simulate(scene, out=tmp_path / "a", cache=cache, observers=[Stop()])
    assert stopped.value.status is Status.INTERRUPTED
    assert len(open_result(tmp_path / "a").times) == 7
    done = simulate(scene, out=tmp_path / "a", cache=cache, resume=True)
    for b in whole.layout:
        np.testing.assert_array_equal(whole.block(b.name), done.block(b.name))
    np.testing.assert_array_equal(whole.probe("front"), done.probe("front"))


@pytest.mark.parametrize(("changes", "key", "words"), [
    ({"contacts.sole.surfaces": "deformed"}, "contacts.sole.surfaces", "knows no deformed"),
    ({"rigid_stage": None}, "contacts.sole.surfaces", "slider: contact of rigid"),
    ({"rigid_stage.overrides": {"time.end": 1.5e-4}}, "rigid_stage.overrides", "before the run"),
    ({"rigid_stage.overrides": {"contacts.sole.normal.stiffness": -1}},
     "contacts.sole.normal.stiffness", "greater than 0"),
    ({"bodies.slider.pose.position": [0, -1e-4]}, "contacts.sole.between", "overlap"),
])
def test_what_two_stages_refuse(changes, key, words):
    with pytest.raises(InputError) as error:
        checked_model(load(SLIDER, changes))
    faults = {f.key: f.message for f in error.value.faults}
    assert any(k.startswith(key) and words in m for k, m in faults.items()), faults


@pytest.mark.full
def test_a_joint_of_bodies_that_do_not_move_stays_a_constraint(tmp_path):
    """A rigid stage cannot know its force; the flexible stage solves for it."""
    scene = load(SLIDER, SHORT)
    bolt = {"use": "revolute", "between": ["ground", "plate:right"]}
    pinned = scene.using({"joints": {**scene.source.tree["joints"], "bolt": bolt}})
    run = simulate(pinned, cache=Cache(tmp_path))
    assert set(run.stage().reactions) == {"drive"}
    assert "bolt.multiplier" in run.layout and "drive.multiplier" not in run.layout
    free = simulate(scene, cache=Cache(tmp_path))

    def drift(result):
        """Mean displacement of the edge by length, which the joint holds."""
        points = result.points("plate")
        edge = np.flatnonzero(np.isclose(points[:, 0], 2e-3))
        edge = edge[np.argsort(points[edge, 1])]
        u = result.nodal_displacement("plate", -1)[edge]
        return np.abs(np.trapezoid(u, points[edge, 1], axis=0) / np.ptp(points[edge, 1])).max()

    assert drift(free) > 1e-10
    assert drift(run) < 1e-6 * drift(free)
