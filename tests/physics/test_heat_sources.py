"""Heat produced inside bodies: parabolas of temperature, balance of heat, sets of cells, reduced
models."""

from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.errors import InputError

L, K, RHO, C = 0.2, 40.0, 7800.0, 500.0
PLANE = {"use": "rectangle", "size": [L, 0.05], "divisions": [6, 2]}
SPACE = {"use": "block", "size": [L, 0.05, 0.03], "divisions": [6, 2, 1]}


def heated(mesh: dict[str, Any], source: dict[str, Any], **more: Any) -> dict[str, Any]:
    body = {"use": "flexible", "mesh": mesh, "fields": ["thermal"], "frame": "fixed", "order": 2,
            "material": {"rho": RHO, "k": K, "c": C},
            "sets": {"half": {"where": "x <= 0.1 + 1e-9"}}}
    if mesh is PLANE:
        body["thickness"] = 0.03
    return {"format": 1, "bodies": {"b": body}, "reducer": "full", "integrator": "bdf1",
            "loads": {"source": {"use": "heat_source", **source}},
            "time": {"end": 4e5, "step": 4e4}, **more}


@pytest.mark.full
@pytest.mark.parametrize("mesh", [PLANE, SPACE])
def test_a_slab_between_cold_ends_has_a_parabola(mesh: dict[str, Any]) -> None:
    """T - T0 = q x (L - x) / (2 k), which cells of second order contain."""
    q = 3.0e5
    run = simulate(load(heated(mesh, {"on": ["b"], "density": q}, joints={
        "cold": {"use": "prescribed_temperature", "on": ["b:left", "b:right"],
                 "temperature": 293.15}}, time={"end": 1e8, "step": 1e7})))
    x = run.points("b")[:, 0]
    want = 293.15 + q * x * (L - x) / (2 * K)
    assert np.allclose(run.nodal_temperature("b", -1), want, rtol=1e-7)


@pytest.mark.full
@pytest.mark.parametrize("mesh, on", [(PLANE, "b:half"), (SPACE, "b")])
def test_an_insulated_body_stores_the_power(mesh: dict[str, Any], on: str) -> None:
    """The mean temperature rises by P t / (rho c V), whatever part is heated."""
    P, end = 12.0, 4e5
    run = simulate(load(heated(mesh, {"on": [on], "power": P})))
    rise = P * end / (RHO * C * L * 0.05 * 0.03)
    T = run.nodal_temperature("b", -1)
    slope = 0.0 if on == "b" else P / (0.05 * 0.03) * L / (4 * K)  # between the ends, at last
    assert np.ptp(T) == pytest.approx(slope, rel=0.02, abs=1e-6)
    assert 0.5 * (T.max() + T.min()) - 293.15 == pytest.approx(rise, rel=1e-3)


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "ecsw"])
def test_reduced_models_with_a_source_of_time(reducer: str) -> None:
    scene = load(heated(PLANE, {"on": ["b:half"], "density": {
        "use": "ramp", "end": 200.0, "final": 4e6}}, time={"end": 400.0, "step": 20.0}))
    full = simulate(scene).nodal_temperature("b", -1)
    run = simulate(scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 6}}}))
    assert np.ptp(full) > 50.0
    assert np.abs(run.nodal_temperature("b", -1) - full).max() < 1e-4 * np.ptp(full)


@pytest.mark.parametrize(("source", "message"), [
    ({"on": ["b"]}, "give either a density"),
    ({"on": ["b"], "density": 1.0, "power": 1.0}, "give either a density"),
    ({"on": ["a"], "power": 1.0}, "no body is called 'a'"),
    ({"on": ["b:lft"], "power": 1.0}, "set"),
    ({"on": ["b:left"], "power": 1.0}, "'b:left' has no cells"),
])
def test_bad_input_is_refused(source: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(load(heated(PLANE, source)))
