"""Steps of any size: the bordered iteration against Newton's method, digits of accelerations."""

from typing import Any

import numpy as np
import pytest

from sparsemor.core.testing.in_memory_run import March, march, scene_of

ALPHA = {"use": "generalized_alpha", "rho_inf": 0.8}
STEPS = {1e-2: 0.05, 1e-3: 0.01, 1e-4: 1e-3, 1e-6: 2e-5}
"""Step, s -> end of the run, s."""
SOFT, STIFF = 7e7, 7e10


def pendulum(
    E: float, h: float, end: float, integrator: Any, method: str,
    divisions: tuple[int, int] = (10, 2), every: int = 1,
) -> March:
    """A flexible rod that falls from the horizontal about a pin, m."""
    return march(scene_of({
        "bodies": {"rod": {
            "use": "flexible", "thickness": 0.1, "fields": ["elastic"],
            "mesh": {"use": "rectangle", "size": [1.0, 0.1], "divisions": list(divisions)},
            "material": {"E": E, "rho": 1000, "nu": 0.3}, "damping": {"stiffness": 5e-4},
            "reference": {"clamp": "left"}}},
        "joints": {"pin": {"use": "revolute", "between": ["ground", "rod:left"]}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": end, "step": h}, "integrator": integrator,
        "reducer": {"use": "full", "method": method}}), every=every)


def apart(one: March, other: March, which: str, block: str) -> float:
    """Largest difference of x, v or a of a block, relative to the largest value."""
    at = one.model.layout[block]
    a, b = getattr(one, which)[:, at], getattr(other, which)[:, at]
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.mark.full
@pytest.mark.parametrize("h, E, integrator", [
    (1e-2, SOFT, ALPHA), (1e-3, STIFF, "bdf1"), (1e-4, SOFT, "bdf2"), (1e-6, STIFF, ALPHA)])
def test_no_step_is_too_small(h: float, E: float, integrator: Any) -> None:
    fast, plain = (pendulum(E, h, STEPS[h], integrator, method)
                   for method in ("bordered", "newton"))
    assert apart(fast, plain, "x", "rod.rigid") < (2e-9 if E == SOFT else 3e-8)
    assert apart(fast, plain, "x", "rod.elastic") < (2e-9 if E == SOFT else 1e-7)
    # in constraints positions of 0.1 m are exact to eps, and so accelerations to c2 eps
    rounding = 1e-7 + 100 * np.finfo(float).eps * 0.1 * 4 / h**2 / np.abs(plain.a).max()
    assert apart(fast, plain, "a", "rod.rigid") < rounding
    assert apart(fast, plain, "a", "rod.elastic") < rounding


@pytest.mark.slow
def test_accelerations_keep_their_digits() -> None:
    """In 2000 steps of 2e-5 s; with the formula a = c2 x + r2, where c2 x rounds to 1e-6 of 32 m/s2
    in each step, they were 2e-4 m/s2 apart, velocities 2e-9 m/s and positions 2e-12 m."""
    rule = {"use": "generalized_alpha", "rho_inf": 0.5}
    fast, plain = (pendulum(SOFT, 2e-5, 0.04, rule, method, (40, 4), every=100)
                   for method in ("bordered", "newton"))
    at = fast.model.layout["rod.rigid"]
    for which, most in (("x", 1e-13), ("v", 1e-10), ("a", 2e-5)):
        assert np.abs(getattr(fast, which) - getattr(plain, which))[:, at].max() < most
