"""A step ends on evidence measured in that step: bordered and reduced steps solve the equations."""

from typing import Any

import numpy as np
import pytest

from sparsemor.core import ReducedProblem
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.reducers.full.monolithic import Summed
from sparsemor.reducers.step.convergence_test import estimated_error
from sparsemor.reducers.step.newton_loop import Linearisation
from tiers import full, quick

INTEGRATORS: list[dict[str, Any]] = [
    {"use": "bdf1"}, {"use": "bdf2"}, {"use": "generalized_alpha", "rho_inf": 0.7},
    {"use": "generalized_alpha", "rho_inf": 1.0}]
NEWTON = {"use": "full", "method": "newton"}
ATOMS = {"use": "galerkin", "basis": {"use": "pod", "complete": True}}


def pendulum(
    h: float, steps: int, E: float, integrator: dict[str, Any], reducer: Any = "full",
    divisions: tuple[int, int] = (5, 1),
) -> Scene:
    """A bar of 1 m on a pin, let go from rest."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [1.0, 0.1],
                     "divisions": list(divisions), "diagonal": "alternating"},
            "sets": {"pin": {"nearest": [0.0, 0.0]}}, "thickness": 0.1,
            "material": {"E": E, "nu": 0.3, "rho": 1000}, "damping": {"stiffness": 5e-4}}},
        "joints": {"pin": {"use": "revolute", "between": ["ground", "bar:pin"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": steps * h, "step": h}, "integrator": integrator,
        "reducer": {"use": reducer} if isinstance(reducer, str) else reducer})


def differences(one: March, other: March) -> dict[str, float]:
    """Largest difference of each block relative to its largest value; atoms are expanded."""
    found = {}
    for b in other.model.layout:
        x, y = one.block(b.name), other.block(b.name)
        d = one.solver.dictionaries.get(b.name)
        x = x if d is None else d.offset + x @ d.atoms.T
        found[b.name] = float(np.abs(x - y).max() / np.abs(y).max())
    return found


def corrections(scene: Scene, every: int) -> list[float]:
    """By how much one step of the textbook Newton changes accepted steps: relative to the largest
    value of each block so far, the largest of rigid coordinates and displacements."""
    model = assemble(scene)
    equations, h, integrator = Summed.from_model(model, price=0), scene.time.step, scene.integrator
    solver = scene.reducer.prepare(ReducedProblem(
        model, integrator, h, Offline.from_snapshots(model, {}), np.random.default_rng(0)))
    state, memory = solver.start(consistent_state(model))
    state, found = integrator.start(solver.layout, state), []
    top, rules = np.zeros(model.layout.size), integrator.rules(h)
    for n in range(step_count(scene)):
        step = step_formula(rules, solver.layout, state, h)
        outcome, memory = solver.solve(step, memory)
        assert outcome.status.ok, outcome
        x, top = outcome.x, np.maximum(top, np.abs(outcome.x))
        if n % every == every - 1:
            v, a = outcome.rates or step.at(x - step.free)[1:]
            d = step.departure(x, v, a)
            equations.begin(step, d)
            J = equations.jacobian(Linearisation(x, v, a, step.t, (
                step.c1, step.c2, step.c1_first, step.c2_first)))
            dx = equations.factorize(J).solve(equations.residual(d))
            found.append(max(
                float(np.abs(dx[at]).max() / top[at].max())
                for b in model.layout if b.field != "multiplier" for at in [model.layout[b.name]]))
        state = advanced(rules, solver.layout, state, step, outcome)
    return found


@pytest.mark.full
@pytest.mark.parametrize("integrator", INTEGRATORS[1:], ids=["bdf2", "alpha-0.7", "alpha-1"])
def test_each_accepted_step_solves_the_equations(integrator: dict[str, Any]) -> None:
    """A ratio of earlier steps accepted first changes here."""
    assert max(corrections(pendulum(2e-4, 400, 7e7, integrator), 20)) < 1e-10


@pytest.mark.parametrize(("h", "E", "which"), [
    (1e-2, 5e6, 2), *(full(*of) for of in (
        (1e-2, 7e10, 0), (1e-2, 7e10, 3), (1e-3, 5e6, 0), (1e-3, 7e10, 1), (1e-4, 7e10, 2),
        (1e-4, 5e6, 3), (1e-5, 5e6, 1), (1e-5, 7e10, 2), (1e-6, 7e10, 3), (1e-6, 5e6, 2)))])
def test_bordered_steps_are_those_of_the_textbook(h: float, E: float, which: int) -> None:
    """From 1e-2 to 1e-6 s. Displacements of 1e-9 m are known to the rounding of positions of 1 m,
    whose effect on them c2 = 1/(beta h^2) does not change."""
    integrator = INTEGRATORS[which]
    fast = march(pendulum(h, 6, E, integrator))
    plain = march(pendulum(h, 6, E, integrator, NEWTON))
    largest = max(np.abs(plain.block("bar.elastic")).max(), 1e-300)
    bound = max(1e-9, 1e-15 / float(largest))
    found = differences(fast, plain)
    assert found["bar.elastic"] < bound and found["pin.multiplier"] < 1e-7, found


@pytest.mark.full
@pytest.mark.parametrize("E", [7e7, 5e6])
def test_the_stored_estimate_bounds_the_error_that_the_iteration_leaves(E: float) -> None:
    """Tolerances of 1e-4 and 1e-7: the error of a step against the smallest tolerance."""
    def first_step(remaining: float) -> tuple[FloatArray, float]:
        r = simulate(pendulum(1e-2, 1, E, INTEGRATORS[2], {"use": "full", "remaining": remaining}))
        return r.block("bar.elastic")[-1], float(r.remaining_error[-1])

    exact, least = first_step(1e-13)
    estimates = [least]
    for remaining in (1e-7, 1e-4):
        u, estimate = first_step(remaining)
        assert np.abs(u - exact).max() <= 3.0 * estimate * np.abs(exact).max()
        assert estimate <= remaining
        estimates.append(estimate)
    assert 0.0 < estimates[0] < estimates[1] < estimates[2]


@pytest.mark.parametrize("h", quick([1e-2, 1e-4], 1e-2))
@pytest.mark.parametrize("E", quick([7e10, 5e6], 5e6))
def test_a_complete_basis_gives_the_same_steps(h: float, E: float) -> None:
    plain = march(pendulum(h, 6, E, INTEGRATORS[2], NEWTON))
    snapshots = {b.name: plain.block(b.name).T.copy() for b in plain.model.layout}
    found = differences(
        march(pendulum(h, 6, E, INTEGRATORS[2], ATOMS), snapshots=snapshots), plain)
    assert found["bar.rigid"] < 1e-9 and found["bar.elastic"] < 1e-7, found


@pytest.mark.full
def test_the_textbook_takes_the_first_step_of_the_double_pendulum_at_5e_5_s() -> None:
    """Positions of 1 m, rounded to 1e-16 m, bend links that have moved by 1e-8 m."""
    small = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
             "time.step": 5e-5, "time.end": 5e-5, "training.end": 5e-5}
    plain = march(load("double_pendulum", {**small, "reducer": NEWTON}))
    fast = march(load("double_pendulum", {**small, "reducer": "full"}))
    assert max(differences(fast, plain)[f"link{i}.elastic"] for i in (1, 2)) < 1e-6


SOFT = {"use": "generalized_alpha", "rho_inf": 0.8}


def soft_bar(reducer: Any, steps: int) -> Scene:
    """Rubber on a pin, so soft that terms quadratic in its displacements decide."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "fields": ["elastic"],
            "reference": {"chord": ["bottom_left", "bottom_right"]},
            "mesh": {"use": "rectangle", "lower": [0.0, -0.04], "size": [0.4, 0.08],
                     "divisions": [8, 2]},
            "thickness": 0.02, "material": {"E": 3e5, "nu": 0.3, "rho": 1100}}},
        "joints": {"pin": {"use": "revolute", "between": ["ground", "bar:left"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": steps * 1e-3, "step": 1e-3}, "integrator": SOFT, "reducer": reducer})


@pytest.mark.full
def test_steps_that_do_not_converge_are_solved_with_the_exact_jacobian() -> None:
    """The run ended at 0.04 s; now its end is that of a run by the textbook's method from there."""
    result = simulate(soft_bar({"use": "full"}, 45))
    (note,) = [n for n in result.summary["information"] if "exact Jacobian" in n]
    count = int(note.split()[0])
    assert result.summary["status"] == "done" and 1 <= count < 45
    assert f"{count} of 45 steps" in note
    assert max(corrections(soft_bar({"use": "full"}, 45), 3)) < 1e-10


def test_estimates_of_the_error_rely_on_two_changes_of_one_part() -> None:
    assert estimated_error(1e-8, float("inf")) == 1e-8  # nothing to compare with
    assert estimated_error(1e-8, 2e-8) == 1e-8  # contracts poorly
    assert estimated_error(1e-8, 1e-7) == pytest.approx(1e-9 / 0.9)
    assert estimated_error(1e-15, 1e-3) == pytest.approx(1e-17 / 0.99)  # not 1e-27
