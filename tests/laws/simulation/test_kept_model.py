"""Kept reduced models: equal results in memory, from a file and for other loads; refusals; files
that are damaged or name what no plugin declares."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from joint_runs import driven
from small_scenes import everything, tiny
from sparsemor import InputError, ReducedModel, load, load_model, reduce, simulate
from sparsemor.core import Findings, Note, PreparedRun
from sparsemor.core.results.model_file import MAGIC
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.checks import Checks
from sparsemor.plugins.kept_models.array_compression import compact, restored
from sparsemor.plugins.kept_models.serializer import Packed, PackedError

FLUX, LOW = "loads.heating.flux", 2.0e5


@cache
def scene() -> Scene:
    """The tiny scene with few atoms, trained with its own flux whatever the run has."""
    return tiny().using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}},
        "training.overrides": {FLUX: 1.0e6, "loads.gravity.factor": 1.0},
        "loads.gravity.factor": 1.0,
        "probes": {"end": {"body": "bar", "at": "end_b"}}})


OF_THE_MESH = ("atoms", "offset", "points", "cells", "places", "pose", "stress_constants",
               "stress_region", "stress_free_temperature", "eliminated_temperature")
"""Ends of the names of arrays that a file leaves out."""


@cache
def model() -> ReducedModel:
    return reduce(scene())


@pytest.mark.full
def test_a_run_alike_has_what_the_checks_found_in_the_first(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other ends, other stored steps and other loads are looked at on their own."""
    looked, own = list[int](), Checks.after_run

    def after_run(checks: Checks, run: PreparedRun, result: RunResult) -> Findings:
        looked.append(run.steps)
        found = own(checks, run, result)
        return replace(found, notes=(*found.notes, Note(f"{len(looked)}. look", "looked")))

    monkeypatch.setattr(Checks, "after_run", after_run)
    made, h = reduce(scene()), scene().time.step
    first, again = made.run(), made.run({"title": "again"})
    assert again.summary["notes"] == first.summary["notes"]
    assert first.summary["notes"][-1] == "1. look"
    for key in ("information", "time_error", "energy_lost", "heat_balance"):
        assert again.summary[key] == first.summary[key]
    for change in ({"time.end": 5 * h}, {"output.every": 2}, {FLUX: LOW}, {FLUX: LOW}):
        made.run(change)
    assert looked[1:] == [5, looked[0], looked[0], looked[0]]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    model().save(tmp_path / "bar.model")
    return tmp_path / "bar.model"


def assert_equal(one: RunResult, other: RunResult, leaving: tuple[str, ...] = ()) -> None:
    """Every array of `one`, computing times aside, has the same digits in `other`; estimates of
    errors, of which several are products of one matrix, nearly so."""
    a, b = one.to_xarray(), other.to_xarray()
    assert len(a) > 5
    for name in a:
        if str(name).startswith(ESTIMATE):
            assert np.allclose(a[name].values, b[name].values, rtol=1e-6, atol=0.0), name
        elif name != "step_seconds":
            assert np.array_equal(a[name].values, b[name].values), name
    assert all(name in a or str(name).endswith(leaving) for name in b if not (
        str(name).startswith(ESTIMATE) and NO_ESTIMATE in one.summary["information"]))


ESTIMATE = "error_estimate."
NO_ESTIMATE = ("the error of this run is not estimated: a model from a file is without the mesh "
               "that an estimate needs")


@pytest.mark.full
def test_a_run_is_that_of_simulate() -> None:
    assert model().run().error_estimates == ("bar.rigid", "bar.elastic", "bar.thermal")
    assert_equal(model().run(), simulate(scene(), estimate=True))
    shorter = model().run({"time.end": 0.02})
    assert_equal(model().run(), model().run())
    assert_equal(shorter, reduce(scene()).run({"time.end": 0.02}))


@pytest.mark.full
def test_a_model_from_a_file_runs_alike(file: Path) -> None:
    assert_equal(load_model(file).run(), model().run(), OF_THE_MESH)
    model().save(file, fields=True)
    assert_equal(load_model(file).run(), model().run())
    assert NO_ESTIMATE in load_model(file).run().summary["information"]
    assert not load_model(file).run().error_estimates


