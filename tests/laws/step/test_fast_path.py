"""The bordered step with constant factors gives what a plain Newton gives that knows only terms."""

from dataclasses import replace

import numpy as np
import pytest

from small_scenes import everything
from sparsemor.core.scene.scene import Scene, load
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


@pytest.mark.parametrize(("integrator", "steps"), [
    pytest.param("bdf2", 2, marks=pytest.mark.end_to_end),
    *(pytest.param(i, 25, marks=pytest.mark.full if i == "bdf2" else pytest.mark.slow)
      for i in INTEGRATORS)])
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


@pytest.mark.full
def test_the_plain_newton_factorizes_in_each_iteration_and_the_fast_one_once_a_block() -> None:
    scene = everything().using({"time.end": 0.002})
    fast, plain = both(scene)
    blocks = fast.model.reducible()
    memory = fast.solver.start(fast.end)[1]
    assert fast.solver.counters(memory)["factorizations"] == len(blocks)
    assert min(plain.iterations) >= 2


def rounding(scene: Scene, plain: March) -> dict[str, float]:
    """The same differences, made by the textbook Newton itself from start coordinates of the rigid
    bodies that are moved by one unit in the last place."""
    x0 = plain.model.x0.copy()
    x0[plain.model.layout["link2.rigid"]] = np.nextafter(
        x0[plain.model.layout["link2.rigid"]], np.inf)
    moved = march(scene.using({"reducer": {"use": "full", "method": "newton"}}),
                  model=replace(plain.model, x0=x0))
    return differences(moved, plain)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_double_pendulum_at_its_size(integrator: str) -> None:
    """Joint forces hold bodies that are 1e10 times stiffer than they are heavy: a coordinate's last
    digit moves the forces of second-order rules, which do not damp it, by up to 1e-9 of the
    largest. What both ways differ by must be of that size."""
    use = {"use": integrator, **INTEGRATORS[integrator].model_dump()}
    scene = load("double_pendulum", {"time.end": 0.03, "integrator": use})
    fast, plain = both(scene)
    found, last_digit = differences(fast, plain), rounding(scene, plain)
    forces = {n: found.pop(n) for n in list(found) if n.endswith(".multiplier")}
    assert max(found.values()) < 1e-10, found
    for name, difference in forces.items():
        assert difference < max(1e-9, 4.0 * last_digit[name]), (name, forces, last_digit)
