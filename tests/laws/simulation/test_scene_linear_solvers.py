"""The scene's linear solvers serve full order, training, bases and the start; they say so."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state, solve_by_blocks
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed, Status

pytestmark = pytest.mark.full

SCENES = Path(__file__).parents[2] / "scenes"
FULL = {"reducer": "full", "training": {}}


def spatial(**changes: Any) -> Scene:
    """Bars and wheels in space, radiation on one: general frames and a local term."""
    return load(SCENES / "everything_in_space.yaml", {"reducer": "full", **changes})


def disk(**changes: Any) -> Scene:
    """A heated disk of some 1300 tetrahedra, full order."""
    return load(SCENES / "heated_disk.yaml", {
        "reducer": "full", "bodies.disk.mesh.refine": 0.5, "time.end": 1e-2, **changes})


def ran(scene: Scene, tmp_path: Path) -> RunResult:
    return simulate(scene, cache=Cache(tmp_path / "cache"))


def iterations(run: RunResult) -> dict[str, float]:
    return {e["block"]: e["iterations_a_step"] for e in run.summary["linear_solvers"]
            if "iterations_a_step" in e}


def test_iterative_and_direct_solvers_give_one_motion(tmp_path: Path) -> None:
    """In a moving frame with joints and radiation; iterated to 1e-10 of each right-hand side."""
    direct = ran(spatial(linear_solver="splu"), tmp_path)
    run = ran(spatial(linear_solver="cg"), tmp_path)
    assert run.status is Status.DONE
    for b in direct.layout:
        want, got = direct.block(b.name), run.block(b.name)
        assert np.abs(got - want).max() <= 1e-6 * np.abs(want).max(), b.name
    assert set(iterations(run)) == {"bar.elastic", "bar.thermal"}
    assert not iterations(direct)


def test_solvers_by_block_pattern_and_what_is_said_of_them(tmp_path: Path) -> None:
    run = ran(spatial(linear_solvers={"*.thermal": "cg"}), tmp_path)
    told = {e["block"]: e for e in run.summary["linear_solvers"] if e["for"] == "steps"}
    assert told["bar.thermal"]["solver"] == "cg" and told["bar.elastic"]["solver"] == "splu"
    assert told["bar.elastic"]["memory_gb"] > 0 and told["bar.elastic"]["factor_s"] > 0
    assert told["bar.elastic"]["why"].startswith("splu:")
    with pytest.raises(InputError, match="fits no block") as error:
        checked_model(spatial(linear_solvers={"*.thermic": "cg"}))
    assert error.value.faults[0].key == "linear_solvers.*.thermic"


def test_a_solver_that_stops_short_fails_the_step_by_name(tmp_path: Path) -> None:
    with pytest.raises(SolveFailed) as failed:
        ran(disk(linear_solvers={"*.thermal": {"use": "cg", "max_iterations": 1}}), tmp_path)
    assert failed.value.status is Status.NOT_CONVERGED
    assert failed.value.block == "disk.thermal" and failed.value.time > 0
    assert "linear solver cg left" in failed.value.detail
    # displacements already where D^-1 of the directions is made
    with pytest.raises(SolveFailed) as failed:
        ran(spatial(linear_solvers={"*.elastic": {"use": "cg", "max_iterations": 2}}), tmp_path)
    assert failed.value.status is Status.NOT_CONVERGED and failed.value.block == "bar.elastic"


def test_training_and_bases_are_solved_by_the_same(tmp_path: Path) -> None:
    scene = disk(linear_solver="cg", reducer={"use": "galerkin", "bases": {"*.elastic": "static"}})
    run = ran(scene, tmp_path)
    told = {(e["block"], e["for"]): e["solver"] for e in run.summary["linear_solvers"]}
    assert told[("disk.elastic", "training run, steps")] == "cg"
    direct = ran(scene.using({"linear_solver": "splu"}), tmp_path)
    got, want = run.probe("rim")[:, 3:], direct.probe("rim")[:, 3:]
    assert (np.abs(got - want).max(axis=0) <= 1e-5 * np.abs(want).max()).all()


def test_large_blocks_are_eliminated_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Consistent accelerations do not depend on whether blocks are solved on their own."""
    from sparsemor.core.model import initial_state as eliminated

    for scene in (spatial(), load(SCENES / "everything.yaml", FULL)):
        whole = consistent_state(assemble(scene))
        monkeypatch.setattr(eliminated, "FEW", 0)
        model = assemble(scene)
        parts = consistent_state(model)
        monkeypatch.undo()
        assert {f.purpose for f in model.solvers.log} == {"start"}
        for a, b in ((whole.a, parts.a), (whole.v, parts.v), (whole.x, parts.x)):
            np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-9 * max(np.abs(a).max(), 1e-300))


def test_a_singular_whole_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from scipy.sparse import csr_array, eye_array

    from sparsemor.core.model import initial_state as eliminated

    monkeypatch.setattr(eliminated, "FEW", 0)
    model = assemble(spatial())
    A = eye_array(model.layout.size, format="lil")
    A[0, 0] = 0.0
    with pytest.raises(RuntimeError):
        solve_by_blocks(model, csr_array(A), np.ones(model.layout.size))
