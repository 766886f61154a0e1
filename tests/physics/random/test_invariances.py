"""Laws of random scenes: what does not matter to the motion does not change the numbers.

Chains of one to three rigid and flexible links with heat, all integrators (tests/support/
random_chains.py). A field is compared relative to its own largest change.
"""

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from random_chains import (
    STEP,
    Tree,
    chain,
    doubled,
    halved,
    in_units,
    moved,
    reordered,
    scene,
    turned,
)
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march

ALL = ("rigid", "elastic", "thermal")
TIERS = {24: (), 0: pytest.mark.full, 26: pytest.mark.full}
SEEDS = [pytest.param(s, marks=TIERS.get(s, pytest.mark.slow)) for s in range(0, 28, 2)]


@cache
def tree(seed: int) -> Tree:
    return chain(np.random.default_rng(seed))


@cache
def run(seed: int) -> March:
    return march(scene(tree(seed)))


def fields(run: March, kinds: tuple[str, ...] = ("elastic", "thermal")) -> dict[str, FloatArray]:
    """Block -> (T, n)."""
    return {b.name: run.block(b.name) for b in run.model.layout if b.field in kinds}


def differences(
    one: Mapping[str, FloatArray], other: Mapping[str, FloatArray], scale: float = 1.0
) -> dict[str, float]:
    """Largest difference of each block of `one` from scale * `other`, over its largest change."""
    return {n: float(np.abs(u - scale * other[n]).max()
                     / max(np.abs(u - u[0]).max(), 1e-9 * np.abs(u).max(), 1e-300))
            for n, u in one.items()}


def assert_equal(found: Mapping[str, float], bound: float) -> None:
    assert found and max(found.values()) < bound, found


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_place(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    by = tuple(float(x) for x in rng.uniform(-5, 5, 2))
    other = march(scene(moved(tree(seed), (by[0], by[1]))))
    assert_equal(differences(fields(run(seed)), fields(other)), 1e-7)


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_direction(seed: int) -> None:
    angle = float(np.random.default_rng(200 + seed).uniform(-3, 3))
    other = march(scene(turned(tree(seed), angle)))
    assert_equal(differences(fields(run(seed)), fields(other)), 1e-7)
    for name, pose in fields(run(seed), ("rigid",)).items():
        assert np.abs(other.block(name)[:, 2] - pose[:, 2] - angle).max() < 1e-8


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_units(seed: int) -> None:
    L, M, T = (float(10.0**p) for p in np.random.default_rng(300 + seed).uniform(-3, 3, 3))
    other = march(scene(in_units(tree(seed), L, M, T)))
    kinds = ("elastic",)
    assert_equal(differences(fields(run(seed), kinds), fields(other, kinds), 1 / L)
                 or {"rigid": 0.0}, 1e-7)
    assert_equal(differences(fields(run(seed), ("thermal",)), fields(other, ("thermal",)))
                 or {"rigid": 0.0}, 1e-7)


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_order_of_parts(seed: int) -> None:
    other = march(scene(reordered(tree(seed))))
    assert_equal(differences(fields(run(seed), ALL), fields(other, ALL)), 1e-7)


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_a_copy_of_the_scene_in_the_same_file(seed: int) -> None:
    other = march(scene(doubled(tree(seed))))
    assert_equal(differences(fields(run(seed), ALL), fields(other, ALL)), 1e-7)


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_a_rigid_rod_in_two_halves(seed: int) -> None:
    """One frame or two are integrated: equal but for the error of the steps, which falls."""
    links = chain(np.random.default_rng(seed), links=2, rigid=True)
    worst = []
    for step in (STEP, STEP / 2):
        links["time"]["step"] = step
        whole, halves = march(scene(links)), march(scene(halved(links, "link0")))
        found = differences(fields(whole, ("rigid",)), fields(halves, ("rigid",)))
        worst.append(max(found.values()))
    assert worst[0] < 1e-4 and worst[1] < max(0.6 * worst[0], 1e-9), worst


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_time_reversal(seed: int) -> None:
    """The trapezoidal rule (rho_inf 1) takes a chain of rods back to its start."""
    links = chain(np.random.default_rng(seed), links=2, rigid=True)
    links["integrator"] = {"use": "generalized_alpha", "rho_inf": 1.0}
    del links["loads"]["push"]
    there = march(scene(links))
    back = scene(links)
    for name in links["bodies"]:
        at = there.model.layout[f"{name}.rigid"]
        x, v = there.end.x[at], there.end.v[at]
        back = back.using({f"bodies.{name}.pose": {
            "position": x[:2].tolist(), "angle": float(x[2]), "velocity": (-v[:2]).tolist(),
            "spin": float(-v[2])}})
    again = march(back)
    for name, pose in fields(there, ("rigid",)).items():
        home = again.block(name)[-1]
        assert np.abs(home - pose[0]).max() < 1e-6 * np.abs(pose - pose[0]).max(), name


@pytest.mark.full
@pytest.mark.parametrize("seed", SEEDS)
def test_schur_complement_and_textbook_newton(seed: int) -> None:
    newton = march(scene({**tree(seed), "reducer": {"use": "full", "method": "newton"}}))
    assert_equal(differences(fields(run(seed), ALL), fields(newton, ALL)), 1e-7)
