"""Radau IIA with two stages, a package of somebody else (tests/third_party/sparsemor-radau): an
integrator with several solves a step, used by every kind of reducer without a change elsewhere."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import load, simulate
from sparsemor.core import (
    InputError,
    NextStep,
    RunResult,
    State,
    Status,
    StepFormula,
    StepOutcome,
)
from sparsemor.core.registry.registry import Registry
from sparsemor.core.testing import check_integrator
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.core.testing.integrator import LAYOUT

PACKAGE = Path(__file__).parents[1] / "third_party" / "sparsemor-radau" / "sparsemor_radau.py"
RADAU = {"use": "radau_iia"}


@pytest.fixture(autouse=True)
def installed(distribute: Any, here: Path) -> None:
    distribute("sparsemor-radau", {"integrator": {"radau_iia": "sparsemor_radau:RadauIIA"}},
               sparsemor_radau=PACKAGE.read_text())


@pytest.mark.full
def test_it_keeps_the_laws_of_an_integrator() -> None:
    radau: Any = Registry().get("integrator", "radau_iia")()
    check_integrator(radau)
    assert not radau.one_solve and radau.order == 3


@pytest.mark.parametrize("z", [-0.1, -1.0, -10.0, -1e6, 0.3j, 2.0j, 30.0j, 1e5j])
def test_a_step_has_the_factor_of_the_method(z: complex) -> None:
    """R(z) = (1 + z/3)/(1 - 2 z/3 + z^2/6) for T' = z T and x'' = -|z|^2 x, to zero at infinity."""
    radau: Any = Registry().get("integrator", "radau_iia")()
    w = abs(z)
    x, v, a = np.ones(5), np.zeros(5), np.zeros(5)
    v[2:4], a[:2] = -w, -w * w

    def solve(f: StepFormula) -> StepOutcome:
        new = np.zeros(5)
        new[:2] = -f.r2[:2] / (f.c2 + w * w)
        new[2:4] = -f.r1[2:4] / (f.c1_first + w)
        return StepOutcome(new, Status.DONE, 1)

    start = radau.start(LAYOUT, State(0.0, x, v, a, np.zeros((5, 0))))
    outcome, end = radau.advance(solve, NextStep(radau.rules(1.0), LAYOUT, start, 1.0, 1.0))
    assert outcome.status.ok
    R = (1.0 + z / 3.0) / (1.0 - 2.0 * z / 3.0 + z * z / 6.0)
    if z.imag:  # x + i v/w starts at 1
        assert end.x[0] == pytest.approx(R.real, abs=1e-8)
        assert end.v[0] / w == pytest.approx(-R.imag, abs=1e-8)
    else:
        assert end.x[2] == pytest.approx(R.real, abs=1e-8)
    assert w < 1e4 or abs(R) < 1e-4


def orders(run: Any, block: str, steps: tuple[float, ...]) -> Any:
    """Observed orders of a block's last state, against the run of a quarter of the last step."""
    last = [run(h).block(block)[-1] for h in (*steps, steps[-1] / 4.0)]
    errors = [float(np.abs(x - last[-1]).max()) for x in last[:-1]]
    return np.log2(np.divide(errors[:-1], errors[1:]))


@pytest.mark.full
def test_heat_has_order_three() -> None:
    def run(h: float) -> RunResult:
        return simulate(load(tiny().folder / "tiny.yaml", {
            "bodies.bar.fields": ["thermal"], "joints": {}, "loads": {"heating": {
                "use": "heat_flux", "on": ["bar:right"], "flux": {
                    "use": "smooth_step", "end": 40.0, "final": 1e5}}},
            "probes": {}, "reducer": "full", "integrator": RADAU, "time": {"end": 40.0, "step": h},
            "training": {}}))

    assert orders(run, "bar.thermal", (2.0, 1.0, 0.5)) == pytest.approx(3.0, abs=0.25)


