"""Compiled steps as machine code: runs of whole scenes, and resumed runs."""

import os
import signal
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest

from small_scenes import SCENES, tiny
from sparsemor import load_model, reduce
from sparsemor.core import InputError, hookimpl
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed, Status
from sparsemor.reducers.step.compiled.compiled_stepper import CompiledStepper
from sparsemor.reducers.step.compiled.compiled_steps import CompiledSteps

numba: Any = pytest.importorskip("numba")
# compilation takes most of a minute: once for all tests of this file
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_cache")]
BLOCKS = ("bar.rigid", "bar.elastic", "bar.thermal")


STEEL = {"rho": 7850, "nu": 0.3, "E": {"temperatures": [250, 400, 1000],
                                       "values": [2.1e8, 1.9e8, 0.4e8]},
         "alpha": {"polynomial": [1.2e-5, 4e-9], "origin": 293.15, "range": [200, 1200]},
         "k": {"temperatures": [250, 1000], "values": [54, 27]},
         "c": {"polynomial": [440, 0.4], "origin": 293.15, "range": [200, 1200]}}


def heated(compiled: str, **more: Any) -> Scene:
    """A bar that swings and radiates, of a material that depends on temperature."""
    return tiny().using({
        "bodies.bar.material": STEEL, "loads.glow": {
            "use": "radiation", "on": ["bar:right"], "emissivity": 0.8, "surroundings": 700.0},
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}, "compiled": compiled},
        "time.end": 0.3, "training.end": 0.04, **more})


def test_a_run_as_machine_code_has_the_results_of_one_without() -> None:
    plain, code = (simulate(heated(how)) for how in ("off", "on"))
    for block in BLOCKS:
        x, y = plain.block(block), code.block(block)
        assert np.abs(x - y).max() < 1e-10 * max(float(np.abs(x).max()), 1e-3), block
    assert code.status is Status.DONE
    # an iteration costs machine code less, so that it keeps a Jacobian for more of them
    assert plain.iterations.sum() <= code.iterations.sum() < 1.3 * plain.iterations.sum()


def test_auto_takes_code_that_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not compile a short run, but takes the machine code of an earlier one."""
    monkeypatch.setattr("sparsemor.reducers.step.compiled.compiled_stepper.KEPT", 10)
    compiled = simulate(heated("on"))
    auto = simulate(heated("auto"))
    for block in BLOCKS:
        assert np.array_equal(compiled.block(block), auto.block(block)), block
    monkeypatch.setattr("sparsemor.reducers.step.compiled.compile.has_code", lambda *of: False)
    monkeypatch.setattr("sparsemor.reducers.step.compiled.compiled_steps.CompiledSteps", None)
    simulate(heated("auto"))


def test_the_steps_of_a_file_are_compiled_and_check_every_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers of a file are those of others: an index outside of an array ends the run."""
    scene = tiny().using({"reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 4}, "compiled": "on"},
        "time.end": 0.1, "training.end": 0.04})
    file = tmp_path / "bar.model"
    reduce(scene).save(file, fields=True)
    first, again = simulate(scene.using({"reducer.compiled": "off"})), load_model(file).run()
    for block in BLOCKS:
        x, y = first.block(block), again.block(block)
        assert np.abs(x - y).max() < 1e-10 * max(float(np.abs(x).max()), 1e-3), block
    own = CompiledStepper.many
    for array in ("columns", "bodies", "rows"):
        def outside(self: CompiledStepper, *given: Any, array: str = array) -> Any:
            many = own(self, *given)
            assert isinstance(many, CompiledSteps)
            getattr(many.plan.arrays.stacks[0], array)[:] = 10**9
            return many

        monkeypatch.setattr(CompiledStepper, "many", outside)
        with pytest.raises(InputError, match="no reduced model .* IndexError"):
            load_model(file).run()


def test_steps_are_compiled_for_the_runs_of_a_model_to_come(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Once, for so many runs as together have the steps that pay; then every run takes the code."""
    model, off = (reduce(heated(how)) for how in ("auto", "off"))
    assert off.compile_steps() == 0.0 == model.compile_steps(1)
    assert model.compile_steps(200) > 0.0
    caplog.clear()
    taken, own = list[int](), CompiledSteps.advance

    def counted(steps: CompiledSteps, *given: Any) -> Any:
        block = own(steps, *given)
        taken.append(len(block))
        return block

    monkeypatch.setattr(CompiledSteps, "advance", counted)
    model.run()
    assert sum(taken) > 250  # of 300
    assert not [r for r in caplog.records if "compiling" in r.message]


class StopsAt:
    """Asks for the end of the run, as Ctrl-C does, after a step."""

    def __init__(self, step: int) -> None:
        self.last = step

    @hookimpl
    def on_step(self, step: int) -> None:
        if step == self.last:
            os.kill(os.getpid(), signal.SIGINT)


def test_a_resumed_run_has_equal_digits(tmp_path: Path) -> None:
    long = heated("on", **{"time.end": 0.9})
    whole = simulate(long, out=tmp_path / "whole")
    with pytest.raises(SolveFailed) as stopped:
        simulate(long, out=tmp_path / "cut", observers=[StopsAt(130)])
    assert stopped.value.result is not None
    assert 130 <= len(stopped.value.result.times) - 1 < 900
    rest = simulate(long, out=tmp_path / "cut", resume=True)
    for block in BLOCKS:
        assert np.array_equal(whole.block(block), rest.block(block)), block


def test_equations_of_frames_in_space_as_machine_code() -> None:
    """Those of plain Python, which tests/laws/bodies/test_spatial_terms.py compares with the
    items."""
    model = assemble(load(SCENES / "everything_in_space.yaml", {
        "joints.rope": {"use": "spring_damper", "between": ["bar:right", "solid:right"],
                        "stiffness": 300.0, "damping": 1.0},
        "joints.motor": {"use": "rotational_spring", "between": ["bar:right", "solid:right"],
                         "stiffness": 2.0, "axis": [0, 1, 1]}}))
    rng, names, compiled = np.random.default_rng(4), dict[str, Any](), None
    for moving in model.separated.moving:
        f = moving.frame
        made = f.arrays()
        assert made is not None
        if compiled is None:
            for g in (*made.calls, made.function):
                compiled = names[g.__name__] = numba.njit(_nrt=False)(FunctionType(
                    g.__code__, {**g.__globals__, **names}, g.__name__))
        y, v, a = rng.standard_normal((3, f.border))
        gains, s = rng.standard_normal(len(made.kinds)), rng.standard_normal((3, f.p))
        forms, found = rng.standard_normal(3 * f.generators), []
        for function in (made.function, compiled):
            work = FrameWork(f.p, f.border, f.generators)
            function(made.kinds, made.numbers, made.starts, gains, y, v, a, 40.0, 1600.0, s, forms,
                     work.sigma, work.tau, work.border, work.coefficients, np.zeros(320))
            found.append(np.concatenate([
                work.sigma.ravel(), work.tau.ravel(), work.border.ravel(), work.coefficients]))
        np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-12 * abs(found[0]).max())
