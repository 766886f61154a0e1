"""Exported FMUs: valid, equal to the stepper of their model in another program, with states that
are restored, and what is refused. They are compiled, which takes a minute each."""

import json
import shutil
import subprocess
import zipfile
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from small_scenes import everything
from sparsemor import InputError, ReducedModel, Scene, load, load_model, reduce, simulate
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.plugins.export.fmu import ExportedModel, export_c, export_fmu
from sparsemor.plugins.kept_models.co_simulation import ModelStepper

GALERKIN = {"use": "galerkin", "basis": {"use": "pod", "count": 5}}
EXAMPLES = Path(__file__).parents[2] / "docs/examples"
compiled = pytest.mark.skipif(
    shutil.which("cc") is None, reason="no C compiler, which an FMU needs")


@cache
def made(name: str) -> tuple[ReducedModel, ExportedModel]:
    folder = Path(mkdtemp(prefix="sparsemor-fmu-"))
    scene = everything() if name == "everything" else load(EXAMPLES / f"{name}.yaml")
    model = reduce(scene.using({"reducer": GALERKIN, "time.end": 40 * scene.time.step}))
    model.save(folder / "model")
    return model, export_fmu(load_model(folder / "model"), folder / f"{name}.fmu")


def driven(slave: Any, step: int, model: ReducedModel, stepper: ModelStepper) -> None:
    """One step of both, with inputs that differ from the scene's."""
    h = stepper.step_size
    own = dict(functions_of_time({"loads": model.scene.loads, "joints": model.scene.joints}))
    values = [1.3 * own[k].value((step + 1) * h) for k in stepper.inputs]
    for key, value in zip(stepper.inputs, values, strict=True):
        stepper.set(key, value)
    if values:
        slave.setReal(list(range(len(values))), values)
    slave.doStep(step * h, h)
    stepper.step()


def outputs(slave: Any, unit: ExportedModel) -> list[float]:
    first = len(unit.inputs)
    return list(slave.getReal(list(range(first, first + len(unit.outputs)))))


