"""Online error estimate: its time steps, its residual, its cost, and its record along a run."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reduced_runs import errors, estimates, learnt, model_of, states
from small_scenes import everything, tiny
from sparsemor import load, load_model, reduce
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.results.checkpoint import Saved
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.error_record import ErrorRecord
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.plugins.charts.error_over_time import error_over_time_figure
from sparsemor.plugins.comparison.compare import compare
from sparsemor.plugins.comparison.error_norms import measure_errors
from sparsemor.reducers.estimation import (
    coupled_errors,
    error_space,
    estimate_interval,
    modal_steps,
)
from sparsemor.reducers.estimation.coupled_errors import CoupledErrors
from sparsemor.reducers.estimation.reduced_states import Projected
from sparsemor.reducers.estimation.residuals import ElasticResidual


def reduced_scene(scene: Scene, **reducer: Any) -> Scene:
    return scene.using({"reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 3}, **reducer}})


@cache
def reduced() -> tuple[Scene, March]:
    """A hinged, heated bar on three atoms for each field."""
    full = march(tiny().using({"reducer": "full"}))
    scene = reduced_scene(tiny())
    return scene, march(scene, model=full.model, snapshots=learnt(full))


@pytest.mark.full
def test_steps_may_be_evaluated_together_or_one_by_one_or_resumed() -> None:
    scene, run = reduced()
    model, known = model_of(scene, run), states(run)
    start = consistent_state(run.model)
    whole = ErrorRecord(model, start, known[0])
    for i, s in enumerate(known[1:], 1):
        whole.take(s, i)
        whole.store()
    together = whole.stored()
    one = ErrorRecord(model, start, known[0])
    found: dict[str, list[float]] = {n: [] for n in model.blocks}
    for i, s in enumerate(known[1:], 1):
        one.take(s, i)
        one.store()
        for n, values in one.stored().items():
            found[n] += values.tolist()
        saved = Saved.from_value(one.carried())
        one = ErrorRecord(model, start, known[0])
        one.resume(saved.into(one.carried()), len(s.x))
    for n in model.blocks:
        assert found[n] == pytest.approx(together[n], rel=1e-9)
        assert np.ptp(found[n]) > 0.0


@pytest.mark.full
def test_between_estimates_the_last_one_counts() -> None:
    scene, run = reduced()
    model, known = model_of(scene, run, every=2), states(run)
    record = ErrorRecord(model, consistent_state(run.model), known[0])
    for i, s in enumerate(known[1:6], 1):
        record.take(s, i)
        record.store()
    for values in record.stored().values():
        assert values[1] == values[2] != values[3] == values[4]


@pytest.mark.full
def test_a_result_has_the_estimate_at_its_stored_steps() -> None:
    scene = reduced_scene(tiny(), error_estimate=1).using({"output": {"every": 2}})
    result = simulate(scene)
    assert set(result.error_estimates) == {"bar.rigid", "bar.elastic", "bar.thermal"}
    for name in result.error_estimates:
        assert result.error_estimate(name).shape == result.times.shape
        assert (result.error_estimate(name)[1:] > 0.0).all()
        assert 0.0 < result.summary["error_estimate"][name] < np.inf
    assert "estimated_error" not in result.summary["note_kinds"]
    assert simulate(reduced_scene(tiny())).error_estimates == ()


@pytest.mark.full
def test_a_kept_run_with_other_loads_has_an_estimate_and_one_from_a_file_says_no(
    tmp_path: Path,
) -> None:
    scene = reduced_scene(tiny(), error_estimate=1)
    model = reduce(scene)
    other = {"loads.heating.flux": {"use": "ramp", "end": 0.02, "final": -5e5}}
    model.save(tmp_path / "bar.model")
    changed, read = model.run(other), load_model(tmp_path / "bar.model").run()
    turned = model.run(initial={"bar.rigid": ([0.0, 0.0, 0.1], [0.0, 0.0, 0.0])})
    assert not read.error_estimates and not turned.error_estimates
    assert [sum("error_estimate has no effect" in n for n in r.summary["notes"])
            for r in (changed, read, turned)] == [0, 1, 1]
    full = simulate(scene.using({**other, "reducer": "full"}))
    ratio = compare(full, kept=changed).effectivity["kept"]
    assert set(changed.error_estimates) == {"bar.rigid", "bar.elastic", "bar.thermal"}
    assert all(0.7 < ratio[n] < 1.5 for n in changed.error_estimates), ratio
    own = compare(simulate(scene.using({"reducer": "full"})), kept=model.run()).effectivity["kept"]
    assert all(0.7 < own[n] < 1.5 for n in changed.error_estimates), "the model is as it was"


@pytest.mark.full
def test_a_large_estimate_is_a_warning() -> None:
    """Two vibration modes do not represent the expansion of a heated bar."""
    scene = reduced_scene(tiny(), error_estimate=1).using({
        "reducer.bases": {"*.elastic": {"use": "modal", "count": 2}}})
    result = simulate(scene)
    worst = result.summary["error_estimate"]["bar.elastic"]
    assert worst > 0.1 and "estimated_error" in result.summary["note_kinds"]
    assert any(f"estimated error of bar.elastic reaches {worst:.2g} of" in note
               for note in result.summary["notes"])


@cache
def beam() -> Scene:
    """A cantilever of two atoms under a force that acts suddenly at the start."""
    return load(Path(__file__).parents[3] / "docs/examples/cantilever.yaml", {
        "bodies.beam.mesh.divisions": [16, 2], "loads.pull.factor": 1.0,
        "time": {"end": 0.02, "step": 1e-4},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 2}}})


@pytest.mark.full
@pytest.mark.parametrize("every", [1, "on"])
def test_a_load_from_the_start_does_not_let_the_estimate_vibrate(every: int | str) -> None:
    """The initial accelerations of a reduced model are those of its own equations. Their projection
    that is orthogonal without the mass gave estimates hundreds of times too large."""
    full = simulate(beam().using({"reducer": "full"}))
    run = simulate(beam().using({"reducer.error_estimate": every}))
    e = measure_errors(full, run)
    assert e.series["beam.elastic"].max() > 1e-5
    assert 0.5 < e.effectivity["beam.elastic"] < (1.5 if every == 1 else 10.0)


@pytest.mark.full
@pytest.mark.parametrize("few", [False, True])
def test_a_force_that_acts_suddenly_on_a_joined_body_is_estimated(few: bool) -> None:
    """The right value is the error against the full-order run, at each estimate; with few of them
    the largest one up to then. The space of the errors contains the initial accelerations; without
    them estimates were up to 1900 times too large in such scenes, since each block's part of them
    did not fit the joint."""
    scene = tiny().using({
        "loads.push": {"use": "point_force", "on": "bar:end_b", "force": [40.0, 80.0]},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 3},
                    "error_estimate": "on" if few else 1}})
    scene = scene.using({"time.end": 200 * scene.time.step, "training.end": scene.time.end})
    full, run = simulate(scene.using({"reducer": "full"})), simulate(scene)
    e, every = measure_errors(full, run), int(run.attributes["estimates_every"])
    at = [n for n in range(1, 201) if n % every == 0 or few and modal_steps.begins(n, every, 4)]
    assert len(at) > 8
    low, high = (0.5, 10.0) if few else (0.9, 1.1)
    for block in ("bar.rigid", "bar.elastic"):
        true, guess = e.series[block], e.estimated[block]
        if few:
            true, guess = np.maximum.accumulate(true), np.maximum.accumulate(guess)
        quotients = guess[at][true[at] > 1e-6] / true[at][true[at] > 1e-6]
        assert len(quotients) and low < quotients.min() and quotients.max() < high, block


@pytest.mark.full
@pytest.mark.parametrize("scene", [tiny, beam], ids=["whole", "blocks"])
def test_few_estimates_cost_a_twentieth_of_the_steps(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By counts of residuals: each estimate has one, with the start of the run; those of its first
    steps, which are iterated, are not more than as many again."""
    counts = {"residuals": 0}

    def counted(kind: Any, name: str) -> None:
        method = getattr(kind, name)

        def count(self: Any, *arguments: Any) -> Any:
            counts["residuals"] += len(arguments[0].times) if kind is ElasticResidual else 1
            return method(self, *arguments)
        monkeypatch.setattr(kind, name, count)

    counted(CoupledErrors, "residual")
    counted(ElasticResidual, "__call__")
    small = scene().using({"reducer": {"use": "galerkin", "error_estimate": "on",
                                       "basis": {"use": "pod", "count": 2}}})
    small = small.using({"time.end": 200 * small.time.step, "training.end": small.time.end})
    run = simulate(small)
    price = estimate_interval.WHOLE if scene is tiny else estimate_interval.BLOCKS
    assert run.error_estimates
    first = 1 + modal_steps.FIRST * (coupled_errors.ITERATIONS if scene is tiny else 1)
    assert 0 < counts["residuals"] <= estimate_interval.SHARE * 200 / price + first


