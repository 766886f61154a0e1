"""State space of linear models: steps of the integrator from its matrices alone, files that are
read back, what is refused."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from small_scenes import tiny
from sparsemor import InputError, ReducedModel, load_model, reduce
from sparsemor.plugins.export.matrices import export_matrices, state_space

FLUX, PULL = "loads.heating.flux", "loads.pull.factor"


@cache
def model(reducer: str) -> ReducedModel:
    """A heated bar whose frame is held, with thermal expansion, pulled at its end."""
    return reduce(tiny().using({
        "joints": {}, "bodies.bar.frame": "fixed", "integrator": "bdf1",
        "reducer": {"use": reducer, "basis": {"use": "pod", "count": 4}},
        "loads.pull": {
            "use": "point_force", "on": "bar:end_b", "force": [0.0, 50.0], "factor": 1.0},
        "bodies.bar.reference": {"clamp": "left"},
        "probes": {"end": {"body": "bar", "at": "end_b"}}}))


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "sparse", "deim"])
def test_implicit_euler_steps_from_the_matrices_are_those_of_the_model(reducer: str) -> None:
    made = model(reducer)
    space, stepper = state_space(made), made.stepper()
    assert set(space.inputs) == {FLUX, PULL, *space.inputs} and space.C.shape[0] == 5
    h, z = stepper.step_size, space.start
    stepper = made.stepper(space.inputs, space.outputs)
    inverse = np.linalg.inv(np.eye(len(z)) - h * space.A)
    for i in range(12):
        u = np.array([stepper.inputs[k] * (1.0 + 0.1 * i) for k in space.inputs])
        for key, value in zip(space.inputs, u, strict=True):
            stepper.set(key, value)
        stepper.step()
        z = inverse @ (z + h * (space.B @ u + space.f))
        y = space.C @ z + space.y0
        assert np.allclose(y, stepper.values(), rtol=1e-9, atol=1e-12 * np.abs(y).max())


@pytest.mark.full
def test_files_hold_the_same_numbers(tmp_path: Path) -> None:
    made = model("galerkin")
    made.save(tmp_path / "m")
    wanted = [PULL], ["end.y"]
    space = export_matrices(load_model(tmp_path / "m"), tmp_path / "a.npz", "npz", *wanted)
    export_matrices(made, tmp_path / "a.mat", "mat", *wanted)
    export_matrices(made, tmp_path / "a", "mtx", *wanted)
    one, two = np.load(tmp_path / "a.npz"), scipy.io.loadmat(tmp_path / "a.mat")
    for name in ("A", "B", "C", "mass", "stiffness", "damping"):
        assert np.array_equal(one[name], getattr(space, name))
        assert np.array_equal(two[name], one[name])
        assert np.allclose(scipy.io.mmread(tmp_path / "a" / f"{name}.mtx"), one[name], rtol=1e-15)
    assert one["inputs"].tolist() == [PULL] and one["outputs"].tolist() == ["end.y"]
    assert (tmp_path / "a" / "inputs.txt").read_text() == f"{PULL}\n"
    with pytest.raises(InputError, match="must be a new folder"):
        export_matrices(made, tmp_path / "a", "mtx")


@pytest.mark.full
def test_what_is_not_linear_is_refused(tmp_path: Path) -> None:
    moving = reduce(tiny().using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}}}))
    with pytest.raises(InputError, match="rigid coordinates or joint forces are unknowns"):
        state_space(moving)
    pulsed = reduce(model("galerkin").scene.using({
        FLUX: {"use": "sine", "amplitude": 1e6, "frequency": 7.0}}))
    with pytest.raises(InputError, match="make their functions inputs"):
        state_space(pulsed, [PULL])
    with pytest.raises(InputError, match="no format of matrices is called 'csv'"):
        export_matrices(pulsed, tmp_path / "a.csv", "csv")
    assert not list(tmp_path.iterdir())