ROD: dict[str, Any] = {"use": "rigid", "mass": 1.0, "inertia": 0.1,
                       "points": {"top": [0.0, 0.5], "end": [0.0, -0.5]}}
PENDULUM: dict[str, Any] = {
    "bodies": {"one": {**ROD, "pose": {"position": [0.5, 0.0], "angle": np.pi / 2}},
               "two": {**ROD, "pose": {"position": [1.5, 0.0], "angle": np.pi / 2}}},
    "joints": {"pin": {"use": "revolute", "between": ["ground", "one:top"]},
               "elbow": {"use": "revolute", "between": ["one:end", "two:top"]}},
    "loads": {"weight": {"use": "gravity"}}, "reducer": "full"}


def swing(integrator: Any, h: float, end: float) -> March:
    return march(scene_of({**PENDULUM, "integrator": integrator, "time": {"end": end, "step": h}}))


def energies(run: March) -> Any:
    """Kinetic and potential energy of the double pendulum at all states."""
    found: Any = 0.0
    for body in ("one", "two"):
        at = run.model.layout[f"{body}.rigid"]
        x, v = run.x[:, at], run.v[:, at]
        found = found + 0.5 * (v[:, 0] ** 2 + v[:, 1] ** 2) + 0.05 * v[:, 2] ** 2 + 9.81 * x[:, 1]
    return found


@pytest.mark.full
def test_a_mechanism_has_order_three() -> None:
    last = [swing(RADAU, h, 0.32).x[-1, :6] for h in (0.02, 0.01, 0.005, 0.00125)]
    errors = [float(np.abs(x - last[-1]).max()) for x in last[:-1]]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(3.0, abs=0.3)


@pytest.mark.full
def test_it_takes_less_energy_of_a_pendulum_than_bdf2() -> None:
    lost = {}
    for name in ("radau_iia", "bdf2"):
        energy = energies(swing(name, 0.005, 1.5))
        lost[name] = float(np.abs(energy - energy[0]).max())
    assert lost["radau_iia"] < 0.02 * lost["bdf2"]


@pytest.mark.full
@pytest.mark.parametrize(("reducer", "limit"), [
    pytest.param({"use": "galerkin", "basis": {"use": "pod", "energy": 1.0}}, 1e-6,
                 marks=pytest.mark.full),
    pytest.param({"use": "deim", "basis": {"use": "pod", "energy": 1.0}}, 1e-3,
                 marks=pytest.mark.full),
    ({"use": "sparse", "basis": {"use": "pod", "count": 10}, "budgets": {"*": {"rows": 20}}}, 1e-3),
])
def test_reduced_models_take_its_steps(reducer: dict[str, Any], limit: float) -> None:
    full, reduced = (simulate(load(tiny().folder / "tiny.yaml", {
        "time.end": 0.02, "training.end": 0.02, "integrator": RADAU, "reducer": r}))
        for r in ("full", reducer))
    assert reduced.status is Status.DONE
    for block in full.layout.differential:
        x, y = full.block(block.name), reduced.block(block.name)
        moved = np.abs(x - x[0]).max()
        assert np.abs(x - y).max() < limit * moved, block.name


@pytest.mark.full
def test_adaptive_steps_use_its_order() -> None:
    run = simulate(load(tiny().folder / "tiny.yaml", {
        "time": {"end": 0.01, "step": 2e-3, "control": {"tolerance": 1e-3}}, "integrator": RADAU,
        "reducer": "full"}))
    assert run.status is Status.DONE and run.summary["control"]["largest_error"] <= 1.0


@pytest.mark.full
def test_what_needs_one_solve_says_so() -> None:
    with pytest.raises(InputError, match="an integrator with one solve a step"):
        simulate(load(tiny().folder / "tiny.yaml", {
            "time.end": 0.005, "training.end": 0.005, "integrator": RADAU,
            "reducer": {"use": "galerkin", "error_estimate": 2}}))
