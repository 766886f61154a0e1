"""Exported FMUs: valid, equal to the stepper of their model in another program, with states that
are restored, and what is refused. They are compiled, which takes a minute each."""

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
from sparsemor import InputError, ReducedModel, load, load_model, reduce
from sparsemor.core.simulation.stepper import Stepper
from sparsemor.plugins.export.fmu import Unit, export_fmu

GALERKIN = {"use": "galerkin", "basis": {"use": "pod", "count": 5}}
EXAMPLES = Path(__file__).parents[2] / "docs/examples"
compiled = pytest.mark.skipif(
    shutil.which("cc") is None, reason="no C compiler, which an FMU needs")


@cache
def made(name: str) -> tuple[ReducedModel, Unit]:
    folder = Path(mkdtemp(prefix="sparsemor-fmu-"))
    scene = load(EXAMPLES / f"{name}.yaml") if name != "everything" else everything().using(
        {"joints.shake": None})  # a force that five modes leave undetermined
    model = reduce(scene.using({"reducer": GALERKIN, "time.end": 40 * scene.time.step}))
    model.save(folder / "model")
    return model, export_fmu(load_model(folder / "model"), folder / f"{name}.fmu")


def driven(slave: Any, step: int, model: ReducedModel, stepper: Stepper) -> None:
    """One step of both, with inputs that differ from the scene's."""
    h = stepper.step_size
    values = [1.3 * model._inputs[k].value((step + 1) * h) for k in stepper.inputs]
    for key, value in zip(stepper.inputs, values, strict=True):
        stepper.set(key, value)
    if values:
        slave.setReal(list(range(len(values))), values)
    slave.doStep(step * h, h)
    stepper.step()


def outputs(slave: Any, unit: Unit) -> list[float]:
    first = len(unit.inputs)
    return list(slave.getReal(list(range(first, first + len(unit.outputs)))))


def slave_of(unit: Unit) -> SimpleNamespace:
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
        assert abs(got - want) <= 1e-9 * max(size, 1e-6), output


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