@pytest.mark.full
def test_kept_models_and_what_auto_chooses_have_an_estimate_unless_it_is_off() -> None:
    scene = reduced_scene(tiny())
    assert simulate(scene).error_estimates == ()
    assert set(simulate(scene, estimate=True).error_estimates) == {
        "bar.rigid", "bar.elastic", "bar.thermal"}
    assert reduce(scene).run().error_estimates
    assert not reduce(scene.using({"reducer.error_estimate": "off"})).run().error_estimates
    assert simulate(tiny().using({"reducer": "auto"})).error_estimates
    assert not simulate(tiny().using(
        {"reducer": {"use": "auto", "error_estimate": "off"}})).error_estimates


@pytest.mark.full
def test_a_comparison_puts_estimate_and_error_together() -> None:
    """In its table, its JSON text, and dotted in a band in the chart of errors over time."""
    full = simulate(tiny().using({"reducer": "full"}))
    run = simulate(reduced_scene(tiny(), error_estimate=1))
    comparison = compare(full, run=run, plain=simulate(reduced_scene(tiny())))
    e = comparison.measured["run"]
    assert set(comparison.effectivity) == {"run"}
    for name in ("bar.thermal", "bar.elastic"):
        ratio = comparison.effectivity["run"][name]
        assert 0.5 < ratio < 2.0
        assert ratio == pytest.approx(e.estimated[name].max() / e.series[name].max())
    assert "estimate / error" in str(comparison)
    assert json.loads(comparison.to_json())["runs"]["run"]["effectivity"]
    figure = error_over_time_figure(
        comparison.measured, {n: r.status for n, r in comparison.runs.items()},
        full.layout.kinds)
    assert figure is not None
    dotted = [line for axes in figure.axes for line in axes.lines
              if line.get_label() == "run, estimated"]
    assert len(dotted) == sum(len(axes.collections) for axes in figure.axes) == 3
    for axes in figure.axes:
        for band, line in zip(axes.collections, [n for n in axes.lines if n in dotted],
                              strict=False):
            y = np.asarray(line.get_ydata())[-1]
            edges = band.get_paths()[0].vertices[:, 1]
            assert np.isclose(edges, y / 10).any() and np.isclose(edges, 2 * y).any()


