"""Bodies that nothing heats or cools: K 1 = 0, and their only temperature is uniform."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from small_scenes import tiny
from sparsemor.core import Dictionary
from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import march, scene_of
from sparsemor.reducers.linalg.modal_coordinates import modal_coordinates
from tiers import quick

BUDGETS = {"*.elastic": {"rows": 24, "atoms": 8}, "*.thermal": {"rows": 10, "atoms": 1}}
REDUCERS: dict[str, dict[str, Any]] = {
    "galerkin": {}, "lspg": {}, "deim": {}, "gnat": {}, "ecsw": {},
    "sparse": {"budgets": BUDGETS, "sampler": "deim"}}
BASES = {"basis": {"use": "pod", "count": 8}, "bases": {"*.thermal": {"use": "pod", "count": 2}}}


@cache
def light() -> Scene:
    return tiny().using({
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -9.81]}}, "time.end": 0.01})


@pytest.mark.full
@pytest.mark.parametrize("reducer", REDUCERS)
def test_every_reducer_runs_an_insulated_pendulum(reducer: str) -> None:
    reference = march(light().using({"reducer": "full"}))
    scene = light().using({"reducer": {"use": reducer, **BASES, **REDUCERS[reducer]}})
    run = march(scene, model=reference.model, snapshots=learnt(reference))
    T, want = decoded(run, "bar.thermal"), decoded(reference, "bar.thermal")
    np.testing.assert_allclose(T, want, rtol=1e-10)
    u, exact = decoded(run, "bar.elastic"), decoded(reference, "bar.elastic")
    assert np.abs(u - exact).max() <= 1e-3 * np.abs(exact).max()


def drawn(seed: int) -> Scene:
    """One or two insulated plates at rest, of random sizes, units and temperatures."""
    rng = np.random.default_rng(seed)
    bodies: dict[str, Any] = {}
    for i in range(int(rng.integers(1, 3))):
        a, b = (float(10.0 ** rng.uniform(-3, 1)) for _ in range(2))
        bodies[f"plate{i}"] = {
            "use": "flexible", "fields": ["thermal"], "frame": "fixed",
            "thickness": float(10.0 ** rng.uniform(-4, 0)),
            "mesh": {"use": "rectangle", "size": [a, b],
                     "divisions": [int(n) for n in rng.integers(1, 7, 2)]},
            "material": {"rho": float(10.0 ** rng.uniform(-2, 5)), "c": 475.0,
                         "k": float(10.0 ** rng.uniform(-4, 4))},
            "initial_temperature": float(rng.uniform(1.0, 2000.0))}
    return scene_of({"bodies": bodies, "time": {"end": 5e-3, "step": 1e-3}})


@pytest.mark.parametrize("reducer", quick(["galerkin", "lspg", "deim", "gnat", "ecsw"], "galerkin"))
def test_random_insulated_plates_keep_their_temperature(reducer: str) -> None:
    for seed in range(3):
        scene = drawn(seed)
        reference = march(scene.using({"reducer": "full"}))
        basis = {"use": "pod", "count": 1, "centred": False}
        reduced = scene.using({"reducer": {"use": reducer, "basis": basis}})
        run = march(reduced, model=reference.model, snapshots=learnt(reference))
        for name in reference.model.reducible():
            T = decoded(run, name)
            np.testing.assert_allclose(T, 0.0 * T + reference.block(name)[0], rtol=1e-8)


@pytest.mark.parametrize("factor", [1e-200, 1.0, 1e200])
def test_modes_of_an_insulated_body_do_not_depend_on_the_units_of_its_matrices(
    factor: float,
) -> None:
    (heat,) = assemble(drawn(3)).separated.heat[:1]
    n = heat.capacity.shape[0]
    A = np.linalg.qr(np.column_stack([np.ones(n), np.random.default_rng(0).random((n, 3))]))[0]
    for k in (1, 4):
        d = Dictionary(A[:, :k], np.zeros(n), tuple(f"atom {i}" for i in range(k)))
        made = modal_coordinates(d, factor * heat.conductivity, heat.capacity, "/s")
        assert made is not None
        turned = made[0].atoms
        for matrix in (heat.conductivity, heat.capacity):
            small = turned.T @ (matrix @ turned)
            other = small - np.diag(np.diag(small))
            assert np.abs(other).max() <= 1e-9 * abs(matrix).max()
        s = np.linalg.svd(np.hstack([A[:, :k], turned / np.linalg.norm(turned, axis=0)]))[1]
        assert s[k:].max(initial=0.0) < 1e-9  # the same span
