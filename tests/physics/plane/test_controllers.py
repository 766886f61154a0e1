"""Controllers: closed forms of controlled motion and heat, equal digits however they run."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, load_model, reduce, simulate
from sparsemor.core import SolveFailed, hookimpl
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_function
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.pid import Pid

J = 0.02


def rotor(torque: Any, step: float = 0.01, end: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"format": 1,
            "bodies": {"a": {"use": "rigid", "mass": 1.0, "inertia": J,
                             "points": {"p": [0.0, 0.0]}}},
            "joints": {"pin": {"use": "revolute", "between": ["ground", "a:p"]},
                       "motor": {"use": "rotational_spring", "between": ["a:p", "ground"],
                                 "torque": torque}},
            "time": {"end": end, "step": step},
            "integrator": {"use": "generalized_alpha", "rho_inf": 0.9}, **more}


PD = {"use": "pid", "sensor": "a.rigid.angle", "target": 1.0, "kp": 2.0, "kd": 0.1}


@pytest.mark.full
def test_a_position_controller_has_the_motion_of_its_closed_loop() -> None:
    """J phi'' = kp (1 - phi) - kd phi', to first order in the step; the recorded torque is that of
    the step that ends there, from the state at its start."""
    errors = []
    for step in (0.01, 0.005):
        run = simulate(load(rotor(PD, step)))
        d, t = 0.1 / (2 * J), run.times
        w = np.sqrt(2.0 / J - d * d)
        exact = 1.0 - np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t))
        phi, torque = run.block("a.rigid")[:, 2], run.joint_forces()["motor"]["torque", "N m"]
        errors.append(np.abs(phi - exact).max())
        want = 2.0 * (1.0 - phi) - 0.1 * np.diff(phi, prepend=phi[0]) / step
        np.testing.assert_allclose(torque[1:], want[:-1], rtol=0.0, atol=1e-9)
    assert errors[1] < 0.06 and 1.7 < errors[0] / errors[1] < 2.7


@pytest.mark.full
def test_integral_action_removes_the_error_of_a_constant_load() -> None:
    torque = {"use": "pid", "sensor": "a.rigid.angle", "target": 0.5, "kp": 2.0, "ki": 4.0,
              "kd": 0.3}
    loads = {"load": {"use": "torque", "on": "a:p", "torque": -0.7}}
    run = simulate(load(rotor(torque, 0.01, 8.0, loads=loads)))
    assert run.block("a.rigid")[-1, 2] == pytest.approx(0.5, abs=1e-4)


@pytest.mark.full
def test_limits_and_a_speed_controller_in_a_cascade() -> None:
    """The torque is limited at the start: phi'' = limit / J."""
    speed = {"use": "pid", "sensor": "a.rigid.angle", "target": 1.0, "kp": 5.0}
    torque = {"use": "pid", "sensor": "a.rigid.angle_rate", "target": speed, "kp": 1.0,
              "lower": -0.1, "upper": 0.1}
    run = simulate(load(rotor(torque, 0.004, 4.0)))
    phi, t = run.block("a.rigid")[:, 2], run.times
    assert phi[50] == pytest.approx(0.5 * 0.1 / J * t[50] ** 2, rel=0.02)
    assert phi[-1] == pytest.approx(1.0, abs=1e-3)


HEATED: dict[str, Any] = {
    "format": 1,
    "bodies": {"plate": {
        "use": "flexible", "mesh": {"use": "rectangle", "size": [0.1, 0.02], "divisions": [10, 2]},
        "thickness": 0.01, "material": {"rho": 7850, "k": 44.5, "c": 475}, "fields": ["thermal"],
        "frame": "fixed"}},
    "loads": {
        "heater": {"use": "heat_flux", "on": ["plate:left"], "flux": {
            "use": "pid", "sensor": "end.temperature", "target": 320.0, "kp": 2e3, "ki": 10.0,
            "lower": 0.0, "upper": 2e5}},
        "air": {"use": "convection", "on": ["plate:top", "plate:bottom", "plate:right"],
                "film": 50.0, "temperature": 293.15}},
    "probes": {"end": {"body": "plate", "at": "right"}},
    "time": {"end": 1000.0, "step": 2.0}, "integrator": "bdf1"}


@pytest.mark.full
def test_a_heater_holds_the_temperature_of_a_probe() -> None:
    run = simulate(load({**HEATED, "time": {"end": 6000.0, "step": 15.0}}))
    assert run.probe("end")[-1, -1] == pytest.approx(320.0, abs=0.01)


@pytest.mark.full
@pytest.mark.parametrize("loads", ["varying", {"heater": [0.0, 1e5]}])
def test_controllers_vary_in_training_by_themselves(loads: Any) -> None:
    run = simulate(load({**HEATED, "reducer": "galerkin", "training": {"loads": loads}}))
    assert not [n for n in run.summary["notes"] if "heater" in n]


# ---------------------------------------------------------------------- every way to run


class StopAt:
    def __init__(self, step: int) -> None:
        self.at = step

    @hookimpl
    def on_step(self, step: int) -> None:
        if step == self.at:
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["full", {"use": "galerkin"}])
def test_a_resumed_run_has_the_same_digits(tmp_path: Path, reducer: Any) -> None:
    scene = load({**HEATED, "time": {"end": 100.0, "step": 2.0}, "reducer": reducer})
    whole = simulate(scene)
    with pytest.raises(SolveFailed, match="interrupted"):
        simulate(scene, out=tmp_path / "run", observers=[StopAt(17)])
    run = simulate(scene, out=tmp_path / "run", resume=True)
    np.testing.assert_array_equal(run.probe("end"), whole.probe("end"))


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "sparse"])
def test_reduced_and_kept_models_and_steppers(tmp_path: Path, reducer: str) -> None:
    content = {**HEATED, "time": {"end": 100.0, "step": 2.0}}
    full = simulate(load(content)).probe("end")
    scene = load({**content, "reducer": {"use": reducer, "compiled": "off"}})
    want = simulate(scene).probe("end")
    np.testing.assert_allclose(want, full, rtol=0.0, atol=0.02)
    model = reduce(scene)
    np.testing.assert_allclose(model.run().probe("end"), want, rtol=1e-12)
    model.save(tmp_path / "m")
    kept = load_model(tmp_path / "m")
    np.testing.assert_allclose(kept.run().probe("end"), want, rtol=1e-12)
    other = kept.run({"loads.heater.flux.target": 310.0}).probe("end")
    again = simulate(scene.using({"loads.heater.flux.target": 310.0})).probe("end")
    np.testing.assert_allclose(other[-1], again[-1], atol=0.05)
    stepper = kept.stepper()
    stepper.step(20)
    saved = stepper.saved()
    stepper.step(30)
    assert stepper.get("end.temperature") == pytest.approx(want[-1, -1], abs=1e-9)
    stepper.restore(saved)
    stepper.step(30)
    assert stepper.get("end.temperature") == pytest.approx(want[-1, -1], abs=1e-9)


@pytest.mark.full
def test_a_controller_that_is_an_input_of_a_stepper_is_set_from_outside() -> None:
    """Also in the recorded force."""
    bar = {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
           "thickness": 0.02, "material": {"rho": 2700, "E": 7e9, "nu": 0.3}, "order": 2,
           "mesh": {"use": "rectangle", "size": [0.4, 0.04], "divisions": [4, 1]}}
    torque = {"use": "pid", "sensor": "arm.rigid.angle", "target": 0.5, "kp": 20.0, "kd": 1.0}
    model = reduce(load({
        "format": 1, "bodies": {"arm": bar},
        "joints": {"hub": {"use": "revolute", "between": ["ground", "arm:left"]},
                   "motor": {"use": "rotational_spring", "between": ["arm:left", "ground"],
                             "torque": torque}},
        "time": {"end": 0.1, "step": 1e-3}, "integrator": "bdf2",
        "reducer": {"use": "galerkin", "compiled": "off"}}))
    stepper = model.stepper()
    stepper.step(50)
    assert 0.0 < stepper.get("arm.rigid.angle") < 1.0
    stepper = model.stepper(["joints.motor.torque"])
    stepper.set("joints.motor.torque", 5.0)
    stepper.step(10)
    assert stepper.get("motor.torque") == pytest.approx(5.0)


@pytest.mark.slow  # compiles
def test_compiled_steps_have_the_same_controller() -> None:
    content = {**HEATED, "time": {"end": 100.0, "step": 2.0}}
    off, on = (simulate(load({**content, "reducer": {"use": "galerkin", "compiled": c}}))
               for c in ("off", "on"))
    np.testing.assert_allclose(on.probe("end"), off.probe("end"), rtol=1e-10)


# ---------------------------------------------------------------------- laws and input


def test_laws() -> None:
    check_function(Pid(sensor="a.x", kp=1.0))


@pytest.mark.parametrize(("torque", "more", "message"), [
    ({**PD, "sensor": "a.rigid.angel"}, {},
     "joints.motor.torque.sensor: no sensor is called 'a.rigid.angel': did you mean a.rigid.angle"),
    ({**PD, "kp": 0.0, "kd": 0.0}, {}, "it does nothing: give kp, ki or kd"),
    ({**PD, "lower": 1.0, "upper": 0.0}, {}, "lower 1 must be below upper 0"),
    (PD, {"time": {"end": 1.0, "step": 0.01, "control": {"tolerance": 1e-4}}},
     "time.control: joints.motor.torque is a controller"),
    (PD, {"reducer": {"use": "auto"}}, "trial runs cannot choose: name a reducer"),
])
def test_bad_input_is_refused(torque: Any, more: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(scene_of(rotor(torque, **more)))
    assert message in str(caught.value)


@pytest.mark.full
@pytest.mark.parametrize(("value", "message"), [
    (1.0, "a number with the numbers that it remembers"), (("much", ()), "a number with the"),
    ((1.0, (2.0,)), "a memory of 1 numbers, where one of 0"),
    ((float("nan"), ()), "the controller gives nan at t = 0 s")])
def test_controllers_that_return_no_value_are_refused(
    value: Any, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pid, "begin", lambda self: ())
    monkeypatch.setattr(Pid, "update", lambda self, t, h, sensed, memory: value)
    with pytest.raises(InputError, match=message) as caught:
        simulate(scene_of(rotor(PD)))
    assert "joints.motor.torque" in str(caught.value)
