"""Contact in space inside the step: columns that deform, layers that conduct, a miss."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.testing.in_memory_run import march, scene_of

RHO = 1000.0
SIZE = (0.1, 0.06, 0.05)
LOW = (-0.05, -0.03, 0.0)


def brick(
    lower: tuple[float, ...], size: tuple[float, ...], divisions: tuple[int, ...], **options: Any
) -> dict[str, Any]:
    mesh = {"use": "block", "lower": lower, "size": size, "divisions": divisions}
    return {"use": "flexible", "mesh": mesh, "material": {"rho": RHO}, "fields": [], **options}


def column(floor: float, divisions: tuple[int, ...], **options: Any) -> dict[str, Any]:
    material = {"rho": RHO, "E": 1e9, "nu": 0.0}
    return brick((0.0, 0.0, floor), (0.1, 0.1, 0.1), divisions, **options) | {
        "fields": ["elastic"], "material": material}


@pytest.mark.full
def test_an_elastic_column_on_another_sinks_by_all_three_springs() -> None:
    """Both surfaces deform: p / K + p H / E for each column; without Poisson's ratio exactly."""
    pressure, K, E, side = 1e6, 1e11, 1e9, 0.1
    found = march(scene_of({
        "bodies": {
            "upper": column(0.0, (2, 1, 1), reference={"clamp": "top"}, frame="spinning"),
            "lower": column(-side, (1, 2, 1), reference={"clamp": "bottom"}, frame="fixed")},
        "contacts": {"joint": {
            "use": "polygonal", "between": ["upper:bottom", "lower:top"], "surfaces": "deformed",
            "normal": {"use": "elastic_foundation", "stiffness": K}}},
        "joints": {"upright": {"use": "prismatic", "between": ["ground", "upper:top"],
                               "axis": [0, 0, 1]}},
        "loads": {"press": {"use": "pressure", "on": ["upper:top"], "pressure": pressure}},
        "integrator": "bdf1", "time": {"end": 0.2, "step": 0.01}}))
    sunk = -found.block("upper.rigid")[-1, 2]
    assert sunk == pytest.approx(pressure / K + 2 * pressure * side / E, rel=1e-8)
    u = found.block("lower.elastic")[-1]
    assert u[2::3].min() == pytest.approx(-pressure * side / E, rel=1e-8)  # a patch test


@pytest.mark.full
def test_layers_in_a_row_carry_the_heat_of_their_resistances() -> None:
    side, conductance, k = 0.05, 2e3, 45.0

    def layer(floor: float, divisions: tuple[int, ...]) -> dict[str, Any]:
        return brick((0.0, 0.0, floor), (side,) * 3, divisions, frame="fixed") | {
            "fields": ["thermal"], "material": {"rho": 7800.0, "k": k, "c": 480.0},
            "reference_temperature": 0.0}

    found = march(scene_of({
        "bodies": {"block": layer(0.0, (2, 1, 2)), "base": layer(-side, (1, 3, 1))},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["block:bottom", "base:top"],
            "normal": {"use": "elastic_foundation", "stiffness": 1e10},
            "heat": {"conductance": conductance}}},
        "joints": {"hot": {"use": "prescribed_temperature", "on": ["block:top"],
                           "temperature": 100.0},
                   "cold": {"use": "prescribed_temperature", "on": ["base:bottom"],
                            "temperature": 0.0}},
        "integrator": "bdf1", "time": {"end": 2e5, "step": 2e4}}))
    flux = 100.0 / (2 * side / k + 1 / conductance)
    warm, cool = found.block("block.thermal")[-1], found.block("base.thermal")[-1]
    assert warm.min() == pytest.approx(100.0 - flux * side / k, rel=1e-7)
    assert cool.max() == pytest.approx(flux * side / k, rel=1e-7)


@pytest.mark.full
def test_surfaces_that_never_meet_are_told_at_the_end(tmp_path: Path) -> None:
    scene = scene_of({
        "bodies": {"block": brick(LOW, SIZE, (1, 1, 1), pose={"position": [0.0, 0.0, 0.05]}),
                   "plate": brick((-0.2, -0.2, -0.1), (0.4, 0.4, 0.1), (2, 2, 1),
                                  frame="fixed")},
        "contacts": {"sole": {"use": "polygonal", "between": ["block:bottom", "plate:top"],
                              "normal": {"use": "elastic_foundation", "stiffness": 1e9}}},
        "time": {"end": 1e-3, "step": 1e-4}})
    result = simulate(scene, out=tmp_path / "apart", cache=Cache(tmp_path))
    (told,) = [n for n in result.summary["notes"] if "never met" in n]
    assert "contact sole" in told and "0.05 m" in told
