"""The bordered step with constant factors gives what a plain Newton gives that knows only terms."""


import numpy as np
import pytest

from small_scenes import everything
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.integrators.bdf1 import Bdf1
from sparsemor.integrators.bdf2 import Bdf2
from sparsemor.integrators.generalized_alpha import GeneralizedAlpha

INTEGRATORS = {"bdf1": Bdf1(), "bdf2": Bdf2(), "generalized_alpha": GeneralizedAlpha(rho_inf=0.6)}


def both(scene: Scene) -> tuple[March, March]:
    plain = march(scene.using({"reducer": {"use": "full", "method": "newton"}}))
    return march(scene.using({"reducer": "full"})), plain


def differences(fast: March, plain: March) -> dict[str, float]:
    """Largest difference over the run relative to the largest value, block by block.

    Joint forces are measured by the largest of all: their round-off is that of the forces inside
    the bodies, which are thousands of times larger, and not in proportion to each of them.
    """
    found = {}
    force = float(np.abs(plain.x[:, fast.model.layout.algebraic]).max())
    for b in fast.model.layout:
        one, other = fast.block(b.name), plain.block(b.name)
        size = force if b.field == "multiplier" else float(np.abs(other).max())
        found[b.name] = float(np.abs(one - other).max()) / size
    return found


@pytest.mark.full
@pytest.mark.parametrize(("integrator", "steps"), [
    ("bdf2", 12), ("generalized_alpha", 6)])
def test_a_scene_with_everything(integrator: str, steps: int) -> None:
    use = {"use": integrator, **INTEGRATORS[integrator].model_dump()}
    scene = everything().using({"integrator": use})
    fast, plain = both(scene.using({"time.end": steps * scene.time.step}))
    assert len(fast.t) == steps + 1
    found = differences(fast, plain)
    assert set(found) == {b.name for b in plain.model.layout}
    assert max(found.values()) < 1e-9, found


@pytest.mark.full
def test_rates_and_accelerations_agree_too() -> None:
    fast, plain = both(everything().using({"time.end": 0.003}))
    for one, other, size in ((fast.v, plain.v, 1e-9), (fast.a, plain.a, 1e-7)):
        at = fast.model.layout.second
        assert np.abs(one - other)[:, at].max() < size * np.abs(other[:, at]).max()
