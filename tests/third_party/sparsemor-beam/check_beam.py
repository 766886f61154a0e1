"""Laws and physics of the beam, as its authors would test it."""

from dataclasses import replace
from functools import cache
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sparsemor_beam import Beam

from sparsemor import load, simulate
from sparsemor.core import DofLocations, Registry, Scene
from sparsemor.core.linalg.linear_solver_checks import rigid_motions
from sparsemor.core.testing import check_body, check_joint, check_load, check_parts

HERE = Path(__file__).parent
L, A, J, E, RHO = 1.0, 4e-4, 1.333e-8, 5e9, 1200.0
BEAM = {"use": "beam", "length": L, "area": A, "second_moment": J, "modulus": E, "density": RHO}


def scene(body: dict[str, Any], **others: Any) -> Scene:
    return Scene.model_validate({"format": 1, "bodies": {"beam": {**BEAM, **body}}, **others})


def pendulum(**changes: Any) -> Scene:
    return load(HERE / "scenes" / "pendulum.yaml", changes)


@pytest.mark.parametrize("reference", ["clamp", "chord"])
def test_laws_of_the_body(reference: str) -> None:
    check_body(Beam(length=L, area=A, second_moment=J, modulus=E, density=RHO,
                    reference=reference), points=["left", "middle", "right"])


def test_laws_of_joints_and_loads_of_the_product_on_it() -> None:
    find: Any = Registry().get
    check_parts(pendulum())
    check_joint(find("joint", "revolute")(between=("ground", "beam:right")), {"beam": BEAM})
    check_joint(find("joint", "fixed")(between=("ground", "beam:right")), {"beam": BEAM})
    check_load(find("load", "torque")(on="beam:middle", torque=1.0), {"beam": BEAM})


@cache
def full() -> Any:
    """The full-order run that other runs are compared with."""
    return simulate(pendulum())


def cantilever(**loads: Any) -> Any:
    """Final state under loads that act from the start, with so much damping that it is at rest."""
    body = {"frame": "fixed", "reference": "clamp", "damping": 0.05}
    return simulate(scene(body, loads=loads, time={"end": 4.0, "step": 0.02}, integrator="bdf1",
                          probes={"tip": {"body": "beam", "at": "right"}}))


def test_deflection_of_a_cantilever_is_that_of_the_textbook() -> None:
    """F L^3 / (3 E J) of a force, M L^2 / (2 E J) and slope M L / (E J) of a moment at the tip."""
    F, M = 0.2, 0.1
    for load_of_it, w, slope in (
            ({"use": "point_force", "on": "beam:right", "force": [0.0, F]},
             F * L**3 / (3 * E * J), F * L**2 / (2 * E * J)),
            ({"use": "torque", "on": "beam:right", "torque": M},
             M * L**2 / (2 * E * J), M * L / (E * J))):
        q = cantilever(tip=load_of_it).block("beam.elastic")[-1]
        assert q[-2:] == pytest.approx([w, slope], rel=1e-6)


def test_weight_of_a_cantilever_bends_it_as_a_load_per_length() -> None:
    """rho A g L^4 / (8 E J)."""
    q = cantilever(weight={"use": "gravity"}).block("beam.elastic")[-1]
    assert q[-2] == pytest.approx(-RHO * A * 9.81 * L**4 / (8 * E * J), rel=1e-6)


def test_first_bending_frequency_of_a_cantilever() -> None:
    """(1.8751 / L)^2 sqrt(E J / (rho A)), from the period of a free oscillation."""
    omega = (1.8751040687 / L) ** 2 * sqrt(E * J / (RHO * A))
    period = 2 * pi / omega
    kick = {"use": "point_force", "on": "beam:right", "force": [0.0, 1.0],
            "factor": {"use": "pulse", "start": 0.0, "duration": period / 2, "level": 0.01}}
    run = simulate(scene({"frame": "fixed", "reference": "clamp", "damping": 2e-4},
                         loads={"kick": kick}, integrator="generalized_alpha",
                         time={"end": 12 * period, "step": period / 200}))
    w, t = run.block("beam.elastic")[:, -2], run.times
    late = t > 4 * period  # higher modes are damped by then
    w, t = w[late], t[late]
    up = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    crossings = t[up] - w[up] * (t[up + 1] - t[up]) / (w[up + 1] - w[up])
    assert len(crossings) >= 6
    assert 2 * pi / np.diff(crossings).mean() == pytest.approx(omega, rel=2e-3)