@pytest.mark.full
def test_other_loads_give_the_run_of_a_new_model(file: Path) -> None:
    for changes in ({FLUX: LOW}, {FLUX: {"use": "ramp", "end": 0.02, "final": 2e6}},
                    {"loads.gravity.factor": 0.25, "time.end": 0.05}):
        fresh = simulate(scene().using({**changes, "training.end": 0.04}), estimate=True)
        changed = model().run(changes)
        assert_equal(changed, fresh)
        assert_equal(load_model(file).run(changes), changed, OF_THE_MESH)
        old = model().run().block("bar.elastic", slice(31))
        assert not np.allclose(changed.block("bar.elastic", slice(31)), old, rtol=1e-3)
    assert_equal(model().run(), simulate(scene(), estimate=True))  # the model is as it was


@pytest.mark.full
@pytest.mark.parametrize(("scale", "near"), [(1.0, 1e-9), (1e9, 1e-2)])
def test_a_load_that_jumps_at_the_start_accelerates_as_in_a_new_model(
    scale: float, near: float, tmp_path: Path
) -> None:
    """The model's own load begins at 0. scale: of load and stiffness; where it is large, a step
    resolves no vibration, and no accelerations are those of an implicit Euler step, nearly."""
    pull, up = "loads.pull.factor", {"use": "ramp", "end": 0.01, "final": 1.0}
    beam = load(Path(__file__).parents[3] / "docs/examples/cantilever.yaml", {
        "time.end": 0.01, "bodies.beam.mesh.divisions": [8, 2], "bodies.beam.material.E":
        7.0e10 * scale, "training.overrides": {pull: 1.0}, pull: up, "loads.pull.force": [
            0.0, -1000.0 * scale]})
    model = reduce(beam)
    model.save(tmp_path / "beam.model")
    fresh = simulate(beam.using({pull: 1.0})).block("beam.elastic")
    for kept in (model, load_model(tmp_path / "beam.model")):
        run = kept.run({pull: 1.0})
        x = run.coefficients("beam.elastic") @ model.run().atoms("beam.elastic").T
        assert np.abs(x - fresh).max() <= near * np.abs(fresh).max()


@pytest.mark.full
def test_every_function_of_time_that_may_change_is_that_of_a_new_model(tmp_path: Path) -> None:
    """Every kind of load, with convection and radiation: all functions at once."""
    base = everything().using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 5}}})
    made, loads = reduce(base), base.dump()["loads"]
    keys = [k for k in made.free if k.startswith("loads.")]
    assert len(keys) >= 5
    old = {k: loads[k.split(".")[1]][k.split(".")[2]] for k in keys}
    ramps = {k: {"use": "ramp", "end": base.time.end, "initial": 0.5, "final": 300.0} for k in keys}
    fresh = simulate(base.using({**ramps, "training.overrides": old}))
    changed = made.run(ramps)
    made.save(tmp_path / "m")
    again = load_model(tmp_path / "m").run(ramps)
    for b in changed.layout:
        one, new = changed.block(b.name), fresh.block(b.name)
        assert np.allclose(one, new, rtol=1e-9, atol=1e-12 * np.abs(new).max()), b.name
    assert np.array_equal(again.probe(again.probes[0]), changed.probe(changed.probes[0]))


@pytest.mark.full
def test_torques_and_springs_are_kept(tmp_path: Path) -> None:
    made = reduce(load(driven({"use": "galerkin", "basis": {"use": "pod", "count": 5}})))
    made.save(tmp_path / "m")
    assert_equal(load_model(tmp_path / "m").run(), made.run(), OF_THE_MESH)