def slave_of(unit: ExportedModel) -> SimpleNamespace:
    """A slave of the unit, loaded by FMPy."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.fmi2 import FMU2Slave

    about = fmpy.read_model_description(str(unit.file))
    slave = FMU2Slave(guid=about.guid, unzipDirectory=fmpy.extract(str(unit.file)),
                      modelIdentifier=about.coSimulation.modelIdentifier, instanceName="one")
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    return slave


@compiled
@pytest.mark.slow
def test_a_model_in_c_takes_the_steps_of_its_model(tmp_path: Path) -> None:
    """Built without warnings; with the first values of the inputs."""
    model, _ = made("slider_crank")
    done = export_c(model, tmp_path / "c", outputs=["middle.x", "crank.rigid.angle", "hub.force_x"])
    subprocess.run(
        ["cc", "-O2", "-std=c11", "-Wall", "-Wextra", "-Werror", "-Wno-type-limits", "example.c",
         "model.c", "steps.o", "-lm", "-o", "example"], cwd=done.file, check=True)
    printed = subprocess.run([done.file / "example", "20"], capture_output=True, text=True,
                             check=True).stdout.splitlines()
    assert printed[0] == ",".join(("time", *done.outputs))
    stepper = model.stepper(done.inputs, done.outputs)
    wanted = [stepper.values()]
    for _ in range(20):
        stepper.step()
        wanted.append(stepper.values())
    got = np.array([[float(v) for v in line.split(",")[1:]] for line in printed[1:]])
    size = np.abs(wanted).max(axis=0)
    np.testing.assert_allclose(got / size, wanted / size, rtol=0, atol=1e-9)
    with pytest.raises(InputError, match="must be a new folder"):
        export_c(model, done.file)


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider_crank", "everything", "radiating_plate"])
def test_a_unit_takes_the_steps_of_its_model(name: str) -> None:
    validation = pytest.importorskip("fmpy.validation")
    model, unit = made(name)
    assert validation.validate_fmu(str(unit.file)) == []
    assert unit.file.stat().st_size < 2e6
    stepper, slave = model.stepper(unit.inputs, unit.outputs), slave_of(unit)
    largest = np.zeros(len(unit.outputs))
    for step in range(20):
        driven(slave, step, model, stepper)
        largest = np.maximum(largest, np.abs(stepper.values()))
    for got, want, size, output in zip(
            outputs(slave, unit), stepper.values(), largest, unit.outputs, strict=True):
        if output == "shake.moment":  # nothing determines it: zero but for rounding of 18 N m
            assert max(abs(got), abs(want)) <= 1e-5
            continue
        assert abs(got - want) <= 1e-9 * max(size, 1e-6), output


def hinged(names: str, spring: bool, step: float) -> dict[str, Any]:
    """Flexible bars hinged at heights 0 and 0.3 m, whose ends are pulled along x and y, or joined
    by a spring."""
    bodies, joints, loads, probes = dict[str, Any](), dict[str, Any](), dict[str, Any](), {}
    for name in names:
        y = 0.0 if name == "a" else 0.3
        bodies[name] = {
            "use": "flexible", "thickness": 0.01, "fields": ["elastic"],
            "mesh": {"use": "rectangle", "lower": [0.0, y - 0.01], "size": [0.4, 0.02],
                     "divisions": [8, 2]},
            "sets": {"pin": {"nearest": [0.0, y]}, "end": {"nearest": [0.4, y]}},
            "material": {"E": 7.0e10, "nu": 0.33, "rho": 2700},
            "reference": {"chord": ["pin", "end"]}}
        joints[f"hinge_{name}"] = {"use": "revolute", "between": ["ground", f"{name}:pin"]}
        probes[f"end_{name}"] = {"body": name, "at": "end"}
        for axis, force in (("x", [1.0, 0.0]), ("y", [0.0, 1.0])) if not spring else ():
            loads[f"{axis}_{name}"] = {
                "use": "point_force", "on": f"{name}:end", "force": force, "factor": 0.0}
    if spring:
        joints["spring"] = {"use": "spring_damper", "between": ["a:end", "b:end"],
                            "stiffness": K, "length": LENGTH}
    return {"format": 1, "bodies": bodies, "joints": joints, "loads": loads, "probes": probes,
            "time": {"end": 0.1, "step": step},
            "reducer": {"use": "galerkin", "basis": {"use": "modal", "count": 4}}}


K, LENGTH = 200.0, 0.25
"""Stiffness, N/m, and length, m, of the spring of two bars."""


@compiled
@pytest.mark.slow
def test_two_units_with_a_spring_between_them_move_as_one_model(tmp_path: Path) -> None:
    """The master reads both ends and sets the force of the spring for the next step: an error of
    first order in the step."""
    errors = []
    for step in (1e-3, 5e-4):
        def scene(names: str, spring: bool, step: float = step) -> Scene:
            file = tmp_path / f"{names}{spring}.yaml"
            file.write_text(json.dumps(hinged(names, spring, step)))
            return load(file)

        whole = simulate(scene("ab", True))
        slaves = []
        for name in "ab":
            outputs = [f"end_{name}.x", f"end_{name}.y"]
            unit = export_fmu(reduce(scene(name, False)), tmp_path / f"{name}{step}.fmu",
                              [f"loads.{axis}_{name}.factor" for axis in "xy"], outputs)
            slaves.append(slave_of(unit))
        for i in range(len(whole.times) - 1):
            a, b = (np.array(s.getReal([2, 3])) for s in slaves)
            far = float(np.linalg.norm(b - a))
            force = K * (far - LENGTH) / far * (b - a)
            for slave, own in zip(slaves, (force, -force), strict=True):
                slave.setReal([0, 1], own.tolist())
                slave.doStep(i * step, step)
        ends = [whole.probe(f"end_{name}")[-1, :2] for name in "ab"]
        errors.append(max(np.abs(np.array(s.getReal([2, 3])) - end).max()
                          for s, end in zip(slaves, ends, strict=True)))
    assert np.ptp(whole.probe("end_a")[:, 1]) > 0.01
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)


@compiled
@pytest.mark.slow
def test_states_are_restored_and_reset() -> None:
    model, unit = made("slider_crank")
    stepper, slave = model.stepper(unit.inputs, unit.outputs), slave_of(unit)
    start = outputs(slave, unit)
    for step in range(3):
        driven(slave, step, model, stepper)
    state = slave.getFMUstate()
    kept = slave.serializeFMUstate(state)
    for step in range(3, 6):
        driven(slave, step, model, stepper)
    want = outputs(slave, unit)
    slave.setFMUstate(slave.deSerializeFMUstate(kept))
    for step in range(3, 6):
        driven(slave, step, model, stepper)
    assert outputs(slave, unit) == want
    slave.reset()
    assert outputs(slave, unit) == start


@compiled
@pytest.mark.slow
def test_a_unit_needs_no_python(tmp_path: Path) -> None:
    """Its library is linked with the C library alone."""
    _, unit = made("slider_crank")
    with zipfile.ZipFile(unit.file) as archive:
        archive.extractall(tmp_path)
        assert len(archive.namelist()) == 2
    library, = tmp_path.glob("binaries/*/*")
    listed = subprocess.run(["ldd", library], capture_output=True, text=True, check=True).stdout
    assert "python" not in listed and "libc.so" in listed


@pytest.mark.full
def test_what_has_no_machine_code_is_refused(tmp_path: Path) -> None:
    model, _ = simple()
    with pytest.raises(InputError, match="no function of time is at 'loads.none'"):
        export_fmu(model, tmp_path / "a.fmu", ["loads.none"])
    with pytest.raises(InputError, match="no output is called 'nothing'"):
        export_fmu(model, tmp_path / "a.fmu", outputs=["nothing"])
    chosen = reduce(model.scene.using({"reducer": {
        "use": "sparse", "basis": {"use": "pod", "count": 6}, "budgets": {"*": {"atoms": 3}}}}))
    with pytest.raises(InputError, match="has no steps in machine code"):
        export_fmu(chosen, tmp_path / "a.fmu", [])
    assert not list(tmp_path.iterdir())


def simple() -> tuple[ReducedModel, None]:
    scene = load(EXAMPLES / "radiating_plate.yaml")
    return reduce(scene.using({"reducer": GALERKIN, "time.end": 4 * scene.time.step})), None
