"""Error-controlled steps: they meet their tolerance, at less than the finest fixed step would."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sparsemor import InputError, SolveFailed, Status, load, simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import scene_of

SECOND = ["bdf2", "generalized_alpha"]
INTEGRATORS = ["bdf1", *SECOND]
SWING = Path(__file__).parents[2] / "scenes" / "swing.yaml"


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))


# --------------------------------------------------------------------------- a rod that swings


def rod(integrator: str, step: float, control: Mapping[str, Any] | None) -> Scene:
    """1 m long, 1 kg, hanging from its end and let go horizontally."""
    body = {"use": "rigid", "mass": 1.0, "inertia": 1 / 12, "center": [0.5, 0.0],
            "points": {"end": [0.0, 0.0]}}
    return scene_of({
        "bodies": {"rod": body},
        "joints": {"pivot": {"use": "revolute", "between": ["ground", "rod:end"]}},
        "loads": {"gravity": {"use": "gravity"}},
        "time": {"end": 1.0, "step": step, "control": control}, "integrator": integrator})


@cache
def swung() -> FloatArray:
    """Angles at 0, 0.1, ..., 1 s by DOP853."""
    found = solve_ivp(lambda t, y: [y[1], -1.5 * 9.81 * np.cos(y[0])], (0.0, 1.0), [0.0, 0.0],
                      "DOP853", rtol=1e-12, atol=1e-13, t_eval=np.linspace(0.0, 1.0, 11))
    return np.asarray(found.y[0])


def swing_error(run: RunResult) -> float:
    """As the tolerance counts: in the mean over the rod's three unknowns, two of which do not
    move, against the largest such motion."""
    angle = np.interp(np.linspace(0.0, 1.0, 11), run.times, run.block("rod.rigid")[:, 2])
    moved = max(1.0, float(np.abs(swung()).max()) / np.sqrt(3.0))
    return float(np.abs(angle - swung()).max()) / np.sqrt(3.0) / moved


@pytest.mark.full
@pytest.mark.parametrize("integrator", SECOND)
def test_a_pendulum_meets_its_tolerance_with_fewer_steps_than_the_smallest(
    integrator: str
) -> None:
    errors = []
    for tolerance in (1e-4, 1e-5):
        run = simulate(rod(integrator, 0.02, {"tolerance": tolerance, "max_halvings": 12}))
        told = run.summary["control"]
        errors.append(swing_error(run))
        assert 0.1 * tolerance < errors[-1] < tolerance
        assert len(run.times) == 51 and run.times[-1] == pytest.approx(1.0, abs=1e-12)
        assert 0.5 < told["largest_error"] <= 1.0
        assert told["substeps"] < 0.9 / told["smallest_step"]
        assert told["smallest_step"] < told["largest_step"] <= 0.01
    assert errors[1] < 0.3 * errors[0]


@pytest.mark.full
def test_the_first_order_rule_meets_a_looser_one() -> None:
    run = simulate(rod("bdf1", 0.02, {"tolerance": 0.01, "max_halvings": 10}))
    plain = simulate(rod("bdf1", 0.02, None))
    assert swing_error(run) < 0.01 < swing_error(plain)


@pytest.mark.full
def test_what_is_counted() -> None:
    run = simulate(rod("bdf2", 0.02, {"tolerance": 0.5}))
    told = run.summary["control"]
    # every step of 0.02 s in two halves, checked by one whole step
    assert told == {
        "tolerance": 0.5, "substeps": 100, "substeps_for_estimates": 50, "rejected": 0,
        "smallest_step": 0.01, "largest_step": 0.01, "prepared": 2,
        "largest_error": told["largest_error"]}
    assert "control" not in simulate(rod("bdf2", 0.02, None)).summary


# --------------------------------------------------------------------------- a slab that warms


def slab(integrator: str, step: float, control: Mapping[str, Any] | None) -> Scene:
    """A strip whose left side is warmed from 5 to 10 s, and whose right side radiates."""
    ramp = {"use": "ramp", "start": 5.0, "end": 10.0, "initial": 300.0, "final": 500.0}
    return scene_of({
        "bodies": {"slab": {
            "use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [0.05, 0.01], "divisions": [8, 1]},
            "material": {"rho": 1000, "k": 20, "c": 500}, "initial_temperature": 300.0}},
        "joints": {"held": {"use": "prescribed_temperature", "on": ["slab:left"],
                            "temperature": ramp}},
        "loads": {"glow": {"use": "radiation", "on": ["slab:right"], "emissivity": 0.9,
                           "surroundings": 300.0}},
        "time": {"end": 20.0, "step": step, "control": control}, "integrator": integrator})


@cache
def warm() -> FloatArray:
    """(n,) temperatures at the end with steps of 2 ms."""
    return np.asarray(simulate(slab("generalized_alpha", 0.004, None)).block("slab.thermal")[-1])


@pytest.mark.full
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_heat_meets_its_tolerance(integrator: str) -> None:
    tolerance = 2e-2 if integrator == "bdf1" else 2e-3
    run = simulate(slab(integrator, 1.0, {"tolerance": tolerance, "max_halvings": 12}))
    T = run.block("slab.thermal")
    moved = max(100.0, float(np.sqrt(((T - T[0]) ** 2).mean(axis=1)).max()))
    error = float(np.sqrt(((T[-1] - warm()) ** 2).mean())) / moved
    plain = simulate(slab(integrator, 1.0, None)).block("slab.thermal")[-1]
    assert error < tolerance
    assert error < float(np.sqrt(((plain - warm()) ** 2).mean())) / moved
    told = run.summary["control"]
    assert told["substeps"] < 0.8 * 20.0 / told["smallest_step"]
    assert told["largest_step"] == 0.5  # before anything happens


# --------------------------------------------------------------------------- every reducer

BUDGETS = {"*.elastic": {"rows": 16, "atoms": 4}, "*.thermal": {"rows": 8, "atoms": 3}}
REDUCERS: dict[str, Any] = {
    "full": "full",
    "galerkin": {"use": "galerkin", "basis": {"use": "pod", "count": 6}},
    "sparse": {"use": "sparse", "basis": {"use": "pod", "count": 6},
               "budgets": {"*.elastic": {"rows": 16}, "*.thermal": {"rows": 8}}},
    "selecting": {"use": "sparse", "basis": {"use": "pod", "count": 6}, "budgets": BUDGETS},
    "ecsw": {"use": "ecsw", "basis": {"use": "pod", "count": 6}},
}


@pytest.mark.full
@pytest.mark.parametrize("integrator", [
    pytest.param(i, marks=[pytest.mark.slow] * (i != "bdf2")) for i in INTEGRATORS])
def test_every_reducer_takes_controlled_steps(integrator: str) -> None:
    """A heated arm that swings: its vibrations, too small to matter, are not to be resolved."""
    changes = {"time": {"end": 0.2, "step": 0.01, "control": {
        "tolerance": 0.3 if integrator == "bdf1" else 2e-2, "elastic": 0.1, "max_halvings": 8}},
        "training.end": 0.2, "training.every": 1, "integrator": integrator}
    angles = {}
    for name, reducer in REDUCERS.items():
        run = simulate(load(SWING, {**changes, "reducer": reducer}))
        told = run.summary["control"]
        assert run.status is Status.DONE and len(run.times) == 21
        assert 2 <= told["prepared"] <= 9 and told["largest_error"] <= 1.0
        assert run.summary["factorizations"] >= 2 * told["prepared"]
        angles[name] = run.block("bob.rigid")[:, 2]
    swing = float(np.ptp(angles["full"]))
    for name, angle in angles.items():
        assert np.abs(angle - angles["full"]).max() < 0.02 * swing, name


# --------------------------------------------------------------------------- refusals


@pytest.mark.full
def test_a_step_that_cannot_be_short_enough_is_named() -> None:
    with pytest.raises(SolveFailed) as caught:
        simulate(rod("bdf1", 0.02, {"tolerance": 1e-6, "max_halvings": 2}))
    failure = caught.value
    assert failure.status is Status.STEP_TOO_LONG and failure.block == "rod.rigid"
    assert failure.time == pytest.approx(0.02)
    assert "substeps of 0.005 s, after max_halvings 2" in failure.detail
    assert "raise time.control.tolerance" in str(failure)
    result = failure.result
    assert isinstance(result, RunResult) and result.summary["control"]["rejected"] == 2


def test_rows_that_change_cannot_be_compared() -> None:
    reducer = {**REDUCERS["sparse"], "resample": 5}
    with pytest.raises(InputError, match="steps of different size"):
        simulate(load(SWING, {"reducer": reducer, "time.control": {"tolerance": 0.1}}))


def test_bad_options_are_told_by_key() -> None:
    for option, value in (("tolerance", 0.0), ("max_halvings", 0), ("thermal", -1.0)):
        with pytest.raises(InputError, match=f"time.control.{option}"):
            load(SWING, {"time.control": {"tolerance": 0.1, option: value}})
