"""The linearised one-step map against closed forms: pendulums, heat, vibration."""

from typing import Any

import numpy as np
import pytest

from sparsemor.core import ReducedProblem, StepSolver
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.time_stepping import started
from sparsemor.core.simulation.training import train
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.stability.spectrum import (
    eigenvalues,
    exact_values,
    own_radii,
    own_values,
    radius,
)
from sparsemor.plugins.stability.stability_check import ReferenceModels, judge
from sparsemor.plugins.stability.step_map import StepMap, step_map

H, G = 1e-3, 9.81
DOWN, UP = -np.pi / 2, np.pi / 2


def stepped(scene: Scene) -> tuple[StepMap, StepSolver]:
    """The map at the start, trained over the scene's own run; and the solver."""
    model = assemble(scene)
    snapshots = {} if not model.reducible() else {
        n: s.T for n, s in train(scene.for_training(), new_manager()).items()}
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, H, Offline.from_snapshots(
            model, snapshots), np.random.default_rng(1)))
    state, memory = started(solver, scene.integrator, consistent_state(model))
    return step_map(solver, scene.integrator, H, state, memory), solver


def pendulum(angle: float, integrator: Any, x: float = 0.0) -> Scene:
    """A rigid body of 2 kg and 0.3 kg m^2 about its centre, 0.6 m from a pin at x (m), at rest."""
    return scene_of({
        "bodies": {"bob": {"use": "rigid", "mass": 2.0, "inertia": 0.3, "center": [0.6, 0.0],
                           "points": {"a": [0.0, 0.0]},
                           "pose": {"angle": angle, "position": [x, 0.0]}}},
        "joints": {"pin": {"use": "revolute", "between": ["ground", "bob:a"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -G]}},
        "time": {"end": 0.01, "step": H}, "integrator": integrator})


RATE = np.sqrt(2.0 * G * 0.6 / (0.3 + 2.0 * 0.6**2))  # rad/s about either equilibrium


def test_a_hanging_pendulum_under_bdf1_shrinks_as_its_rule_says() -> None:
    step, _ = stepped(pendulum(DOWN, "bdf1"))
    values = eigenvalues(step.matrix)[:2]
    exact = 1.0 / (1.0 - 1j * RATE * H)
    assert np.abs(values.real - exact.real).max() < 1e-8
    assert np.abs(np.abs(values.imag) - exact.imag).max() < 1e-8


def test_an_inverted_pendulum_grows_and_that_is_its_own() -> None:
    step, _ = stepped(pendulum(UP, "bdf1"))
    assert radius(step.matrix) == pytest.approx(1.0 / (1.0 - RATE * H), abs=1e-8)


@pytest.mark.parametrize(("x", "turns", "error"), [
    (1e4, 0, 1e-7), (1e6, 0, 3e-5), (0.0, 1000, 1e-6), (-1e6, -1000, 3e-5)])
def test_the_place_and_whole_turns_change_round_off_only(
    x: float, turns: int, error: float
) -> None:
    """Perturbations do not grow with coordinates: 1000 km away, or after 1000 turns, errors are
    those of positions rounded to 1e-10 m."""
    angle = UP + 2.0 * np.pi * turns
    step, _ = stepped(pendulum(angle, "bdf1", x))
    assert radius(step.matrix) == pytest.approx(1.0 / (1.0 - RATE * H), abs=error)


@pytest.mark.parametrize("rho", [0.0, 0.8, 1.0])
def test_generalized_alpha_keeps_or_damps_a_slow_pendulum(rho: float) -> None:
    """|eigenvalue| of the pendulum's pair: 1 without damping, below 1 by O((w h)^3) otherwise."""
    step, _ = stepped(pendulum(DOWN, {"use": "generalized_alpha", "rho_inf": rho}))
    values = eigenvalues(step.matrix)
    pair = values[np.abs(np.abs(np.angle(values)) - RATE * H) < 1e-6]
    assert len(pair) == 2
    lost = 1.0 - np.abs(pair)
    assert np.all(lost < (RATE * H) ** 3) and np.all(lost > -1e-9)
    if rho == 1.0:
        assert np.abs(lost).max() < 1e-9


