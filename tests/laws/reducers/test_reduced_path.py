"""Sparse steps without the solve on the support, and the supports that selections start from."""

from typing import Any

import numpy as np
import pytest

from small_scenes import everything, tiny
from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import load
from sparsemor.core.testing.in_memory_run import march
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.reducers.sparse.reducer import Sparse


@pytest.mark.full
def test_mechanics_are_solved_when_only_heat_selects() -> None:
    """Without polish the sparse solver's own solution is taken, but only where it solved."""
    scene = load("double_pendulum", {"time.end": 0.03})
    full = march(scene.using({"reducer": "full"}))
    snapshots = {n: full.block(n).T for n in full.model.reducible()}
    budgets = {"*.elastic": {"rows": 240}, "*.thermal": {"rows": 80, "atoms": 4}}
    run = march(scene.using({"reducer": {
        "use": "sparse", "basis": "pod", "selection": "joint", "polish": False,
        "budgets": budgets}}),
        model=full.model, snapshots=snapshots)
    angles = np.abs(full.x[:, [2, 5]] - run.x[:, [2, 5]]).max()
    assert angles < 1e-6 * np.abs(np.diff(full.x[[0, -1]][:, [2, 5]], axis=0)).max()


@pytest.mark.full
def test_local_heat_needs_the_solve_on_the_support() -> None:
    """The selection is linear: without polish radiation would be dropped in silence."""
    model = assemble(everything())
    options = {"budgets": {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0, "atoms": 2}}}
    assert not Sparse.model_validate(options).check(model)
    faults = Sparse.model_validate({**options, "polish": False, "selection": "joint"}).check(model)
    assert [f.key for f in faults] == ["polish"] and "radiation" in faults[0].message


@pytest.mark.full
def test_the_support_a_selection_starts_from_may_differ_by_block(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """`carried` by block pattern: heat starts from no atoms in each step, displacements from those
    of the previous step."""
    starts: dict[str, list[bool]] = {}
    solve = GreedyGaussNewton.solve

    def watched(self: Any, problem: Any, start: Any) -> Any:
        for g in problem.groups:
            if g.budget is not None:
                starts.setdefault(g.name, []).append(bool(start.support[g.start : g.stop].any()))
        return solve(self, problem, start)

    monkeypatch.setattr(GreedyGaussNewton, "solve", watched)
    scene = tiny()
    reference = march(scene.using({"reducer": "full"}))
    snapshots = {n: reference.block(n).T for n in reference.model.reducible()}
    options = {"use": "sparse", "basis": {"use": "pod", "count": 4}, "selection": "joint",
               "polish": False, "carried": {"*.thermal": False},
               "budgets": {"*.elastic": {"rows": 20, "atoms": 2},
                           "*.thermal": {"rows": 10, "atoms": 2}}}
    march(scene.using({"reducer": options}), model=reference.model, snapshots=snapshots)
    assert starts["bar.elastic"][0] is False and all(starts["bar.elastic"][1:])
    assert len(starts["bar.thermal"]) > 2 and not any(starts["bar.thermal"])
    polished = {**options, "polish": True, "carried": {"*.thermal": False, "*.colour": True}}
    polished.pop("use")
    faults = Sparse.model_validate(polished).check(assemble(scene))
    assert [f.key.split(".")[0] for f in faults] == ["carried", "carried"]


def test_without_polish_the_joint_problem_is_needed() -> None:
    options = {"budgets": {"*.elastic": {"rows": 8}}, "polish": False}
    faults = Sparse.model_validate(options).check(assemble(tiny()))
    assert [f.key for f in faults] == ["selection"] and "selection: joint" in faults[0].message
