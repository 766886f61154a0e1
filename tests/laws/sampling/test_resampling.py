"""Rows that are drawn anew: when, which, and that a stopped run goes on with the same ones."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import simulate
from sparsemor.core import StepSolver
from sparsemor.core.arrays import IntArray
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.results.checkpoint import Saved
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.time_stepping import FixedStep, accepted_steps, started
from sparsemor.core.testing.in_memory_run import march
from tiers import quick
from tiny_scene import BUDGETS, FIXED, full, prepared, snapshots


def reduced(**options: Any) -> Scene:
    return tiny().using({"reducer": {
        "use": "sparse", "basis": {"use": "pod", "count": 14}, "budgets": FIXED, **options}})


class Going:
    """A run that can be stopped and gone on with."""

    def __init__(self, scene: Scene, solver: StepSolver | None = None) -> None:
        self.scene, self.solver = scene, solver or prepared(scene)
        self.state, self.memory = started(
            self.solver, scene.integrator, consistent_state(full().model))
        self.rows: list[dict[str, IntArray]] = []

    def steps(self, count: int) -> "Going":
        h = self.scene.time.step
        step = FixedStep.of(self.scene.integrator, self.solver, h)
        for taken in accepted_steps(step, self.state, self.memory, count, h):
            self.state, self.memory = taken.state, taken.memory
            self.rows.append(dict(self.solver.rows_at(self.memory)))
        return self


SETS: list[dict[str, Any]] = [{"resample": 3, "row_sets": 3}, {"resample": 3}]
IDS = ["three sets in turn", "always new"]


@pytest.mark.parametrize("budgets", quick([FIXED, BUDGETS], BUDGETS), ids=["fixed", "selecting"])
@pytest.mark.parametrize("options", quick(SETS, SETS[0]), ids=IDS)
def test_rows_change_every_n_steps(options: dict[str, Any], budgets: dict[str, Any]) -> None:
    run = Going(reduced(budgets=budgets, **options)).steps(20)
    first = prepared(reduced(budgets=budgets)).rows
    for name, rows in first.items():
        np.testing.assert_array_equal(run.solver.rows[name], rows)
        seen = [r[name].tobytes() for r in run.rows]
        assert seen[0] == rows.tobytes()
        changes = [i for i in range(1, 20) if seen[i] != seen[i - 1]]
        assert changes == [3, 6, 9, 12, 15, 18]
        assert len(set(seen)) == (3 if "row_sets" in options else 7)
        if "row_sets" in options:
            assert seen[9] == seen[0] and seen[12] == seen[3]
        required = full().model.required[name]
        assert all(np.isin(required, r[name]).all() for r in run.rows)
    assert run.solver.counters(run.memory)["resamplings"] == 6


@pytest.mark.full
@pytest.mark.parametrize("budgets", [FIXED, BUDGETS], ids=["fixed", "selecting"])
@pytest.mark.parametrize("options", SETS, ids=IDS)
def test_a_resampled_run_goes_on_from_its_memory(
    options: dict[str, Any], budgets: dict[str, Any]
) -> None:
    """Stored between two changes, in another process's place: a new solver, the same bits."""
    scene = reduced(budgets=budgets, **options)
    want = Going(scene).steps(20)
    run = Going(scene).steps(10)
    stored = Saved.from_value(run.memory).dump()
    again = Going(scene, prepared(scene))
    again.state, again.memory = run.state, Saved.load(stored).into(again.memory)
    again.steps(10)
    np.testing.assert_array_equal(again.state.x, want.state.x)
    for a, b in zip(again.rows, want.rows[10:], strict=True):
        assert all(np.array_equal(a[n], b[n]) for n in b)


@pytest.mark.full
@pytest.mark.parametrize("options", SETS, ids=IDS)
def test_resampled_rows_give_the_run_back(options: dict[str, Any]) -> None:
    run = march(reduced(**options | {"resample": 1}), model=full().model, snapshots=snapshots())
    for name in full().model.reducible():
        d, want = run.solver.dictionaries[name], full().block(name)
        got = d.offset + run.block(name) @ d.atoms.T
        assert np.abs(got - want)[1:].max() < 1e-4 * np.abs(want - want[0]).max(), name


class Rows:
    """Hears which rows were drawn, and after which step."""

    def __init__(self) -> None:
        self.step, self.heard = 0, []  # type: tuple[int, list[tuple[int, str]]]

    @hookimpl
    def on_finish(self) -> None:
        self.step = 0  # of the training run

    @hookimpl
    def on_step(self, step: int) -> None:
        self.step = step

    @hookimpl
    def on_resample(self, block: str, rows: IntArray) -> None:
        assert len(rows)
        self.heard.append((self.step, block))


@pytest.mark.full
def test_observers_hear_of_new_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    rows = Rows()
    scene = reduced(resample=4, row_sets=2).using({"time.end": 0.01, "training.end": 0.04})
    simulate(scene, out=tmp_path / "run", observers=[rows])
    blocks = ["bar.elastic", "bar.thermal"]
    # the rows of a step are told before the step itself
    assert sorted(rows.heard) == [(n, b) for n in (0, 4, 8) for b in blocks]
