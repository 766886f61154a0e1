"""Heat of joint friction: equal to the work lost, in the plane and in space, of given forces and of
joint forces, on turns and slides, shared between the sides, reduced and kept."""

from typing import Any

import numpy as np
import pytest

from sparsemor import load, reduce, simulate
from sparsemor.bodies.joints.joint_heat import FrictionHeat
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.term import check_term

STEEL = {"rho": 7800.0, "k": 40.0, "c": 500.0, "E": 2e11, "nu": 0.3}
Z = {2: {}, 3: {"axis": [0.0, 0.0, 1.0]}}


def bar(d: int, fields: list[str], **more: Any) -> dict[str, Any]:
    size, parts = [0.2, 0.02, 0.02][:d], [8, 2, 1][:d]
    lower = [-0.1, -0.01, -0.01][:d]
    body = {"use": "flexible", "mesh": {"use": "rectangle" if d == 2 else "block", "size": size,
                                        "lower": lower, "divisions": parts},
            "material": STEEL, "fields": fields, "reference": {"clamp": "left"} if (
                "elastic" in fields) else None, **more}
    if d == 2:
        body["thickness"] = 0.02
    return {k: v for k, v in body.items() if v is not None}


def spin(d: int, rate: float) -> dict[str, Any]:
    return {"pose": {"spin": rate if d == 2 else [0.0, 0.0, rate]}}


def brake(d: int, fields: tuple[str, ...] = ("thermal",), **friction: Any) -> dict[str, Any]:
    """A bar that turns about its middle at 20 rad/s, on a plate that stands still."""
    hub = {"sets": {"hub": {"box": [[-0.03, 0.03]] * d}}}
    return {
        "format": 1, "bodies": {
            "bar": bar(d, list(fields), **hub, **spin(d, 20.0)),
            "plate": bar(d, ["thermal"], **hub)},
        "joints": {"bolt": {"use": "fixed", "between": ["ground", "plate:left"]},
                   "pin": {"use": "revolute", "between": ["plate:hub", "bar:hub"], **Z[d],
                           "conductance": 0.0},
                   "rub": {"use": "joint_friction", "between": ["bar:hub", "plate:hub"], **Z[d],
                           "heat": 0.75, "critical_rate": 0.1, **friction}},
        "time": {"end": 0.1, "step": 2.5e-3}, "reducer": "full",
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.9}}


def stored(scene: Any, run: Any) -> list[float]:
    """Heat, J, that each body has stored since the start."""
    return [float((b.capacity @ (run.block(b.thermal)[-1] - run.block(b.thermal)[0])).sum())
            for b in assemble(scene).separated.heat]


@pytest.mark.full
@pytest.mark.parametrize("d", [2, 3])
def test_heat_is_the_work_lost(d: int) -> None:
    """A moment of 0.2 N m slows the bar down in 0.1 s; three quarters of the heat enter the bar."""
    scene = load(brake(d, force=0.2))
    run = simulate(scene)
    bar, plate = stored(scene, run)
    m = 7800.0 * 0.2 * 0.02 * 0.02
    J = m * (0.2**2 + 0.02**2) / 12
    rate = 20.0 - 0.2 / J * 0.1
    work = 0.5 * J * (20.0**2 - rate**2)
    assert work > 0.3
    assert bar + plate == pytest.approx(work, rel=1e-3)
    assert bar == pytest.approx(0.75 * (bar + plate), rel=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("d", [2, 3])
def test_heat_of_friction_by_joint_forces(d: int) -> None:
    """Gravity presses the pin with m g: the moment mu r m g."""
    data = {**brake(d, joint="pin", coefficient=0.3, radius=0.01, heat=1.0),
            "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81, 0.0][:d]}}}
    data["joints"]["pin"] |= {"between": ["ground", "bar:hub"], "conductance": None}
    data["joints"]["rub"]["between"] = ["bar:hub", "ground"]
    scene = load(data)
    run = simulate(scene)
    m = 7800.0 * 0.2 * 0.02 * 0.02
    J, M = m * (0.2**2 + 0.02**2) / 12, 0.3 * 0.01 * m * 9.81
    work = 0.5 * J * (20.0**2 - (20.0 - M / J * 0.1) ** 2)
    assert sum(stored(scene, run)) == pytest.approx(work, rel=1e-3)


@pytest.mark.full
@pytest.mark.parametrize("d", [2, 3])
def test_in_two_stages_the_heat_is_a_load(d: int) -> None:
    """Along the motion of a rigid stage, nearly that of one stage."""
    data = brake(d, ("elastic", "thermal"), force=0.2)
    one, two = (simulate(load(s)) for s in (data, {**data, "rigid_stage": {}}))
    for name in ("bar", "plate"):
        rise = one.nodal_temperature(name, -1) - 293.15
        assert np.abs(two.nodal_temperature(name, -1) - 293.15 - rise).max() < 1e-3 * rise.max()


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["sparse", "ecsw"])
def test_reduced_and_kept_models(reducer: str) -> None:
    scene = load({**brake(2, ("elastic", "thermal"), force=0.2),
                  "time": {"end": 0.05, "step": 2.5e-3}})
    full = simulate(scene)
    small = scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 8}}})
    for run in (simulate(small), reduce(small).run()):
        for name in ("bar", "plate"):
            T = full.nodal_temperature(name, -1)
            assert np.abs(run.nodal_temperature(name, -1) - T).max() < 1e-4 * np.ptp(T)


@pytest.mark.full
def test_what_leaves_the_model_is_noted_and_what_heats_nothing_refused() -> None:
    scene = brake(2, force=0.2)
    scene["joints"]["rub"]["between"] = ["bar:hub", "ground"]
    scene["joints"]["pin"]["between"] = ["ground", "bar:hub"]
    del scene["joints"]["pin"]["conductance"]
    run = simulate(load(scene))
    assert any("25 % of the heat of friction" in n for n in run.summary["information"])
    scene["bodies"]["bar"]["fields"] = []
    with pytest.raises(InputError, match="neither side has a temperature"):
        simulate(load(scene))


@pytest.mark.full
@pytest.mark.parametrize("d, motion", [(2, "slide"), (3, "turn")])
def test_laws_of_the_term(d: int, motion: str) -> None:
    """Derivatives, rows and projections, at joint forces that are not zero."""
    slides = {} if motion == "turn" else {"motion": "slide", "axis": [1.0, 0.0, 0.0][:d]}
    arm = {"radius": 0.01} if motion == "turn" else {}
    data = brake(d, joint="pin", coefficient=0.3, force=0.1, **arm, **slides)
    if motion == "slide":
        data["joints"]["pin"] |= {"use": "prismatic", "axis": [1.0, 0.0, 0.0][:d]}
    terms = [t for t in assemble(load(data)).terms if isinstance(t, FrictionHeat)]
    assert len(terms) == 2
    for term in terms:
        base = np.where(np.arange(len(term.columns)) >= sum(term.power.sizes), 3.0, 0.1)
        if d == 3:
            base[[3, 10]] = 1.0
        check_term(term, np.random.default_rng(5), base=base, scale=1e-3)
