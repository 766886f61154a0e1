"""Chains, loops and trees of many bodies: joint forces are solved for with sparse matrices."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from joint_runs import ALPHA
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.reducers.step import jacobian_factors

G, MASS, LENGTH = 9.81, 1.5, 0.3
Tree = dict[str, Any]
GALERKIN = {"use": "galerkin", "basis": {"use": "modal", "count": 4}}


def rod(pose: Tree) -> Tree:
    return {"use": "rigid", "mass": MASS, "inertia": MASS * LENGTH**2 / 12,
            "center": [LENGTH / 2, 0.0], "points": {"left": [0.0, 0.0], "right": [LENGTH, 0.0]},
            "pose": pose}


def bar(pose: Tree) -> Tree:
    return {"use": "flexible", "fields": ["elastic"], "thickness": 0.03,
            "mesh": {"use": "rectangle", "lower": [0.0, -0.02], "size": [LENGTH, 0.04],
                     "divisions": [6, 2]},
            "material": {"E": 1e9, "nu": 0.3, "rho": 4000.0}, "damping": {"stiffness": 1e-4},
            "reference": {"clamp": "left"}, "pose": pose}


def links(angles: Sequence[float], body: Any = rod) -> tuple[Tree, Tree, FloatArray]:
    """Pinned links one after the other at these angles: bodies, joints, position of the end."""
    at, before, bodies, joints = np.zeros(2), "ground", {}, {}
    for i, angle in enumerate(angles):
        bodies[f"link{i}"] = body({"position": [float(x) for x in at], "angle": float(angle)})
        joints[f"pin{i}"] = {"use": "revolute", "between": [before, f"link{i}:left"]}
        before = f"link{i}:right"
        at = at + LENGTH * np.array([np.cos(angle), np.sin(angle)])
    return bodies, joints, at


def arch(n: int) -> tuple[Tree, Tree]:
    """A closed loop: links along half a circle, both ends pinned to the ground."""
    bodies, joints, _ = links(np.pi / 2 - np.pi * (np.arange(n) + 0.5) / n)
    joints["last"] = {"use": "revolute", "between": ["ground", f"link{n - 1}:right"]}
    return bodies, joints


def tree(n: int) -> tuple[Tree, Tree]:
    """Two links on the end of each link."""
    bodies: Tree = {}
    joints: Tree = {}
    ends = [(np.zeros(2), "ground")]
    for i in range(n):
        (at, before), angle = ends[i // 2 + i % 2], -np.pi / 2 + 0.4 * (-1) ** i + 0.01 * i
        bodies[f"link{i}"] = rod({"position": [float(x) for x in at], "angle": float(angle)})
        joints[f"pin{i}"] = {"use": "revolute", "between": [before, f"link{i}:left"]}
        ends.append((at + LENGTH * np.array([np.cos(angle), np.sin(angle)]), f"link{i}:right"))
    return bodies, joints


def run(
    bodies: Tree, joints: Tree, steps: int, h: float = 1e-3, integrator: Any = ALPHA,
    reducer: Any = "full",
) -> March:
    return march(scene_of({
        "bodies": bodies, "joints": joints, "integrator": integrator, "reducer": reducer,
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -G]}},
        "time": {"end": steps * h, "step": h}}))


def rigid(done: March) -> FloatArray:
    return done.x[:, done.solver.layout.frames]


@pytest.mark.parametrize("kind", ["arch", "tree"])
@pytest.mark.full
def test_loops_and_trees_move_as_with_the_textbook_method(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with dense matrices, and as with Newton's method for all unknowns."""
    bodies, joints = arch(12) if kind == "arch" else tree(15)
    monkeypatch.setattr(jacobian_factors, "MANY", 20)
    sparse = run(bodies, joints, 10)
    newton = run(bodies, joints, 10, reducer={"use": "full", "method": "newton"})
    monkeypatch.setattr(jacobian_factors, "MANY", 10**6)
    dense = run(bodies, joints, 10)
    moved = np.abs(rigid(dense) - rigid(dense)[0]).max()
    assert moved > 1e-4
    for other in (dense, newton):
        assert np.abs(rigid(sparse) - rigid(other)).max() < 1e-9 * moved
    assert sparse.iterations == dense.iterations


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["full", GALERKIN])
def test_flexible_chains_bend_as_with_dense_matrices(
    reducer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies, joints, _ = links([-np.pi / 2 + 0.05 * i for i in range(12)], bar)
    monkeypatch.setattr(jacobian_factors, "MANY", 20)
    sparse = run(bodies, joints, 15, reducer=reducer)
    monkeypatch.setattr(jacobian_factors, "MANY", 10**6)
    dense = run(bodies, joints, 15, reducer=reducer)
    for name in dense.model.reducible():
        bent = np.abs(dense.block(name)).max()
        assert np.abs(sparse.block(name) - dense.block(name)).max() < 1e-8 * bent
    assert np.abs(sparse.a[0] - dense.a[0]).max() < 1e-10 * np.abs(dense.a[0]).max()
    # round-off decides on single iterations: 86 to 96 in all, by the kernel of BLAS
    assert sum(sparse.iterations) == pytest.approx(sum(dense.iterations), rel=0.1)