@pytest.mark.full
def test_another_start_gives_the_run_of_a_new_model() -> None:
    turned = {"bodies.bar.pose": {"angle": 0.2, "spin": 1.5}}
    fresh = simulate(scene().using(turned).using({
        "training.overrides": {FLUX: 1.0e6, "loads.gravity.factor": 1.0, "bodies.bar.pose": {}}}))
    run = model().run(initial={"bar.rigid": ([0.0, 0.0, 0.2], [0.0, 0.0, 1.5])})
    for name in ("bar.rigid", "bar.elastic", "bar.thermal"):
        assert np.allclose(run.block(name), fresh.block(name), rtol=1e-12, atol=1e-15)
    with pytest.raises(InputError, match=r"initial\.bar\.elastic: is no block .*bar\.rigid"):
        model().run(initial={"bar.elastic": ([0.0], [0.0])})
    with pytest.raises(InputError, match=r"initial\.bar\.rigid: give 3 finite values"):
        model().run(initial={"bar.rigid": ([0.0], [0.0])})


@pytest.mark.full
def test_another_start_fits_the_joints_or_is_refused() -> None:
    start = ([0.1, 0.0, 0.2], [0.0, 0.0, 1.5])
    with pytest.raises(InputError, match=r"initial\.bar\.rigid: the two sides of joint pin do not "
                                         r"meet at the start: 0\.1 \(m"):
        model().run(initial={"bar.rigid": start})
    moving = {"bar.rigid": ([0.0, 0.0, 0.2], [0.3, 0.0, 1.5])}
    broken = [n for n in model().run(initial=moving).summary["notes"] if "break joint pin" in n]
    assert len(broken) == 1
    assert "by 0.3 m/s" in broken[0]


@pytest.mark.full
def test_what_may_change() -> None:
    assert model().free == ("title", "output", "time.end", "loads.gravity.factor", FLUX)
    assert f"<td>title, output, time.end, loads.gravity.factor, {FLUX}</td>" in (
        model()._repr_html_())
    assert len(model().run({"output.every": 4, "time.end": 0.08}).times) == 21


