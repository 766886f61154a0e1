"""Static equilibria against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from analysed import NU, RHO, E, beam, value
from sparsemor import SolveFailed, load, open_result, simulate, solve

PUSH = {"push": {"use": "point_force", "on": "beam:right", "force": [0.0, -100.0]}}
STIFF = E * 0.02 * 0.05**3 / 12.0


@pytest.mark.full
def test_the_tip_of_a_cantilever() -> None:
    found = solve(beam(loads=PUSH), "static")
    shear = 6.0 / 5.0 * 2.0 * (1.0 + NU) / (E * 0.02 * 0.05)
    assert value(found, "tip.u_y") == pytest.approx(
        -100.0 * (1.0 / (3.0 * STIFF) + shear), rel=5e-3)


@pytest.mark.full
def test_reduced_static_solutions() -> None:
    full = value(solve(beam(loads=PUSH), "static"), "tip.u_y")
    basis = {"use": "modal", "count": 4, "correction": True}
    reduced = solve(beam(loads=PUSH, reducer={"use": "galerkin", "basis": basis}), "static")
    assert value(reduced, "tip.u_y") == pytest.approx(full, rel=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("load_factor, down, back", [(1.0, 0.30172, 0.05643),
                                                     (5.0, 0.71379, 0.38763)])
def test_the_elastica(load_factor: float, down: float, back: float) -> None:
    """P L^2 / E I = 1 and 5 (Mattiasson 1981, doi 10.1002/nme.1620170113, Table 1)."""
    force = load_factor * E * 0.02 * 0.01**3 / 12.0
    found = solve(beam(height=0.01, cells=(40, 1), strains="nonlinear", loads={
        "push": {"use": "point_force", "on": "beam:right", "force": [0.0, -force]}}), "static")
    assert -value(found, "tip.u_y") == pytest.approx(down, rel=3e-3)
    assert -value(found, "tip.u_x") == pytest.approx(back, rel=5e-3)


@pytest.mark.full
def test_a_pendulum_hangs_and_its_hinge_carries_the_weight() -> None:
    scene = load("double_pendulum", {"reducer": "full"})
    found = solve(scene, "static")
    mass = sum(b.total_mass or 0.0 for b in _bodies(scene))
    forces = [abs(float(r["value"])) for r in found.rows
              if "force" in r["quantity"] and r["unit"] == "N"]
    assert max(forces) == pytest.approx(9.81 * mass, rel=2e-3)


def _bodies(scene):  # type: ignore[no-untyped-def]
    from sparsemor.core.model.assembly import assemble

    return assemble(scene).bodies.values()


@pytest.mark.full
def test_a_spinning_rod_grows() -> None:
    omega = 300.0
    turn = {"use": "ramp", "end": 10.0, "final": 10.0 * omega}
    found = solve(beam(frame="floating", height=0.01, cells=(20, 1), joints={
        "hub": {"use": "prescribed_motion", "of": "beam:left", "x": 0.0, "y": 0.0,
                "angle": turn}}), "static", spin=True)
    assert value(found, "tip.u_x") == pytest.approx(RHO * omega**2 / (3.0 * E), rel=2e-3)


def _free(force: float) -> dict:  # type: ignore[type-arg]
    return {"format": 1, "bodies": {"b": {"use": "rigid", "mass": 1.0, "inertia": 0.2,
                                          "points": {"o": [0.1, 0.0]}}},
            "loads": {"push": {"use": "point_force", "on": "b:o", "force": [force, 0.0]}},
            "time": {"end": 0.1, "step": 1e-3}}


@pytest.mark.full
def test_a_free_body_under_a_force_has_no_equilibrium() -> None:
    with pytest.raises(SolveFailed, match="moves freely"):
        solve(load(_free(1.0)), "static")


def test_a_free_body_without_force_is_held() -> None:
    (note,) = solve(load(_free(0.0)), "static").notes
    assert note.kind == "held" and note.text.startswith("3 rigid motions of b ")


@pytest.mark.full
def test_a_run_starts_from_a_static_state_and_stays(tmp_path: Path) -> None:
    scene = beam(loads=PUSH)
    found = solve(scene, "static", out=tmp_path / "static")
    assert (tmp_path / "static" / "static.csv").is_file()
    assert (tmp_path / "static" / "static.png").stat().st_size > 1000
    run = simulate(scene.using({"initial": {"result": str(tmp_path / "static")}}))
    tip = run.probe("tip")[:, 3]
    np.testing.assert_allclose(tip, value(found, "tip.u_y"), rtol=1e-7)
    assert open_result(tmp_path / "static").summary["states"] == ["static at 0.01 s"]