def energy(run: Any) -> np.ndarray:
    """Kinetic and potential energy of a stiff pendulum of a beam on a joint, J."""
    q, v = run.block("beam.rigid"), np.gradient(run.block("beam.rigid"), run.times, axis=0)
    m = RHO * A * L
    centre = q[:, :2] + 0.5 * L * np.stack([np.cos(q[:, 2]), np.sin(q[:, 2])], axis=1)
    speed = np.gradient(centre, run.times, axis=0)
    return (0.5 * m * (speed**2).sum(axis=1) + m * L**2 / 24 * v[:, 2] ** 2
            + m * 9.81 * centre[:, 1])


def test_a_stiff_beam_on_a_joint_is_a_pendulum() -> None:
    """As a rigid rod of the same mass and inertia, and with constant energy."""
    others = {"loads": {"weight": {"use": "gravity"}}, "time": {"end": 0.5, "step": 1e-3}}
    stiff = simulate(scene({"modulus": 1e14}, joints={
        "top": {"use": "revolute", "between": ["ground", "beam:left"]}}, **others))
    m = RHO * A * L
    rod = {"use": "rigid", "mass": m, "inertia": m * L**2 / 12, "center": [L / 2, 0.0],
           "points": {"left": [0.0, 0.0]}}
    rigid = simulate(Scene.model_validate({"format": 1, "bodies": {"beam": rod}, "joints": {
        "top": {"use": "revolute", "between": ["ground", "beam:left"]}}, **others}))
    assert np.abs(stiff.block("beam.rigid") - rigid.block("beam.rigid")).max() < 1e-5
    E_t = energy(stiff)[5:-5]
    assert np.ptp(E_t) < 2e-2 * np.ptp(RHO * A * L * 9.81 * stiff.block("beam.rigid")[:, 2])


def test_a_double_pendulum_with_a_rigid_body_of_the_product() -> None:
    """The joints hold, the beam bends, and its end is at the same place under both reference
    conditions, but for terms that are quadratic in its displacements of 7 mm."""
    runs = {r: simulate(pendulum(**{"bodies.beam.reference": r})) for r in ("chord", "clamp")}
    place = {}
    for name, run in runs.items():
        place[name], moved = np.hsplit(run.probe("elbow"), 2)
        assert np.abs(place[name] - run.block("rod.rigid")[:, :2]).max() < 1e-9
        assert np.abs(moved).max() > 5e-3 or name == "chord"
    assert np.abs(place["chord"] - place["clamp"]).max() < 1e-4


@pytest.mark.parametrize("reducer", [
    "galerkin", {"use": "sparse", "budgets": {"*": {"rows": 21, "atoms": 8}}}])
def test_reduced_runs_follow_the_full_one(reducer: Any) -> None:
    reduced = simulate(pendulum(reducer=reducer))
    for block in ("beam.rigid", "rod.rigid", "beam.elastic"):
        x, y = full().block(block), reduced.block(block)
        assert np.abs(x - y).max() < 0.02 * np.abs(x - x[0]).max(), block


def test_a_rigid_pre_simulation_takes_it_without_its_field() -> None:
    run = simulate(pendulum(rigid_stage={}, **{"bodies.beam.modulus": 5e11}))
    assert run.stage() is not None and np.abs(run.block("beam.elastic")).max() > 0.0


def test_a_load_on_a_surface_is_refused_by_name() -> None:
    with pytest.raises(Exception, match="beam.*has no nodes of a mesh"):
        simulate(pendulum(**{"loads.press": {"use": "pressure", "on": ["beam:left"],
                                             "pressure": 1.0}}))


def test_iterative_solvers_take_rotations() -> None:
    """Their coarse space has the rigid motions, in which nodes turn."""
    x, y = (run.block("beam.elastic") for run in (full(), simulate(pendulum(linear_solver="cg"))))
    assert np.abs(x - y).max() < 1e-6 * np.abs(x).max()


def test_a_rigid_motion_strains_no_element() -> None:
    beam = Beam(length=L, area=A, second_moment=J, modulus=E, density=RHO, reference="chord")
    whole = beam.build("beam", HERE)
    n = 3 * len(whole.nodes)
    every = replace(whole, beam=beam.model_copy(update={"reference": "none"}))
    K, motions = every.stiffness, rigid_motions(DofLocations(*every.geometry()["beam.elastic"]))
    assert motions.shape == (n, 3)
    assert np.abs(K @ motions).max() < 1e-9 * np.abs(K).max()
