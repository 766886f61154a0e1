"""Laws of the linearised one-step map, of the gate, and of the states they are asked at."""

from functools import cache
from math import inf
from typing import Any

import numpy as np
import pytest

from small_pendulum import small
from small_scenes import tiny
from sparsemor.core import ReducedProblem, StepSolver
from sparsemor.core.errors import PluginError
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.checkpoint import Saved
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.stages_before_steps import prepared_run
from sparsemor.core.simulation.time_stepping import started
from sparsemor.core.simulation.training import offline_of
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.testing.installed import installed
from sparsemor.plugins.stability.galerkin_reference import (
    linearization_times,
    states_along,
)
from sparsemor.plugins.stability.spectrum import eigenvalues, excess
from sparsemor.plugins.stability.stability_check import (
    Judgement,
    ReferenceModels,
    judge,
    over_the_run,
)
from sparsemor.plugins.stability.step_map import packed, step_map, unpacked

pytestmark = pytest.mark.usefixtures("one_cache")

INTEGRATORS = sorted(installed("integrator"))


@cache
def prepared(integrator: str, reducer: str) -> tuple[Scene, StepSolver, Any]:
    scene = small(integrator=integrator, **{"training.every": 1})
    if reducer == "galerkin":
        own = scene.dump()["reducer"]
        scene = scene.using({"reducer": {
            "use": "galerkin", "basis": own["basis"], "bases": own["bases"]}})
    model = checked_model(scene)
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, offline_of(scene, model, Products(Cache()),
        new_manager()), np.random.default_rng(1)))
    return scene, solver, model


# ------------------------------------------------------------------ the map


@pytest.mark.full
@pytest.mark.parametrize(("integrator", "reducer"), [
    (name, ("galerkin", "sparse")[i % 2]) for i, name in enumerate(INTEGRATORS)])
def test_the_map_moves_small_changes_as_a_step_does(integrator: str, reducer: str) -> None:
    """z + dz, stepped forth and back, against the map: only terms of third order are left."""
    scene, solver, model = prepared(integrator, reducer)
    rule, h, layout = scene.integrator, scene.time.step, solver.layout
    state, memory = started(solver, rule, consistent_state(model))
    before = Saved.from_value(memory).dump()
    step = step_map(solver, rule, h, state, memory)
    assert Saved.from_value(memory).dump() == before, "the solver's memory was written to"
    rng = np.random.default_rng(5)
    size = np.concatenate([step.scale, step.scale / h, step.scale / h**2])
    extra = len(step.matrix) // layout.size - 3
    size = np.concatenate([size, np.tile(step.scale, extra)])

    def after(dz: Any) -> Any:
        moved = unpacked(packed(state) + dz, state)
        formula = step_formula(rule.rules(h), layout, moved, h)
        outcome, _ = solver.solve(formula, memory.copy())
        assert outcome.status.ok
        return packed(advanced(rule.rules(h), layout, moved, formula, outcome))

    dz = 1e-6 * rng.standard_normal(len(size)) * size
    multipliers = np.concatenate([step.components(b.name) for b in layout
                                  if b.field == "multiplier"])
    dz[multipliers] = 0.0
    moved = (after(dz) - after(-dz)) / 2.0
    state_part = np.setdiff1d(np.arange(len(size)), multipliers)
    error = np.abs(moved - step.matrix @ dz)[state_part]
    rule_part, S = step.integrator, np.abs(step.response)
    terms = np.abs(rule_part.P) @ np.abs(dz)  # what was added up, before anything cancels
    terms = (terms + np.abs(rule_part.Q) @ S @ np.abs(rule_part.R) @ np.abs(dz))[state_part]
    size[3 * layout.size :] /= h**2  # rates, in some rules
    noise = 1e-10 * size[state_part]  # at which the solver stops, and what becomes of it
    assert (error / (1e-5 * terms + noise)).max() < 1.0


@pytest.mark.full
def test_a_selecting_model_is_linearised_on_the_support_that_it_takes() -> None:
    scene = small(**{"reducer.solver": "greedy_gauss_newton"})
    scene = scene.using({"reducer.budgets": {"*.elastic": {"rows": 60, "atoms": 6},
                                             "*.thermal": {"rows": 30, "atoms": 4}}})
    model = checked_model(scene)
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, offline_of(scene, model, Products(Cache()),
        new_manager()), np.random.default_rng(1)))
    step = step_map(solver, scene.integrator, scene.time.step,
                    *started(solver, scene.integrator, consistent_state(model)))
    sizes = {b.name: b.size for b in step.layout}
    for link in ("link1", "link2"):
        assert 1 <= sizes[f"{link}.elastic"] <= 6 and 1 <= sizes[f"{link}.thermal"] <= 4
        for field in ("elastic", "thermal"):
            assert step.supports[f"{link}.{field}"].sum() == sizes[f"{link}.{field}"]
    found = judge(solver, scene.integrator, scene.time.step, 100, consistent_state(model),
                  ReferenceModels(model))
    assert np.isfinite(found.radius) and found.radius > 0.9


# ------------------------------------------------------------------ eigenvalues and excess


