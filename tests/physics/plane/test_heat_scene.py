"""Heat from scene to state: slabs, films, radiation and given temperatures against closed forms."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

ALPHA = {"use": "generalized_alpha", "rho_inf": 0.5}
SIGMA = 5.670374419e-8


def slab(
    loads: dict[str, Any], end: float, h: float, integrator: Any = "bdf1",
    joints: dict[str, Any] | None = None, length: float = 0.1, columns: int = 20,
    start: float | str = 293.15, **material: float,
) -> March:
    """One strip of triangles along x, 0 to `length`."""
    return march(scene_of({
        "bodies": {"slab": {
            "use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [length, 0.01], "divisions": [columns, 1]},
            "material": {"rho": 1000, "k": 20, "c": 500, **material},
            "initial_temperature": start}},
        "joints": joints or {}, "loads": loads, "time": {"end": end, "step": h},
        "integrator": integrator}))


def profile(run: March, at: int = -1) -> tuple[FloatArray, FloatArray]:
    """x and temperature of all nodes that are unknowns."""
    body: Any = run.model.parts["slab"]
    return body.X[body.heat.free, 0], run.block("slab.thermal")[at]


def film(on: str, h: float, temperature: float) -> dict[str, Any]:
    return {"use": "convection", "on": [on], "film": h, "temperature": temperature}


@pytest.mark.full
def test_flux_into_a_slab_follows_the_series() -> None:
    """V4 with the data of the second scene: rises at the heated surface and at the back."""
    run = slab({"heat": {"use": "heat_flux", "on": ["slab:right"], "flux": 1e6}}, 3.75e-3, 3.75e-6,
               length=1.25e-3, columns=60, start=0.0, k=150, rho=2700, c=900)
    x, _ = profile(run)
    hot, back = x > 0.999 * x.max(), x == 0.0  # the strip's two triangles share them unevenly
    rises = run.block("slab.thermal")[np.searchsorted(run.t, [1.274e-3, 2.549e-3, 3.749e-3])]
    np.testing.assert_allclose(rises[:, hot].mean(axis=1), [2.11038, 2.98455, 3.61980], rtol=2e-3)
    assert rises[-1, back].mean() == pytest.approx(0.23579, rel=5e-3)
    rigid_copy = run.model.separated.heat[0].capacity
    assert np.ones(len(x)) @ (rigid_copy @ rises[-1]) == pytest.approx(1e6 * 0.01 * 0.02 * 3.75e-3)


def test_films_on_both_sides_give_the_line_of_the_resistances() -> None:
    run = slab({"hot": film("slab:left", 200.0, 500.0), "cold": film("slab:right", 50.0, 300.0)},
               1e6, 1e5)
    flux = 200.0 / (1 / 200.0 + 0.1 / 20.0 + 1 / 50.0)
    x, T = profile(run)
    np.testing.assert_allclose(T, 500.0 - flux / 200.0 - flux * x / 20.0, rtol=1e-10)


def test_given_temperatures_make_a_line() -> None:
    run = slab({}, 1e6, 1e5, joints={
        "hot": {"use": "prescribed_temperature", "on": ["slab:left"], "temperature": 400.0},
        "cold": {"use": "prescribed_temperature", "on": ["slab:right"], "temperature": 300.0}})
    x, T = profile(run)
    assert len(x) == 2 * 19
    np.testing.assert_allclose(T, 400.0 - 1000.0 * x, rtol=1e-12)


def test_a_steadily_rising_temperature_lags_as_the_parabola_says() -> None:
    """T = rate (t - (L^2 - (L-x)^2)/(2 a)) + T0 with the right side insulated: the rate of the
    given nodes enters the rows beside them."""
    ramp = {"use": "ramp", "end": 1e5, "initial": 300.0, "final": 300.0 + 1e4}
    run = slab({}, 8000.0, 80.0, ALPHA, start=300.0, columns=40, joints={
        "hot": {"use": "prescribed_temperature", "on": ["slab:left"], "temperature": ramp}})
    x, T = profile(run)
    lag = 0.1 * (0.1**2 - (0.1 - x) ** 2) / (2 * 20 / 5e5)
    assert lag.max() == pytest.approx(12.5, rel=1e-2)
    np.testing.assert_allclose(300.0 + 0.1 * 8000.0 - T, lag, rtol=0, atol=2e-3 * lag.max())


def lumped(rate: Any, end: float) -> float:
    found = solve_ivp(lambda t, T: [rate(t, T[0])], (0.0, end), [900.0], rtol=1e-10, atol=1e-8)
    return float(found.y[0, -1])


@pytest.mark.full
def test_a_well_conducting_plate_cools_as_one_lump() -> None:
    """Radiation and a film on one long side; heat capacity rho c H per area."""
    loads = {"glow": {"use": "radiation", "on": ["slab:top"], "emissivity": 0.7,
                      "surroundings": 280.0},
             "film": film("slab:top", 20.0, 300.0)}
    per_area = 1000 * 500 * 0.01

    def rate(t: float, T: float) -> float:
        return -(0.7 * SIGMA * (T**4 - 280.0**4) + 20.0 * (T - 300.0)) / per_area

    run = slab(loads, 200.0, 4.0, "generalized_alpha", start=900.0, k=1e7, columns=4)
    T = profile(run)[1]
    assert np.ptp(T) < 1e-3
    want = lumped(rate, 200.0)
    assert want < 500.0
    np.testing.assert_allclose(T, want, atol=0.2)


def smooth(integrator: Any, h: float) -> FloatArray:
    """End of a smooth problem with radiation, a varying film and a given varying temperature."""
    wave = {"use": "sine", "amplitude": 50.0, "frequency": 0.01, "offset": 350.0}
    held = {"use": "sine", "amplitude": 20.0, "offset": 450.0, "frequency": 0.02}
    run = slab({"glow": {"use": "radiation", "on": ["slab:right"], "emissivity": 0.9,
                         "surroundings": 280.0},
                "film": {**film("slab:top", 30.0, 0.0), "temperature": wave}},
               40.0, h, integrator, columns=6, start="350 + 100*cos(31.41592653589793*x)",
               joints={"held": {"use": "prescribed_temperature", "on": ["slab:left"],
                                "temperature": held}})
    return profile(run)[1]


@pytest.mark.full
@pytest.mark.parametrize("integrator,order", [("bdf1", 1.0), ("bdf2", 2.0), (ALPHA, 2.0)],
                         ids=["bdf1", "bdf2", "alpha"])
def test_orders_in_time(integrator: Any, order: float) -> None:
    one, two, three = (smooth(integrator, h) for h in (0.4, 0.2, 0.1))
    observed = np.log2(np.abs(one - two).max() / np.abs(two - three).max())
    assert observed == pytest.approx(order, abs=0.1)