@pytest.mark.full
def test_every_block_of_every_kind_of_part_has_an_estimate() -> None:
    """Rigid and flexible bodies with all plane joints and loads, radiation among them."""
    scene, full = reduced_scene(everything()), march(everything())
    run = march(scene, model=full.model, snapshots=learnt(full))
    found = estimates(scene, run)
    assert set(found) == {b.name for b in full.model.layout.differential}
    for name, guess in found.items():
        true = errors(full, run, name)
        change = np.abs(full.block(name) - full.block(name)[0]).max()
        if true.max() > 1e-9 * change:
            assert 0.5 < guess.max() / true.max() < 10.0, name


@pytest.mark.full
def test_the_errors_of_an_arm_that_spins_fast_in_space_are_estimated() -> None:
    """An arm on a spherical joint at 80 rad/s, trained at 60 with other gravity; 0.8 rad in ten
    steps. One step of the error equation from one estimate to the next overflows here."""
    def arm(spin: float, g: float, end: float) -> Scene:
        return scene_of({
            "bodies": {"arm": {
                "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
                "mesh": {"use": "block", "size": [0.4, 0.04, 0.04], "divisions": [6, 1, 1]},
                "material": {"rho": 2700.0, "E": 7e10, "nu": 0.33}, "damping": {"stiffness": 1e-5},
                "sets": {"a": {"nearest": [0.0, 0.0, 0.0]}}, "pose": {"spin": [0.0, 3.0, spin]}}},
            "joints": {"O": {"use": "spherical", "between": ["ground", "arm:a"]}},
            "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -g]}},
            "time": {"end": end, "step": 1e-3},
            "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
            "reducer": {"use": "full"}})

    trained, scene = march(arm(60.0, 9.81, 0.1)), arm(80.0, 15.0, 0.3)
    full, other = march(scene), reduced_scene(scene, basis={"use": "pod", "count": 4})
    run = march(other, model=full.model, snapshots=learnt(trained))
    found = estimates(other, run, every=10)
    assert errors(full, run, "arm.rigid").max() > 1e-5
    for name in ("arm.rigid", "arm.elastic"):
        true = errors(full, run, name)[::10].max()
        assert 0.5 < found[name].max() / true < 2.0, name


