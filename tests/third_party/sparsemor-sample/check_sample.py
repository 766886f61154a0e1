"""Laws, scenes and one study of the sample package, as its authors would test it."""

import json
from math import cos, sqrt
from pathlib import Path

import pytest
from alloys import TABLE, Alloy
from calm_air import CalmAir
from idle import Idle
from span import span
from sparsemor_sample import EveryNth, HardThresholding, PowerLaw, Trapezoidal
from sparsemor_sample_parts import Gear, Ring, Spring
from thermal_contact import ContactResistance

from sparsemor import load, simulate, study
from sparsemor.core.testing import (
    check_body,
    check_check,
    check_integrator,
    check_joint,
    check_load,
    check_material,
    check_normal_law,
    check_parts,
    check_reducer,
    check_sampler,
    check_sparse_solver,
)

HERE = Path(__file__).parent
WHEELS = {"small": {"use": "ring", "mass": 1.0, "radius": 0.1},
          "large": {"use": "ring", "mass": 3.0, "radius": 0.2}}


def scene(name: str, **changes: object):
    return load(HERE / "scenes" / f"{name}.yaml", changes)


def test_laws_of_methods() -> None:
    check_sampler(EveryNth())
    check_integrator(Trapezoidal())
    check_normal_law(PowerLaw(stiffness=1e11))
    check_sparse_solver(HardThresholding())


@pytest.mark.parametrize("name", TABLE)
def test_laws_of_a_material(name: str) -> None:
    check_material(Alloy(name=name))


def test_an_alloy_is_the_material_of_its_constants() -> None:
    constants = vars(TABLE["6061-T6"])
    one, other = (simulate(scene("bar", **{"bodies.bar.material": m})) for m in (
        {"use": "alloy", "name": "6061-T6"}, constants))
    for block in ("bar.rigid", "bar.elastic", "bar.thermal"):
        assert (one.block(block) == other.block(block)).all()
    titanium = simulate(scene("bar", **{"bodies.bar.material.name": "Ti-6Al-4V"}))
    assert (one.block("bar.thermal") != titanium.block("bar.thermal")).any()


def test_a_run_tells_what_never_changes() -> None:
    check_check(Idle(), scene("plate"))
    run = simulate(load({"bodies": WHEELS, "time": {"end": 0.1, "step": 0.01}}))
    assert run.summary["idle"] == ["small.rigid", "large.rigid"]
    assert "small.rigid never changes" in run.summary["information"]
    assert simulate(scene("plate")).summary["idle"] == []


def test_laws_of_parts() -> None:
    check_body(Ring(mass=1.0, radius=0.1))
    check_joint(Gear(between=("small:rim", "large:rim"), ratio=2.0), WHEELS)
    check_load(Spring(on="small:rim", to=(0.1, 0.2), stiffness=50.0), WHEELS)


def test_laws_of_loads_on_flexible_bodies() -> None:
    bodies = scene("bars").bodies
    check_load(Spring(on="hot:right", to=(0.5, 0.1), stiffness=50.0), bodies)
    check_load(ContactResistance(between=("hot:left", "cold:right"), conductance=5.0), bodies)


def test_laws_of_a_pointwise_law() -> None:
    check_load(CalmAir(on=["plate:top"], C=20.0, temperature=300.0), scene("plate").bodies)


@pytest.mark.parametrize("reducer", ["full", "deim", "ecsw"])
def test_a_plate_in_calm_air_cools_as_one_lump(reducer: str) -> None:
    """s' = -(C / (rho c H)) s^(5/4) with s = T - T_air: s^(-1/4) grows linearly."""
    chosen = {"use": "full"} if reducer == "full" else {
        "use": reducer, "basis": {"use": "pod", "count": 2}}
    run = simulate(scene("plate", reducer=chosen))
    rate = 20.0 / (1000 * 500 * 0.01)
    want = 300.0 + (200.0**-0.25 + 0.25 * rate * 50.0) ** -4
    T = run.nodal_temperature("plate", -1)
    assert want < 450.0
    assert abs(T - want).max() < 0.2


def test_laws_of_the_reducer() -> None:
    check_reducer(scene("bars", reducer="oblique"))


@pytest.mark.parametrize("name", ["gears", "bars"])
def test_scenes_keep_the_laws_of_parts(name: str) -> None:
    check_parts(scene(name))


def test_the_ring_swings_on_its_spring() -> None:
    run = simulate(scene("ring"))
    assert run.block("wheel.rigid")[-1, 0] == pytest.approx(0.1 * cos(sqrt(50.0 / 2.0)), abs=1e-5)


def test_the_gear_adds_the_inertias() -> None:
    """Moment 4 N at 0.1 m on m r^2 of the small wheel and a quarter of that of the large one."""
    run = simulate(scene("gears"))
    small, large = (run.block(f"{w}.rigid")[-1, 2] for w in ("small", "large"))
    assert small == pytest.approx(0.5 * 0.4 / (0.01 + 0.12 / 4.0) * 0.2**2, rel=1e-6)
    assert large == pytest.approx(-small / 2.0, rel=1e-9)


def test_the_block_comes_to_rest_on_its_law() -> None:
    """The depth swings about (weight / (K area))^(2/3), from zero to (5/2)^(2/3) of it."""
    run = simulate(scene("press"))
    depth = -run.block("block.rigid")[:, 1]
    rest = (2700 * 9.81 * 0.05 / 1e11) ** (2.0 / 3.0)
    assert depth.max() == pytest.approx(2.5 ** (2.0 / 3.0) * rest, rel=0.05)


def test_the_study_compares_its_methods(tmp_path: Path) -> None:
    rows = {row["method"]: row for row in study(HERE / "methods.yaml", out=tmp_path / "table")}
    assert [row["status"] for row in rows.values()] == ["done"] * 6
    for name in ("galerkin", "oblique", "thresholded", "other_integrator"):
        assert float(rows[name]["error_elastic"]) < 1e-3, name
        assert float(rows[name]["error_thermal"]) < 1e-5, name


def test_the_command_prints_the_range_of_the_unknowns(capsys: pytest.CaptureFixture[str]) -> None:
    span(str(HERE / "scenes" / "plate.yaml"), "plate.thermal")
    (cold, hot), = json.loads(capsys.readouterr().out).values()
    assert 300.0 < cold < hot