@pytest.mark.parametrize(("change", "said"), [
    ({"bodies.bar.material.E": 1e9}, "bodies.bar.material.E: cannot change: the model was"),
    ({"loads.gravity.g": [0.0, -1.0]}, r"loads.gravity.g: cannot change: .*loads.gravity.factor"),
    ({"time.step": 5e-4}, "time.step: cannot change"),
    ({"seed": 4}, "seed: cannot change"),
    ({"reducer.basis.count": 5}, "reducer.basis.count: cannot change"),
    ({"time.end": 0.0405}, "time.end: .*is not a whole number of steps"),
    ({"time.end": 1e30}, "time.end: 1e.33 steps of 0.001 s"),
    ({"loads.heating.on": ["bar:left"]}, "loads.heating.on"),
])
def test_any_other_change_is_refused_by_its_key(change: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        model().run(change)
    assert len(caught.value.faults) == 1


@pytest.mark.full
def test_loads_that_a_rigid_stage_has_taken_do_not_change() -> None:
    staged = tiny().using({"rigid_stage": {}, "loads.gravity.factor": 1.0, "reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 3}}})
    made = reduce(staged)
    assert_equal(made.run(), simulate(staged, estimate=True))
    assert FLUX in made.free
    with pytest.raises(InputError, match=r"loads\.gravity\.factor\.level: .*pre-simulation"):
        made.run({"loads.gravity.factor": 2.0})
    with pytest.raises(InputError, match=r"time\.end: cannot be after 0\.04 s"):
        made.run({"time.end": 0.08})


@pytest.mark.full
def test_a_chosen_model_is_kept(tmp_path: Path) -> None:
    """The loads of a model that `auto` chose are those of its scene, not of a trial run's."""
    chosen = reduce(tiny().using({"reducer": "auto", "time.end": 0.01, "training.end": 0.01}))
    chosen.save(tmp_path / "bar.model")
    again = load_model(tmp_path / "bar.model")
    assert_equal(again.run({FLUX: LOW}), chosen.run({FLUX: LOW}), OF_THE_MESH)


def test_full_order_is_no_reduced_model() -> None:
    with pytest.raises(InputError, match="reducer: full reduces nothing"):
        reduce(everything().using({"reducer": "full"}))


@pytest.mark.full
def test_a_model_that_needs_the_mesh_runs_but_is_not_kept(tmp_path: Path) -> None:
    budgets = {"*.elastic": {"rows": 14, "atoms": 3}, "*.thermal": {"rows": 10, "atoms": 2}}
    selecting = reduce(tiny().using({"reducer": {"use": "sparse", "budgets": budgets}}))
    assert_equal(selecting.run(), simulate(selecting.scene, estimate=True))
    with pytest.raises(InputError, match=r"reducer: in this scene the steps of reducer sparse"):
        selecting.save(tmp_path / "no.model")
    with pytest.raises(InputError, match=r"loads\.heating\.flux\.level: .*need the mesh"):
        selecting.run({FLUX: LOW})
    assert not list(tmp_path.iterdir())


def test_a_damaged_or_foreign_file_is_one_error(file: Path, tmp_path: Path) -> None:
    data, other = file.read_bytes(), tmp_path / "other.model"
    for at in (len(MAGIC) + 3, len(MAGIC) + 70, len(data) // 2, len(data) - 1):
        other.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1:])
        with pytest.raises(InputError, match="digest does not match: the file is damaged"):
            load_model(other)
    for content, said in ((data[:-9], "damaged"), (b"", "no reduced model"),
                          (b"format: 1\n", "no reduced model"),
                          (data.replace(MAGIC, MAGIC[:-2] + b"9\n"), "another version")):
        other.write_bytes(content)
        with pytest.raises(InputError, match=said):
            load_model(other)
    with pytest.raises(InputError, match="cannot be read"):
        load_model(tmp_path / "none.model")


@pytest.mark.parametrize("node", [
    {"name": "os:system"}, {"parts": ["builtins:eval", ["1"]]}, {"fields": ["os:abc", {}]},
    {"method": [{"plugin": "loads.heating"}, "model_copy"]}, {"plugin": "loads.none"},
    {"method": [{"plugin": FLUX}, "__init__"]}, {"unknown": 1}, {"array": 10**6}, {"again": 0},
])
def test_a_file_with_a_true_digest_runs_no_code(
    file: Path, node: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = Packed.load(file.read_bytes())
    tree = json.loads(json.dumps(packed.tree))
    tree["map"] = [[k, node if k == "solver" else v] for k, v in tree["map"]]
    forged = Packed(tree, packed.arrays, packed.used, packed.about)
    file.write_bytes(forged.dump())
    with pytest.raises(InputError, match="is no reduced model that this program can use"):
        load_model(file)


def test_only_declared_classes_are_stored() -> None:
    for value in (object(), lambda t: t, np.array([object()]), {"a": Path()}):
        with pytest.raises((PackedError, ValueError, TypeError)):
            Packed.from_object(value, {}, {}).dump()


@pytest.mark.full
def test_a_file_needs_neither_folder_nor_cache(file: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    code = ("import sys; from sparsemor import load_model; r = load_model(sys.argv[1]).run(); "
            "print(r.probe('end')[-1].tolist())")
    said = subprocess.run(
        [sys.executable, "-c", code, str(file)], cwd=elsewhere, check=True, capture_output=True,
        text=True, env={**os.environ, "SPARSEMOR_CACHE": str(tmp_path / "cache")}).stdout
    assert json.loads(said) == model().run().probe("end")[-1].tolist()
    assert not list(elsewhere.iterdir())


def taker(data: list[bytes]) -> Callable[[int], bytearray]:
    stream = io.BytesIO(b"".join(data))
    return lambda size: bytearray(stream.read(size))


def test_matrices_times_a_stored_vector_are_stored_once() -> None:
    rng = np.random.default_rng(0)
    A, v, B = rng.random((2, 90, 90)), rng.random(90), rng.random((110, 100)) - 0.5
    arrays = [np.ascontiguousarray((A * v[:, None]).swapaxes(1, 2)), v, A, A * v[:, None], B]
    heads, data = compact(arrays)
    assert len(data) == 3
    for one, other in zip(restored(heads, taker(data)), arrays, strict=True):
        assert np.array_equal(one, other) and one.flags.c_contiguous
    with pytest.raises(ValueError, match="as a product of"):
        restored([*heads[:4], [*heads[4][:3], [1, 2, False]]], taker(data))