@pytest.mark.parametrize("seed", range(4))
def test_eigenvalues_by_parts_are_all_eigenvalues(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = np.zeros((12, 12))
    edges = [0, 3, 4, 9, 12]
    for i, j in zip(edges, edges[1:], strict=False):
        A[i:j, i:] = rng.standard_normal((j - i, 12 - i))
    order = rng.permutation(12)
    A = A[np.ix_(order, order)]
    found, known = eigenvalues(A), np.linalg.eigvals(A)
    assert np.all(np.diff(np.abs(found)) <= 1e-12)
    for value in known:
        assert np.abs(found - value).min() < 1e-8
    assert len(found) == 12


@pytest.mark.parametrize("seed", range(4))
def test_excess_charges_only_what_the_reference_does_not_have(seed: int) -> None:
    rng = np.random.default_rng(seed)
    inner = 0.9 * rng.random(10) * np.exp(2j * np.pi * rng.random(10))
    growing = 1.0 + 1e-3 * np.array([4.0, 4.0, 2.0]) + 1e-4j * np.array([3.0, -3.0, 0.0])
    reference = _sorted(np.concatenate([inner, growing]))
    shift = 1e-6 * rng.standard_normal(13)
    assert excess(reference, reference)[0] <= 0.0
    assert excess(_sorted(reference + shift), reference)[0] < 4e-6
    spurious = 1.0 + 1e-2 * rng.random()
    own, which = excess(_sorted(np.concatenate([reference + shift, [spurious]])), reference)
    assert own == pytest.approx(spurious - 1.0, abs=1e-5) and which == spurious
    assert excess(reference, None)[0] == pytest.approx(abs(reference[0]) - 1.0)


def _sorted(values: Any) -> Any:
    return values[np.argsort(-np.abs(values))]


# ------------------------------------------------------------------ over the run


def judgement(t: float, excess: float) -> Judgement:
    return Judgement(t, 1000, 1.0 + excess, 1.0, excess, "link1.thermal" if excess else "")


def test_growth_adds_up_over_the_parts_of_the_run() -> None:
    """Five states of a run of 1000 steps: those at the ends stand for an eighth of it."""
    t = [0.0, 0.25, 0.5, 0.75, 1.0]
    found = over_the_run([judgement(*pair) for pair in zip(t, [0, 0, 0.04, 0.1, 0], strict=True)])
    assert found.gate == pytest.approx(1000 * (0.25 * 0.04 + 0.25 * 0.1))
    assert (found.t, found.radius) == (0.75, 1.1) and not found.stable
    quiet = over_the_run([judgement(time, 1e-4 * (time == 0.0)) for time in t])
    assert quiet.gate == pytest.approx(1000 * 1e-4 / 8) and quiet.stable
    alone = over_the_run([judgement(0.0, 0.01)])
    assert alone.gate == pytest.approx(10.0)
    broken = over_the_run([judgement(0.0, 0.0), judgement(0.5, inf), judgement(1.0, 0.0)])
    assert broken.gate == inf and broken.t == 0.5


@pytest.mark.full
def test_a_run_is_looked_at_from_its_start_to_its_end() -> None:
    assert linearization_times(1e-3, 100) == pytest.approx((0.0, 0.025, 0.05, 0.075, 0.1))
    assert linearization_times(1e-3, 2) == pytest.approx((0.0, 1e-3, 2e-3))
    assert linearization_times(1e-3, 10**6)[-1] == pytest.approx(4.0), "no further than 4000 steps"
    scene, solver, model = prepared("bdf1", "sparse")
    states = states_along(model, scene.integrator, 1e-3, solver, consistent_state(model),
                    linearization_times(1e-3, 100))
    assert [s.t for s in states] == pytest.approx([0.0, 0.025, 0.05, 0.075, 0.1])
    alpha, of_alpha, its_model = prepared("generalized_alpha", "sparse")
    few = states_along(its_model, alpha.integrator, 1e-3, of_alpha, consistent_state(its_model),
                       linearization_times(1e-3, 100))
    assert len(few) == 1, "integrators that damp little: the start alone"
    at = model.layout["link1.rigid"]
    truth = simulate(scene.using({"reducer": "full"}), cache=Cache()).block("link1.rigid")[-1]
    np.testing.assert_allclose(states[-1].x[at], truth, atol=1e-8)


@pytest.mark.full
def test_states_of_a_training_run_under_other_loads_are_taken(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """No other run is made for the states about which a model is linearised."""
    def along(*given: Any) -> None:
        raise AssertionError("a run of the Galerkin model")

    monkeypatch.setattr("sparsemor.plugins.stability.galerkin_reference.along", along)
    plain = {"reducer": {"use": "sparse", "residual": "plain", "basis": {"use": "pod", "count": 6},
                         "budgets": {"*": {"rows": 20}}}}
    other = tiny().using({**plain, "training.overrides": {"loads.gravity.g": [0.0, -5.0]}})
    assert prepared_run(other, Cache(None), new_manager())[0].summary["stability"]["stable"]
    mass = tiny().using({**plain, "training.overrides": {"bodies.bar.thickness": 0.03}})
    with pytest.raises(PluginError, match="Galerkin"):
        prepared_run(mass, Cache(None), new_manager())
