"""Thermal expansion, bending and vibration from scene files to states (scenes.md, V1, V2, V8)."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.in_memory_run import March, march, scene_of

ALLOY = {"E": 7e10, "nu": 0.3, "rho": 1000, "alpha": 2e-5}
WARM = {"k": 44.5, "c": 475}


def still(body: dict[str, Any], end: float = 50.0, **rest: Any) -> March:
    """The static answer: the implicit Euler rule with long steps forgets all motion."""
    return march(scene_of({
        "bodies": {"body": {"use": "flexible", "frame": "fixed", "thickness": 0.03, **body}},
        "time": {"end": end, "step": end / 10}, "integrator": "bdf1", **rest}))


def displacement(run: March, where: str, at: int = -1) -> FloatArray:
    """Mean displacement of a set, (2,) m."""
    body: Any = run.model.parts["body"]
    u = np.zeros(2 * len(body.X))
    u[body.elasticity.free] = run.block("body.elastic")[at]
    return np.asarray(u.reshape(-1, 2)[body.points[where]].mean(axis=0))


@pytest.mark.parametrize("model,factor,fields", [
    ("plane_stress", 1.0, ["elastic", "thermal"]), ("plane_strain", 1.3, ["elastic"])],
    ids=["solved", "given"])
def test_free_expansion(model: str, factor: float, fields: list[str]) -> None:
    """V1, with the temperature given at the start, and with it raised by a surrounding fluid."""
    loads, start = {}, 393.15
    if "thermal" in fields:
        sides = [f"body:{s}" for s in ("left", "right", "top", "bottom")]
        loads, start = {"bath": {"use": "convection", "on": sides, "film": 1e4,
                                 "temperature": 393.15}}, 293.15
    run = still({
        "mesh": {"use": "rectangle", "size": [1.0, 0.17], "divisions": [12, 4]}, "model": model,
        "material": {**ALLOY, **WARM}, "fields": fields, "initial_temperature": start,
        "reference": {"chord": ["bottom_left", "bottom_right"]}}, end=1e6, loads=loads)
    want = factor * np.array([2e-3, 3.4e-4])
    np.testing.assert_allclose(displacement(run, "top_right"), want, rtol=1e-9)


@pytest.mark.full
def test_a_linear_gradient_bends_as_the_finite_elements_do() -> None:
    """V2 with heat: the hot top and the cold bottom are held, the steady profile is linear."""
    hold = {"use": "prescribed_temperature"}
    run = still({
        "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [1.0, 0.1],
                 "divisions": [80, 8]},
        "sets": {"root": {"nearest": [0.0, 0.0]}, "low": {"nearest": [0.0, -0.05]},
                 "tip": {"nearest": [1.0, 0.0]}},
        "material": {**ALLOY, **WARM}, "fields": ["elastic", "thermal"],
        "reference": {"chord": ["root", "low"]}}, end=1e6, joints={
            "hot": {**hold, "on": ["body:top"], "temperature": 343.15},
            "cold": {**hold, "on": ["body:bottom"], "temperature": 243.15}})
    tip = displacement(run, "tip")[1]
    assert tip == pytest.approx(-9.534e-3, rel=2e-3)  # this chord is short: 0.05 m
    assert tip == pytest.approx(-0.01, rel=0.05)  # -kappa L^2 / 2, kappa = alpha dT / H


def cantilever(columns: int, rows: int, **rest: Any) -> dict[str, Any]:
    return {
        "bodies": {"body": {
            "use": "flexible", "frame": "fixed", "thickness": 0.03, "material": ALLOY,
            "mesh": {"use": "rectangle", "size": [1.0, 0.1], "divisions": [columns, rows]},
            "fields": ["elastic"], "reference": {"clamp": "left"}}}, **rest}


def frequencies(tree: dict[str, Any]) -> FloatArray:
    """The lowest two of the assembled block, Hz."""
    data = assemble(scene_of(tree)).block_data("body.elastic")
    values = eigsh(data.stiffness.tocsc(), 2, data.mass.tocsc(), sigma=0, v0=np.ones(data.size),
                   return_eigenvectors=False)
    return np.asarray(np.sqrt(np.sort(values)) / (2 * np.pi))


def test_frequencies_of_the_assembled_cantilever() -> None:
    """V8: 137.884 and 826.74 Hz on 80 x 8 quads."""
    tree = cantilever(80, 8, time={"end": 1.0, "step": 1.0})
    assert frequencies(tree) == pytest.approx([137.884, 826.74], rel=1e-5)


