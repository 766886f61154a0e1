"""A body of somebody else, written to the documented protocols with public names alone, runs at
full order, reduced, and in two stages."""

import ast
from pathlib import Path

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.testing import check_parts
from tiers import full

SOURCE = Path(__file__).parents[1] / "support" / "own_rod.py"
CELLS, CAPACITY, CONDUCTANCE, POWER, STEP, END = 12, 2.0, 3.0, 5.0, 0.05, 1.0
SCENE = f"""\
format: 1
bodies:
  rod: {{use: rod, cells: {CELLS}, capacity: {CAPACITY}, conductance: {CONDUCTANCE},
        power: {POWER}}}
  stone: {{use: rigid, mass: 1.0, inertia: 1.0}}
loads:
  weight: {{use: gravity}}
time: {{end: {END}, step: {STEP}}}
integrator: bdf1
"""


@pytest.fixture
def scene(distribute, here) -> Path:
    distribute("rod-pkg", {"body": {"rod": "own_rod:Rod"}}, own_rod=SOURCE.read_text())
    path = Path("rod.yaml")
    path.write_text(SCENE)
    return path


def temperatures() -> np.ndarray:
    """(steps + 1, n) by implicit Euler steps of the same equations."""
    n = CELLS
    D = np.diff(np.eye(n), axis=0)
    A = CAPACITY / STEP * np.eye(n) + CONDUCTANCE * D.T @ D
    found = [np.zeros(n)]
    for _ in range(round(END / STEP)):
        found.append(np.linalg.solve(A, CAPACITY / STEP * found[-1] + POWER * np.eye(n)[0]))
    return np.array(found)


def test_it_imports_public_names_alone() -> None:
    tree = ast.parse(SOURCE.read_text())
    ours = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)
            and n.module is not None and n.module.startswith("sparsemor")}
    assert ours == {"sparsemor.core"}


@pytest.mark.full
@pytest.mark.parametrize("changes, tolerance", [
    ({}, 1e-12),
    full({"reducer": {"use": "galerkin", "basis": {"use": "pod", "energy": None}}}, 1e-9),
    ({"reducer": {"use": "sparse", "budgets": {"*": {"rows": 12}}}}, 1e-6),
    ({"rigid_stage": {}}, 1e-12),
    full({"rigid_stage": {}, "reducer": "galerkin"}, 1e-6),
], ids=["full", "galerkin", "sparse", "two stages", "two stages, galerkin"])
def test_it_runs_as_its_equations_say(scene, changes, tolerance) -> None:
    run = simulate(load(scene, changes))
    assert run.status.ok
    exact = temperatures()
    assert np.abs(run.block("rod.warmth") - exact).max() < tolerance * np.abs(exact).max()
    fallen = run.block("stone.rigid")[-1, 1] if "rigid_stage" not in changes else None
    assert fallen is None or fallen == pytest.approx(-9.81 / 2 * END * (END + STEP), rel=1e-9)


def test_it_keeps_the_laws_of_parts(scene) -> None:
    check_parts(load(scene))
