"""Reduced steps, trained on the run that they repeat, give it back on a scene with everything."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded
from small_scenes import everything, tiny
from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import load
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.reducers.sparse.reducer import Sparse

# every row that a joint or load touches is kept; a few more of the elastic ones
ROWS = {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0}}


@cache
def full() -> March:
    return march(everything())


@pytest.mark.full
@pytest.mark.parametrize("centred", [False, True], ids=["plain", "centred"])
@pytest.mark.parametrize("options", [{"use": "galerkin"}, {"use": "sparse", "budgets": ROWS}],
                         ids=["galerkin", "sparse"])
def test_every_block_is_given_back(options: dict[str, Any], centred: bool) -> None:
    """Joints, loads, radiation, fixed frames and given temperatures survive trial and test maps,
    with displacements counted from the mean of the training run as well."""
    reference = full()
    snapshots = {name: reference.block(name).T for name in reference.model.reducible()}
    reducer = {**options, "basis": {"use": "pod", "centred": centred}}
    run = march(everything().using({"reducer": reducer}), snapshots=snapshots)
    bounds = {"rigid": 1e-11, "elastic": 1e-8, "thermal": 1e-11, "multiplier": 1e-7}
    for b in reference.model.layout:
        want = reference.block(b.name)
        error = np.abs(decoded(run, b.name) - want)[1:].max() / np.abs(want).max()
        assert error < bounds[b.field], b.name
    sizes = {n: d.atoms.shape for n, d in run.solver.dictionaries.items()}
    assert set(sizes) == set(snapshots)
    assert any(k < n for n, k in sizes.values())


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


def test_local_heat_needs_the_solve_on_the_support() -> None:
    """The selection is linear: without polish radiation would be dropped in silence."""
    model = assemble(everything())
    options = {"budgets": {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0, "atoms": 2}}}
    assert not Sparse.model_validate(options).check(model)
    faults = Sparse.model_validate({**options, "polish": False, "selection": "joint"}).check(model)
    assert [f.key for f in faults] == ["polish"] and "radiation" in faults[0].message


def test_without_polish_the_joint_problem_is_needed() -> None:
    options = {"budgets": {"*.elastic": {"rows": 8}}, "polish": False}
    faults = Sparse.model_validate(options).check(assemble(tiny()))
    assert [f.key for f in faults] == ["selection"] and "selection: joint" in faults[0].message
