"""Impulse of loads with jumps and kinks: what acts on a body is the integral of the load, on the
step grid and off it, with fixed and with controlled steps. The integrals are in closed form."""

from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.protocols.integrator import next_time
from sparsemor.core.protocols.step_amplitude import StepAmplitude, delay
from sparsemor.integrators.bdf1 import Bdf1
from sparsemor.integrators.bdf2 import Bdf2
from sparsemor.integrators.generalized_alpha import GeneralizedAlpha
from sparsemor.plugins.functions import Product, Pulse, Sine, SmoothStep, Sum, TabulatedFunction

H = 0.01
ALPHA = {"use": "generalized_alpha", "rho_inf": 0.8}
CONTROL = {"tolerance": 1e-3, "max_halvings": 12}


def random_function(rng: np.random.Generator, i: int, grid: bool) -> tuple[Any, float, float]:
    """A pulse or a table within 1 s, its integral over time and that of its size."""
    if i % 2:
        count = int(rng.integers(2, 8))
        t = np.sort(rng.choice(100, count, replace=False)) * H if grid else (
            np.sort(rng.random(count)))
        v = rng.standard_normal(count)
        made = {"use": "table", "times": t.tolist(), "values": v.tolist(), "outside": "zero"}
        return made, float(np.trapezoid(v, t)), float(np.abs(v).max() * (t[-1] - t[0]))
    start, duration = int(rng.integers(0, 40)) * H, int(rng.integers(1, 50)) * H
    if not grid:
        start, duration = start + H * rng.random(), duration * rng.uniform(0.02, 1.0)
    made = {"use": "pulse", "start": start, "duration": duration, "level": 2.0}
    return made, 2.0 * duration, 2.0 * duration


def delivered(integrator: Any, function: Any, steps: int) -> float:
    """Velocity of a mass of 1 kg from rest, by the integrator's own rules."""
    rule, g = integrator.rules(H).second, StepAmplitude(function, H, delay(integrator))
    z = np.zeros(len(rule.new))
    z[2] = function.value(0.0)
    if len(z) == 4:
        z[3] = z[2]
    for n in range(1, steps + 1):
        z = rule.new * g(n * H) + rule.old @ z
    return float(z[1])


@pytest.mark.full
@pytest.mark.parametrize("integrator", [Bdf1(), Bdf2(), GeneralizedAlpha(rho_inf=0.8)],
                         ids=lambda i: type(i).__name__)
def test_sixty_pulses_and_tables(integrator: Any) -> None:
    """Thirty on the grid of steps, thirty off it."""
    rng = np.random.default_rng(0)
    for i in range(60):  # tables are odd
        made, exact, size = random_function(rng, i, i < 30)
        options = {k: v for k, v in made.items() if k != "use"}
        function = TabulatedFunction(**options) if i % 2 else Pulse(**options)
        assert abs(delivered(integrator, function, 130) - exact) <= 1e-12 * size


def final_velocities(functions: list[Any], integrator: Any, control: Any) -> np.ndarray[Any, Any]:
    names = [f"b{i}" for i in range(len(functions))]
    run = simulate(load({
        "format": 1,
        "bodies": {b: {"use": "rigid", "mass": 1.0, "inertia": 1.0, "points": {"c": [0.0, 0.0]}}
                   for b in names},
        "loads": {f"push_{b}": {"use": "point_force", "on": f"{b}:c", "force": [1.0, 0.0],
                                "factor": f}
                  for b, f in zip(names, functions, strict=True)},
        "probes": {b: {"body": b, "at": "c"} for b in names},
        "time": {"end": 1.6, "step": H} | ({"control": control} if control else {}),
        "integrator": integrator, "reducer": "full"}))
    x = np.array([run.probe(b)[:, 0] for b in names])
    return np.asarray(x[:, -1] - x[:, -2]) / H


@pytest.mark.full
@pytest.mark.parametrize("integrator, grid, control", [
    ("bdf1", False, None), ("bdf2", True, None), (ALPHA, False, None), ("bdf1", True, CONTROL),
    ("bdf2", False, CONTROL), (ALPHA, False, CONTROL)])
def test_runs_with_pulses_and_tables(integrator: Any, grid: bool, control: Any) -> None:
    rng = np.random.default_rng(1)
    found = [random_function(rng, i, grid) for i in range(8)]
    v = final_velocities([f for f, _, _ in found], integrator, control)
    for got, (function, exact, size) in zip(v, found, strict=True):
        assert abs(got - exact) <= 1e-11 * size, function


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf1", ALPHA], ids=["bdf1", "alpha"])
def test_heat_of_a_pulse_on_the_grid(integrator: Any) -> None:
    """cases/physics/gridpulse: its energy is flux x area x duration, and was 8.3 % less."""
    run = simulate(load({
        "format": 1,
        "bodies": {"b": {
            "use": "flexible", "mesh": {"use": "rectangle", "size": [0.1, 0.02],
                                        "divisions": [2, 2]}, "thickness": 0.01,
            "material": {"rho": 7800.0, "k": 45.0, "c": 480.0}, "fields": ["thermal"],
            "frame": "fixed", "capacity": "lumped"}},
        "loads": {"q": {"use": "heat_flux", "on": ["b:top"], "flux": {
            "use": "pulse", "start": 1.0, "duration": 1.2, "level": 1e5}}},
        "time": {"end": 5.0, "step": 0.1}, "integrator": integrator, "reducer": "full"}))
    rise = run.nodal_temperature("b", -1) - run.nodal_temperature("b", 0)
    cells = run.cells("b")  # triangles of one size
    heat = 7800.0 * 480.0 * 0.01 * 0.1 * 0.02 * float(rise[cells].mean())
    assert heat == pytest.approx(1e5 * 0.1 * 0.01 * 1.2, rel=1e-6)


def test_steps_end_at_multiples_of_their_size() -> None:
    t = 0.0
    for _ in range(3_000):
        t = next_time(t, 0.1)
    assert t == 3_000 * 0.1
    assert next_time(0.05, 0.1) == pytest.approx(0.15)


class Square:
    """A third party's function that declares its jumps: 1 in every other second."""

    def value(self, t: float) -> float:
        return float(int(t) % 2)

    def rate(self, t: float) -> float:
        return 0.0

    def jumps(self, start: float, end: float) -> list[float]:
        return [float(n) for n in range(int(np.ceil(start)), int(end) + 1)]


def test_functions_of_others_declare_their_jumps() -> None:
    g = StepAmplitude(Square(), 0.3, 0.0)
    assert sum(0.3 * g(0.3 * n) for n in range(1, 21)) == pytest.approx(3.0, rel=1e-12)


def test_smooth_functions_have_their_value_at_the_end_of_the_step() -> None:
    sine = Sine(amplitude=1.0, frequency=0.7)
    for f in (sine, Sum(terms=(sine, 2.0))):
        for theta in (0.0, 0.5):
            assert StepAmplitude(f, H, theta)(0.37) == f.value(0.37)
    late = Product(factors=(sine, SmoothStep(start=2.0, end=3.0, final=1.0)))
    assert StepAmplitude(late, H, 0.5)(0.37) == late.value(0.37)
