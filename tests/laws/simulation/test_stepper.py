"""Reduced models stepped from outside: equal to runs, inputs between steps, states saved and
restored, refusals."""

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import InputError, ReducedModel, SolveFailed, load, load_model, reduce
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.plugins.kept_models.co_simulation import ModelStepper
from sparsemor.reducers.step.compiled import compiled_stepper as compiled
from sparsemor.reducers.step.compiled.compile import linked
from sparsemor.reducers.step.compiled.compiled_steps import CompiledSteps

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
FLUX = "loads.heating.flux"
PULSE = {"use": "sine", "amplitude": 1.0e6, "frequency": 30.0}


@cache
def model(reducer: str = "galerkin") -> ReducedModel:
    return reduce(tiny().using({
        "reducer": {"use": reducer, "basis": {"use": "pod", "count": 4}}, FLUX: PULSE,
        "probes": {"end": {"body": "bar", "at": "end_b"}}}))


def follow(stepper: ModelStepper, made: ReducedModel, until: float) -> None:
    """Steps with the values that the functions of the scene have at the end of each step."""
    own = dict(functions_of_time({"loads": made.scene.loads, "joints": made.scene.joints}))
    while stepper.t < until - 1e-9:
        for key in stepper.inputs:
            stepper.set(key, own[key].value(stepper.t + stepper.step_size))
        stepper.step()


def assert_at_end(stepper: ModelStepper, made: ReducedModel, near: float) -> None:
    run = made.run()
    assert stepper.t == run.times[-1]
    for probe in run.probes:
        want = run.probe(probe)[-1]
        got = stepper.values([n for n in stepper.outputs if n.startswith(f"{probe}.")])
        assert np.allclose(got, want, rtol=near, atol=near * np.abs(want).max())


def test_steps_are_those_of_a_run() -> None:
    made = model()
    stepper = made.stepper()
    stepper.step(len(made.run().times) - 1)
    assert_at_end(stepper, made, 0.0)
    stepper.reset()
    assert stepper.t == 0.0


@pytest.mark.parametrize("reducer", [
    "galerkin", *(pytest.param(r, marks=pytest.mark.full) for r in ("sparse", "deim", "lspg"))])
def test_inputs_with_the_values_of_the_scene_give_its_run(reducer: str, tmp_path: Path) -> None:
    made = model(reducer)
    made.save(tmp_path / "m")
    for one in (made, load_model(tmp_path / "m")):
        stepper = one.stepper([FLUX], ["end.temperature", "end.x"])
        follow(stepper, made, made.scene.time.end)
        want = made.run().probe("end")[-1]
        assert stepper.get("end.temperature") == pytest.approx(want[-1], rel=1e-12)
        assert stepper.get("end.x") == pytest.approx(want[0], rel=1e-12)


@pytest.mark.full
@pytest.mark.parametrize(("example", "key"), [
    ("slider_crank", "joints"), ("radiating_plate", "loads")])
def test_drives_and_loads_of_examples_are_inputs(example: str, key: str) -> None:
    file = EXAMPLES / f"{example}.yaml"
    made = reduce(load(file, {"time.end": load(file).time.step * 40,
                              "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 6}}}))
    keys = [k for k in made.possible_inputs if k.startswith(key)]
    assert keys
    stepper = made.stepper(keys)
    follow(stepper, made, made.scene.time.end)
    assert_at_end(stepper, made, 1e-9)


@pytest.mark.parametrize("count", [-1, 1.5, "2"])
def test_a_count_that_is_no_number_of_steps_is_refused(count: Any) -> None:
    stepper = model().stepper([FLUX])
    with pytest.raises(InputError, match="a whole number of steps"):
        stepper.step(count)
    with pytest.raises(InputError, match="an input is a number"):
        stepper.set(FLUX, "much")  # type: ignore[arg-type]
    assert stepper.t == 0.0


def test_a_pickled_stepper_and_a_restored_state_go_on_with_equal_digits() -> None:
    stepper = model().stepper([FLUX])
    stepper.set(FLUX, 3.0e6)
    stepper.step(5)
    state, other = stepper.saved(), pickle.loads(pickle.dumps(stepper))
    stepper.step(5)
    want = stepper.values()
    assert other.inputs == {FLUX: 3.0e6}
    other.step(5)
    assert np.array_equal(other.values(), want)
    stepper.set(FLUX, -3.0e6)
    stepper.restore(state)
    stepper.set(FLUX, 1.0)  # not a value that was kept of the same time
    stepper.step()
    cold = stepper.get("end.temperature")
    stepper.restore(state)
    stepper.step()
    assert stepper.get("end.temperature") > cold
    stepper.step(4)
    assert np.array_equal(stepper.values(), want)


@pytest.mark.full
def test_compiled_steps_read_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel as plain Python: functions of time are not tabulated ahead of an input."""
    blocks, advance = [], CompiledSteps.advance
    plain = model().stepper([FLUX])
    monkeypatch.setattr(compiled, "wanted", lambda *_: True)
    monkeypatch.setattr(CompiledSteps, "advance", lambda *given: (
        blocks.append(block := advance(*given)), block)[1])
    monkeypatch.setattr(CompiledSteps.__init__, "__defaults__", (
        lambda functions: linked(functions, lambda function: function)["advance"],))
    stepper = model().stepper([FLUX])
    for one in (stepper, plain):
        for flux in (4.0e6, -5.0e6):
            one.set(FLUX, flux)
            one.step(6)
    assert sum(map(len, blocks)) > 6
    assert np.allclose(stepper.values(), plain.values(), rtol=1e-9, atol=1e-12)


def test_what_is_no_input_and_no_output_is_refused() -> None:
    with pytest.raises(InputError, match="no function of time is at 'loads.heating.flx'"):
        model().stepper(["loads.heating.flx"])
    with pytest.raises(InputError, match="no output is called 'end.z'"):
        model().stepper(outputs=["end.z"])
    stepper = model().stepper([FLUX], ["end.x"])
    with pytest.raises(InputError, match="must be finite"):
        stepper.set(FLUX, float("nan"))
    with pytest.raises(InputError, match="no output is called 'end.y'"):
        stepper.get("end.y")
    with pytest.raises(InputError, match="no state of this model"):
        stepper.restore(b"something else")
    stepper.set(FLUX, 1e14)
    with pytest.raises(SolveFailed, match="diverged"):
        stepper.step(50)
    stepper.reset()
    stepper.step()
