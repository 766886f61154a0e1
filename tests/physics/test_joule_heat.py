"""Heat of electric currents: bars in series, a ring, a plate with a hole, currents over time."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor import load, reduce, simulate
from sparsemor.core.errors import InputError

L, A, K, SIGMA = 0.2, 0.05 * 0.03, 40.0, 5.0e6
PLANE = {"use": "rectangle", "size": [L, 0.05], "divisions": [8, 2]}
SPACE = {"use": "block", "size": [L, 0.05, 0.03], "divisions": [8, 2, 1]}


def wired(mesh: dict[str, Any], source: dict[str, Any], **more: Any) -> dict[str, Any]:
    body = {"use": "flexible", "mesh": mesh, "fields": ["thermal"], "frame": "fixed", "order": 2,
            "material": {"rho": 7800.0, "k": K, "c": 500.0},
            "sets": {"half": {"where": "x <= 0.1 + 1e-9"}}}
    if mesh["use"] != "block":
        body["thickness"] = 0.03
    return {"format": 1, "bodies": {"b": body}, "reducer": "full", "integrator": "bdf1",
            "loads": {"current": {"use": "joule_heat", "on": "b", "conductivity": SIGMA, **source}},
            "time": {"end": 40.0, "step": 4.0}, **more}


def power(run: Any) -> float:
    """Mean power of a run of an insulated body of constant properties, W."""
    heat = run.summary["heat_balance"]["b.thermal"]
    return float(heat["brought_in"] / run.times[-1])


@pytest.mark.full
@pytest.mark.parametrize("mesh", [PLANE, SPACE])
def test_a_bar_between_cold_ends(mesh: dict[str, Any]) -> None:
    """Density sigma (V / L)^2, and T - T0 = q x (L - x) / (2 k)."""
    run = simulate(load(wired(mesh, {"electrodes": {
        "left": {"potential": 1.0}, "right": {"potential": 1.1}}}, joints={
            "cold": {"use": "prescribed_temperature", "on": ["b:left", "b:right"],
                     "temperature": 293.15}}, time={"end": 1e8, "step": 1e7})))
    x, q = run.points("b")[:, 0], SIGMA * (0.1 / L) ** 2
    assert np.allclose(run.nodal_temperature("b", -1) - 293.15, q * x * (L - x) / (2 * K),
                       atol=1e-6 * q * L**2 / K)


@pytest.mark.full
@pytest.mark.parametrize("mesh", [PLANE, SPACE])
def test_two_conductors_in_series(mesh: dict[str, Any]) -> None:
    """R = L / (2 A) (1 / sigma_1 + 1 / sigma_2), P = R I^2, in the share of the resistances."""
    flow = 100.0
    run = simulate(load(wired(mesh, {"conductivities": {"half": SIGMA / 4}, "electrodes": {
        "left": {"current": flow}, "right": {"potential": 0.0}}},
        time={"end": 1e-3, "step": 1e-3})))
    R = L / (2 * A) * np.array([4.0, 1.0]) / SIGMA
    assert power(run) == pytest.approx(R.sum() * flow**2, rel=1e-8)
    T, x = run.nodal_temperature("b", -1) - 293.15, run.points("b")[:, 0]
    assert T[x < 1e-9].mean() / T[x > L - 1e-9].mean() == pytest.approx(4.0, rel=0.02)
    volts = R.sum() * flow
    assert any(f"left {volts:.4g} V 100 A, right 0 V -100 A" in n
               for n in run.summary["information"])


def quarter(path: Path, outer: Any, n: int) -> None:
    """Mesh of a quarter of a plate with a hole of radius 0.05 m; outer: the radius of its edge at
    an angle."""
    angle, s = np.meshgrid(np.linspace(0, np.pi / 2, 2 * n + 1), np.linspace(0, 1, n + 1),
                           indexing="ij")
    r = 0.05 * (outer(angle) / 0.05) ** s
    X = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1).reshape(-1, 2)
    at = np.arange(len(X)).reshape(r.shape)
    cells = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1).reshape(-1, 4)
    meshio.write(path, meshio.Mesh(np.c_[X, 0 * X[:, 0]], [("quad", cells)]))


@pytest.mark.full
def test_a_ring(tmp_path: Path) -> None:
    """A quarter between radii a and b: R = ln(b / a) / (pi sigma t / 2)."""
    quarter(tmp_path / "ring.vtu", lambda angle: 0.15 + 0 * angle, 12)
    scene = wired({"use": "file", "path": str(tmp_path / "ring.vtu")}, {"electrodes": {
        "inner": {"potential": 0.2}, "outer": {"potential": 0.0}}}, time={"end": 1.0, "step": 0.5})
    scene["bodies"]["b"]["sets"] = {"inner": {"where": "x*x + y*y < 0.0025 + 1e-9"},
                                    "outer": {"where": "x*x + y*y > 0.0225 - 1e-9"}}
    R = np.log(3.0) / (np.pi / 2 * SIGMA * 0.03)
    assert power(simulate(load(scene))) == pytest.approx(0.2**2 / R, rel=2e-3)


@pytest.mark.full
def test_a_plate_with_a_hole(tmp_path: Path) -> None:
    """Power = V I, also of a current that is half as large; the hole of a quarter of the width
    makes the resistance larger than that of the plate, and smaller than that of its narrowest
    section over the whole length."""
    quarter(tmp_path / "plate.vtu", lambda a: 0.2 / np.maximum(np.cos(a), np.sin(a)), 12)

    def run(electrode: dict[str, float]) -> Any:
        scene = wired({"use": "file", "path": str(tmp_path / "plate.vtu")}, {"electrodes": {
            "axis": {"potential": 0.0}, "end": electrode}}, time={"end": 1.0, "step": 0.5})
        scene["bodies"]["b"]["sets"] = {"axis": {"where": "x < 1e-9"},
                                        "end": {"where": "x > 0.2 - 1e-9"}}
        return simulate(load(scene))

    one = run({"potential": 0.1})
    (note,) = (n for n in one.summary["information"] if "A" in n and "factor 1" in n)
    current = float(note.split("end 0.1 V ")[1].split(" A")[0])
    assert power(one) == pytest.approx(0.1 * current, rel=1e-3)
    assert power(run({"current": current / 2})) == pytest.approx(power(one) / 4, rel=1e-3)
    resistance = 0.1 / current * SIGMA * 0.03
    assert 1.0 < resistance < 1.0 / 0.75


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "sparse"])
def test_a_current_over_time_in_reduced_and_kept_models(reducer: str) -> None:
    """f = t / 20 s until 20 s: the heat grows with its square, 1/3 of that at 20 s."""
    scene = load(wired(PLANE, {"conductivities": {"half": SIGMA / 4}, "electrodes": {
        "left": {"potential": 0.0}, "right": {"potential": 0.5}},
        "factor": {"use": "ramp", "end": 20.0, "final": 1.0}},
        time={"end": 20.0, "step": 0.5}))
    full = simulate(scene)
    small = scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 6}}})
    model = reduce(small)
    for run in (simulate(small), model.run()):
        T = full.nodal_temperature("b", -1)
        assert np.abs(run.nodal_temperature("b", -1) - T).max() < 1e-4 * np.ptp(T)
    again = model.run({"loads.current.factor": {"use": "constant", "level": 0.5}})
    want = simulate(scene.using({"loads.current.factor": {"use": "constant", "level": 0.5}}))
    assert power(want) == pytest.approx(0.75 * power(full), rel=0.05)
    T = want.nodal_temperature("b", -1)
    assert np.abs(again.nodal_temperature("b", -1) - T).max() < 1e-2 * np.ptp(T)


@pytest.mark.parametrize(("source", "message"), [
    ({"electrodes": {"left": {"potential": 0.0}}}, "at least 2"),
    ({"electrodes": {"left": {"current": 1.0}, "right": {"current": -1.0}}}, "all electrodes have"),
    ({"electrodes": {"left": {"potential": 0.0}, "half": {"potential": 1.0}}}, "short circuit"),
    ({"electrodes": {"left": {"potential": 0.0}, "rigth": {"potential": 1.0}}}, "no set 'rigth'"),
    ({"electrodes": {"left": {}, "right": {"potential": 1.0}}}, "give either a potential"),
    ({"conductivities": {"left": 1.0}, "electrodes": {
        "left": {"potential": 0.0}, "right": {"potential": 1.0}}}, "'left' has no cells"),
])
def test_bad_input_is_refused(source: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(load(wired(PLANE, source)))