HELD = {"bodies.bar.frame": "fixed", "bodies.bar.reference": {"clamp": "left"}, "joints": {}}


@pytest.mark.full
@pytest.mark.parametrize("held", [{}, HELD], ids=["free frame", "fixed frame"])
@pytest.mark.parametrize("atoms", [3, 8])
def test_a_complete_basis_has_an_estimate_on_its_leading_atoms(
    held: dict[str, Any], atoms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Atoms selected in each step from as many as unknowns, on a run with twice the heat: the space
    of the errors is small, and what the states have outside of it is an error."""
    monkeypatch.setattr(error_space, "COUNT", 8)
    monkeypatch.setattr(error_space, "COUPLED", 8)
    scene = tiny().using({"bodies.bar.mesh.divisions": [12, 4], **held, "reducer": {
        "use": "sparse", "basis": {"use": "pod", "complete": True}, "residual": "preconditioned",
        "sampler": {"use": "lhs", "required": False}, "hysteresis": 0.0,
        "budgets": {"*": {"rows": 40, "atoms": atoms}}}})
    trained = march(scene.using({"reducer": "full"}))
    other = scene.using({"loads.heating.flux": 2e6})
    full = march(other.using({"reducer": "full"}))
    run = march(other, model=full.model, snapshots=learnt(trained))
    model = model_of(other, run)
    blocks = ({b.name: (b.space, b.states) for b in model.spaces}
              if isinstance(model, CoupledErrors) else
              {b.name: (b.space, b.states) for b in (*model.heat, *model.elastic)})
    found = estimates(other, run)
    for name, (space, states_of) in blocks.items():
        n, k = run.solver.dictionaries[name].atoms.shape
        assert n == k and space.size <= atoms + 8 + 2 and isinstance(states_of, Projected)
        true = errors(full, run, name)
        print(name, n, space.size, true.max(), found[name].max() / true.max())
        assert 0.5 < found[name].max() / true.max() < 10.0, name
