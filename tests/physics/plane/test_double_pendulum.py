"""The packaged scene `double_pendulum`, with consistent capacity, at full order against the
published numbers (scenes.md 1.2).

Section 1.2 of the specification gives angles of an independent implementation on the same mesh,
and temperatures and displacements that a static computation confirms.
"""

from typing import Any

import numpy as np
import pytest

from sparsemor.core.arrays import FloatArray
from sparsemor.core.scene.scene import load
from sparsemor.core.testing.in_memory_run import March, march

LINKS = ("link1", "link2")
pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def heated() -> March:
    return march(load("double_pendulum", {
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "reducer": "full", "time.end": 2.4}))


def at(run: March, times: list[float]) -> list[int]:
    return [int(i) for i in np.searchsorted(run.t, np.array(times) - 1e-9)]


def angles(run: March, times: list[float]) -> FloatArray:
    columns = [run.block(f"{link}.rigid")[at(run, times), 2] for link in LINKS]
    return np.asarray(np.degrees(np.stack(columns, axis=1)))


def test_angles(heated: March) -> None:
    table = [(-153.0813, -146.0835), (-94.3823, -96.7524)]
    np.testing.assert_allclose(angles(heated, [1, 2]), table, rtol=0, atol=1e-3)


@pytest.mark.parametrize("link", LINKS)
def test_hottest_point(heated: March, link: str) -> None:
    rows = heated.block(f"{link}.thermal")[at(heated, [1.0, 2.332])]
    np.testing.assert_allclose(rows.max(axis=1), [535.45, 666.14], atol=0.2)


@pytest.mark.parametrize("link", LINKS)
def test_largest_displacement(heated: March, link: str) -> None:
    rows = heated.block(f"{link}.elastic")[at(heated, [1.0, 2.332])]
    body: Any = heated.model.parts[link]
    u = np.zeros((2, 2 * len(body.X)))
    u[:, body.elasticity.free] = rows
    size = np.linalg.norm(u.reshape(2, -1, 2), axis=2)
    np.testing.assert_allclose(1e3 * size.max(axis=1), [0.928, 2.021], rtol=0.01)
    x, y = body.mesh.points[size[1].argmax()]
    assert x == pytest.approx(1.085) and y == pytest.approx(0.085)


def test_heat_that_came_in_is_heat_that_is_there(heated: March) -> None:
    """1e6 W/m^2 over 1.17 m x 0.03 m during 2.4 s."""
    model = heated.model
    for h in model.separated.heat:
        T = heated.block(h.thermal)
        stored = float(np.ones(T.shape[1]) @ (h.capacity @ (T[-1] - T[0])))
        assert stored == pytest.approx(1e6 * 1.17 * 0.03 * 2.4, rel=1e-9)


@pytest.mark.slow
def test_unheated_links_with_generalized_alpha() -> None:
    link = {"fields": ["elastic"]}
    changes = {f"bodies.{b}.{k}": v for b in LINKS for k, v in link.items()}
    scene = load("double_pendulum", {
        **changes, "loads": {"gravity": {"use": "gravity"}}, "reducer": "full",
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "time": {"end": 1.0, "step": 2.5e-4}})
    run = march(scene, every=4000)
    np.testing.assert_allclose(angles(run, [1.0]), [(-153.4533, -146.1372)], rtol=0, atol=1e-3)