def bar(
    reducer: dict[str, Any], integrator: Any = "bdf1", angle: float = 0.0, E: float = 7e8,
    end: float = 0.04,
) -> Scene:
    """A heated bar on a pin at its left edge."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"],
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                     "divisions": [8, 2]},
            "sets": {"end_a": {"nearest": [0.0, 0.0]}, "end_b": {"nearest": [0.5, 0.0]}},
            "material": {"E": E, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 1500, "c": 90},
            "reference": {"chord": ["end_a", "end_b"]}, "pose": {"angle": angle}}},
        "joints": {"pin": {"use": "revolute", "between": ["ground", "bar:left"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -G]},
                  "heating": {"use": "heat_flux", "on": ["bar:right"], "flux": 1e6}},
        "time": {"end": end, "step": H}, "integrator": integrator, "reducer": reducer})


def all_atoms(k: int = 8) -> dict[str, Any]:
    return {"use": "galerkin", "basis": {"use": "pod", "count": k}}


@pytest.mark.full
def test_the_thermal_part_is_that_of_its_rule() -> None:
    """BDF1: eigenvalues 1/(1 + s h) with s of the projected (K, C); an insulated body's is 1."""
    step, solver = stepped(bar(all_atoms()))
    model, d = assemble(bar(all_atoms())), solver.dictionaries["bar.thermal"].atoms
    data = model.block_data("bar.thermal")
    from scipy.linalg import eigh

    s = eigh(d.T @ (data.stiffness @ d), d.T @ (data.mass @ d), eigvals_only=True)
    values = np.sort(np.abs(eigenvalues(step.own("bar.thermal"))))[::-1][: len(s)]
    assert values == pytest.approx(1.0 / (1.0 + s * H), abs=1e-10)
    assert own_radii(step)["bar.thermal"] == pytest.approx(1.0, abs=1e-10)


@pytest.mark.full
@pytest.mark.parametrize("integrator, modulus", [
    ("bdf1", lambda w: 1.0 / np.sqrt(1.0 + (w * H) ** 2)),
    ({"use": "generalized_alpha", "rho_inf": 1.0}, lambda w: 1.0)])
def test_the_elastic_part_in_a_fixed_frame_is_that_of_its_rule(
    integrator: Any, modulus: Any
) -> None:
    """A projected elastic block keeps its frequencies real and answers as the rule does."""
    step, solver = stepped(bar(all_atoms(), integrator))
    squares = own_values(step)["bar.elastic"]
    d = solver.dictionaries["bar.elastic"].atoms
    data = assemble(bar(all_atoms())).block_data("bar.elastic")
    from scipy.linalg import eigh

    exact = eigh(d.T @ (data.stiffness @ d), d.T @ (data.mass @ d), eigvals_only=True)
    assert np.sort(squares.real) == pytest.approx(exact, rel=1e-6)
    assert np.abs(squares.imag).max() < 1e-6 * np.abs(squares).max()
    slowest = np.sqrt(exact[0])
    assert own_radii(step)["bar.elastic"] == pytest.approx(modulus(slowest), abs=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf1", {"use": "generalized_alpha", "rho_inf": 0.8}])
def test_the_projected_model_grows_as_full_order_does(integrator: Any) -> None:
    """What reduced models are judged by: its growing pair is that of the whole coupled map."""
    full, _ = stepped(bar({"use": "full"}, integrator, angle=UP))
    own, _ = stepped(bar(all_atoms(12), integrator, angle=UP))
    assert len(full.matrix) > 2 * len(own.matrix)
    assert radius(full.matrix) > 1.005
    assert radius(own.matrix) - radius(full.matrix) == pytest.approx(0.0, abs=2e-6)
    assert abs(eigenvalues(full.matrix)[1]) < 1.0 + 1e-6, "one growing direction, as in theory"
    assert abs(eigenvalues(own.matrix)[1]) < 1.0 + 1e-6


def test_full_order_eigenvalues_are_those_of_the_dense_pencil() -> None:
    model = assemble(bar(all_atoms()))
    from scipy.linalg import eigh

    for name, values in exact_values(model).items():
        data = model.block_data(name)
        dense = eigh(data.stiffness.toarray(), data.mass.toarray(), eigvals_only=True)
        top = dense[len(values) - 1]
        assert np.abs(values - dense[: len(values)]).max() < 1e-8 * top


@pytest.mark.full
def test_an_inverted_flexible_bar_grows_far_beyond_the_limit_and_is_no_false_alarm() -> None:
    """Standing upright, stiff: (3/2) g/l of a slender bar, with I = m (l^2/3 + b^2/12). Over 4000
    steps the growth is e^20; none of it is charged to the reduced model."""
    sampled = {"use": "sparse", "basis": {"use": "pod", "count": 8},
               "budgets": {"*.elastic": {"rows": 12, "atoms": 8},
                           "*.thermal": {"rows": 12, "atoms": 8}}}
    scene = bar(sampled, angle=UP, E=7e11)
    step, solver = stepped(scene)
    model = assemble(scene)
    found = judge(
        solver, scene.integrator, H, 4000, consistent_state(model), ReferenceModels(model))
    rate = np.sqrt(G * 0.25 / (0.5**2 / 3.0 + 0.1**2 / 12.0))
    assert found.radius == pytest.approx(1.0 / (1.0 - rate * H), abs=2e-6)
    assert found.growth > 20.0
    assert found.stable and found.gate < 0.05
    assert found.reference == pytest.approx(found.radius, abs=1e-6)
    assert radius(step.matrix) == found.radius
