"""Plane problems run in space come to their plane runs: heat, motion, contact in two
stages."""

from typing import Any

import numpy as np
import pytest

from sparsemor import simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.testing.in_memory_run import march, scene_of

WIDTH = 1.25e-3
MATERIAL = {"E": 7e10, "nu": 0.0, "rho": 2700, "alpha": 2.4e-5, "k": 150, "c": 900}
"""Without lateral contraction nothing tells plane stress from a body of any width."""


def mesh(deep: bool, lower: list[float], size: list[float], divisions: list[int]) -> dict[str, Any]:
    if not deep:
        return {"use": "rectangle", "lower": lower, "size": size, "divisions": divisions,
                "diagonal": "alternating"}
    return {"use": "block", "lower": [*lower, 0.0], "size": [*size, WIDTH],
            "divisions": [*divisions, 2]}


# --------------------------------------------------------------------------- heat


# --------------------------------------------------------------------------- motion


def swung(deep: bool) -> FloatArray:
    """(M, 2 or 3) displacement of the end of a swinging cantilever."""
    length, height, width, n, m = 0.6, 0.1, 0.02, 16, 4
    body: dict[str, Any] = {
        "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
        "material": {"E": 2e7, "nu": 0.0, "rho": 1000}}
    if deep:
        body["mesh"] = {"use": "block", "size": [length, height, width], "divisions": [n, m, 2]}
    else:
        body |= {"thickness": width, "mesh": {
            "use": "rectangle", "size": [length, height], "divisions": [n, m],
            "diagonal": "alternating"}}
    run = march(scene_of({
        "bodies": {"bar": body}, "joints": {"A": {"use": "fixed", "between": [
            "ground", "bar:left"]}},
        "loads": {"g": {"use": "gravity", "g": [0.0, -9.81, *([0.0] if deep else [])]}},
        "time": {"end": 0.25, "step": 1e-3},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}}))
    part: Any = run.model.parts["bar"]
    d = 3 if deep else 2
    u = np.zeros((len(run.t), d * part.mesh.points.shape[0]))
    u[:, part.elasticity.free] = run.block("bar.elastic")
    return np.asarray(u.reshape(len(u), -1, d)[:, part.points["right"]].mean(axis=1))


@pytest.mark.full
def test_a_plane_flexible_problem_in_space_is_nearly_the_plane_problem() -> None:
    """With nu = 0 on one plane pattern the bodies differ by the tetrahedra's way through the
    thickness alone, which softens the one in space a little."""
    plane, space = swung(False), swung(True)
    size = np.abs(plane[:, 1]).max()
    assert size > 5e-3
    np.testing.assert_allclose(space[:, 1], plane[:, 1], rtol=0, atol=0.03 * size)
    assert np.abs(space[:, 2]).max() < 0.01 * size


# --------------------------------------------------------------------------- contact in two stages

SIDE, STEP = 1.25e-3, 7.5e-6


def slider(deep: bool) -> dict[str, Any]:
    """The slider on its plate (tests/scenes/small_slider.yaml), flat or of two layers."""
    up, down = ("back", "front") if deep else ("top", "bottom")
    body: dict[str, Any] = {"use": "flexible", "material": MATERIAL,
                            "fields": ["elastic", "thermal"], "reference_temperature": 0.0}
    if not deep:
        body |= {"thickness": WIDTH, "model": "plane_stress"}

    def line(x: float) -> dict[str, str]:
        """The points above x on the slider's upper side."""
        return {"where": f"abs(x - {x}) < 1e-6 and y > {SIDE - 1e-6}"}

    flat: dict[str, Any] = {"chord": ["end_a", "end_b"]}
    tied = {"hold": {"end_a": "xy", "end_b": "y", "bottom": "z"}} if deep else flat
    clamped: dict[str, Any] = {"hold": {down: "xy", "bottom": "z"}} if deep else {"clamp": down}
    zero = [0.0] if deep else []
    return {
        "bodies": {
            "slider": {**body, "mesh": mesh(deep, [0.0, 0.0], [SIDE, SIDE], [5, 4]),
                       "sets": {"push": line(5e-4), "end_a": line(0.0), "end_b": line(SIDE)},
                       "reference": tied, "pose": {"velocity": [1.0, 0.0, *zero]},
                       **({"frame": "spinning"} if deep else {})},
            "plate": {**body, "mesh": mesh(deep, [0.0, -SIDE], [2e-3, SIDE], [12, 5]),
                      "sets": {"under": {"nearest": [1e-3, 0.0, *zero]}},
                      "reference": clamped, "frame": "fixed"}},
        "joints": {"drive": {"use": "prescribed_motion", "of": "slider:push",
                             "x": {"use": "ramp", "end": 1.0, "final": 1.0},
                             **({"z": 0.0} if deep else {})}},
        "loads": {"press": {"use": "pressure", "on": [f"slider:{up}"], "pressure": 1e7},
                  "weight": {"use": "gravity", "g": [0.0, -9.81, *zero]}},
        "contacts": {"sole": {
            "use": "polygonal", "between": [f"slider:{down}", f"plate:{up}"],
            "normal": {"use": "elastic_foundation", "stiffness": 6.11e13, "damping": 6.1214e4,
                       "damping_depth": 1e-9},
            "friction": {"use": "coulomb", "coefficient": 0.2, "critical_velocity": 0.05},
            "heat": {"share": 0.5}}},
        "rigid_stage": {}, "time": {"end": 20 * STEP, "step": STEP}, "reducer": "full"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, RunResult]:
    kept = Cache(tmp_path_factory.mktemp("cache"))
    flat, deep = (simulate(scene_of(slider(which)), cache=kept) for which in (False, True))
    return flat, deep


@pytest.mark.full
def test_the_rigid_stage_is_that_of_the_plane(
    runs: tuple[RunResult, RunResult]
) -> None:
    """Same forces over the same area, so the same motion."""
    flat, deep = (run.stage() for run in runs)
    assert flat is not None and deep is not None
    one, other = flat.contacts["sole"], deep.contacts["sole"]
    assert one["normal"][-1] == pytest.approx(1e7 * SIDE * WIDTH, rel=2e-2)
    for name in ("normal", "friction", "power", "pressure"):
        size = float(np.abs(one[name]).max())
        np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-9 * size, err_msg=name)
    np.testing.assert_allclose(other["area"], one["length"] * WIDTH, rtol=1e-9)


def held(run: RunResult, deep: bool) -> FloatArray:
    """J in the bodies at the end, one after the other."""
    heat = assemble(scene_of(slider(deep))).separated.heat
    return np.array([h.capacity.sum(axis=0) @ run.block(h.thermal)[-1] for h in heat])


@pytest.mark.full
def test_the_flexible_stage_is_that_of_the_plane(
    runs: tuple[RunResult, RunResult]
) -> None:
    """The same heat to round-off; fields, as means over the width, to what elements leave open."""
    flat, deep = runs
    np.testing.assert_allclose(held(deep, True), held(flat, False), rtol=1e-9)
    for body in ("slider", "plate"):
        T = flat.nodal_temperature(body, -1)
        off = deep.nodal_temperature(body, -1).reshape(-1, 3).mean(axis=1) - T
        assert np.sqrt(np.mean(off**2)) < 0.025 * T.max()
        u = flat.nodal_displacement(body, -1)
        bent = deep.nodal_displacement(body, -1).reshape(len(u), 3, 3).mean(axis=1)
        np.testing.assert_allclose(bent[:, :2], u, rtol=0, atol=0.03 * np.abs(u).max())
