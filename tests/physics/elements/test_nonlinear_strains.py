"""Nonlinear strains (St. Venant-Kirchhoff) against closed forms of beams: stiffening by spin,
softening by pressure and heat, large deflections; and reduced models of such bodies."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slender_beams import (
    ALPHA,
    EULER,
    STILL,
    E,
    H,
    L,
    beam,
    column,
    middle,
    plain,
    spinning,
    tip,
)
from sparsemor import load_model, reduce, simulate
from sparsemor.bodies.fem.stress import CellStress
from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.stability.survey import survey
from sparsemor.plugins.stability.variants import SurveyPlan


@pytest.mark.full
@pytest.mark.parametrize("strains, share", [
    ("nonlinear", 0.5), ("nonlinear", -0.5), ("prestressed", 0.5), ("prestressed", -0.5)])
def test_axial_force_softens_and_stiffens_a_bar(strains: str, share: float) -> None:
    """Deflection w / (1 - P / P_E); with linear strains it does not change."""
    run = simulate(column(strains, share * EULER))
    assert middle(run) / plain() == pytest.approx(1.0 / (1.0 - share), rel=0.01)
    assert not run.summary["notes"]


@pytest.mark.full
@pytest.mark.parametrize("strains, fields", [
    ("nonlinear", ("elastic", "thermal")), ("prestressed", ("elastic",))])
def test_heat_softens_a_bar_between_walls(strains: str, fields: Any) -> None:
    """Half the thermal Euler load, E A alpha dT = P_E / 2, doubles the deflection."""
    rise = 0.5 * EULER / (E * H * H * ALPHA)
    run = simulate(column(strains, 0.0, rise, fields))
    assert middle(run) / plain() == pytest.approx(2.0, rel=0.01)


@pytest.mark.full
@pytest.mark.parametrize("fields", [("elastic",), ("elastic", "thermal")])
def test_a_modulus_that_falls_with_temperature_lowers_the_buckling_load(fields: Any) -> None:
    """At half the modulus a quarter of the Euler load doubles the deflection, which is twice the
    cold one before; also where temperatures are no unknowns."""
    curve = {"temperatures": [293.15, 393.15], "values": [E, E / 2]}
    run = simulate(column("nonlinear", 0.25 * EULER, 100.0, fields, curve))
    assert middle(run) / plain() == pytest.approx(4.0, rel=0.01)


@pytest.mark.full
@pytest.mark.parametrize("space", [False, True])
def test_the_elastica(space: bool) -> None:
    """Tip load P L^2 / (E I) = 2: 0.4935 L down, 0.1606 L back (elliptic integrals); the stress of
    bending is M h / (2 I) with the lever arm of the deformed beam."""
    inertia = H**4 / 12.0
    P = 2.0 * E * inertia / L**2
    run = simulate(scene_of({
        "bodies": {"b": beam(16, space, frame="fixed")}, **STILL, "loads": {"f": {
            "use": "traction", "on": ["b:right"], "traction": [0.0, -P / H**2, 0.0][: 2 + space],
            "factor": {"use": "smooth_step", "end": 5e3, "final": 1.0}}}}))
    assert not run.summary["notes"]
    back, down = -tip(run)[:2]
    assert down == pytest.approx(0.4935, rel=3e-3)
    assert back == pytest.approx(0.1606, rel=5e-3)
    X = run.points("b")
    at = np.flatnonzero((X[:, 0] == L / 4) & (np.abs(X[:, 1]) == H / 2))
    arm = L - back - (X + run.nodal_displacement("b", -1))[at, 0].mean()
    want = P * arm * H / (2 * inertia)
    assert run.von_mises("b", -1)[at].mean() == pytest.approx(want, rel=0.015)


def test_a_turned_bar_has_no_stress() -> None:
    """Green-Lagrange strains of a rotation vanish; a stretch along the turned axis gives the
    stress of the stretch in turned axes."""
    X = np.array([[0, 0], [2, 0], [0, 1], [1, 0], [1, 0.5], [0, 0.5]], dtype=float)
    recovery = CellStress(X, np.arange(6)[None], np.array([[0.0, E / 2, 0.0, 0.0, 0.0]]),
                              np.zeros(1, int), nonlinear=True)
    c, s = np.cos(0.7), np.sin(0.7)
    A = np.array([[c, -s], [s, c]])
    cold = np.zeros(len(X))
    assert np.abs(recovery.stress(X @ A.T - X, cold)).max() < 1e-9 * E
    assert np.abs(recovery.strain(X @ A.T - X, cold)).max() < 1e-12
    stretch = np.diag([1.001, 1.0])
    sigma = recovery.stress(X @ (A @ stretch).T - X, cold)
    along = 1.001 * E * 0.5 * (1.001**2 - 1.0)  # F S F^T / det F
    want = np.zeros((3, 3))
    want[:2, :2] = A @ np.diag([along, 0.0]) @ A.T
    assert np.abs(sigma - want).max() < 1e-6 * along


@pytest.mark.full
@pytest.mark.parametrize(("ratio", "want"), [(0.4, 3.451e-4), (0.8, 3.142e-4)])
def test_a_spinning_beam_is_stiffened(ratio: float, want: float) -> None:
    """Tip deflection, m; a beam element model with centrifugal stiffness knows it. Linear strains
    give 4.231e-4 and 9.732e-4."""
    assert tip(simulate(spinning(ratio, "nonlinear")))[1] == pytest.approx(want, rel=2e-3)


@pytest.mark.full
def test_a_spin_beyond_linear_strains_is_noted_and_refused() -> None:
    scene = spinning(0.8, "linear", check_strains="refuse")
    with pytest.raises(SolveFailed, match="outside_theory.*take strains: nonlinear") as refused:
        simulate(scene)
    text = str(refused.value)
    assert "b is stiffened by 77 % at t = 1 s" in text
    assert "0.8 of its lowest natural frequency of 16.4" in text
    run = refused.value.result
    assert isinstance(run, RunResult) and run.summary["status"] == "outside_theory"
    assert len(run.times) == 11
    assert not kinds(simulate(spinning(0.8, "linear", check_strains="off")))
    assert not kinds(simulate(spinning(0.1, "linear")))


def rotating_beam(
    length: float, rho_A: float, stiffness: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Three modes of a cantilever: mass M, stiffness K, and the stiffness W^2 G of the tension
    N = rho A W^2 (L^2 - x^2) / 2, (3, 3); loads of an angular acceleration and of a tip force (3,):

        rho A (v_tt - W^2 v + W_t x) + E I v_xxxx - (N v_x)_x = 0;

    out of the plane of rotation without the terms - W^2 v and W_t x.
    """
    x = np.linspace(0.0, length, 2001)
    modes, slopes, curvatures = [], [], []
    for bL in (1.87510407, 4.69409113, 7.85475744):
        b = bL / length
        k = (np.cosh(bL) + np.cos(bL)) / (np.sinh(bL) + np.sin(bL))
        modes.append(np.cosh(b * x) - np.cos(b * x) - k * (np.sinh(b * x) - np.sin(b * x)))
        slopes.append(b * (np.sinh(b * x) + np.sin(b * x) - k * (np.cosh(b * x) - np.cos(b * x))))
        curvatures.append(b**2 * (np.cosh(b * x) + np.cos(b * x)
                                  - k * (np.sinh(b * x) + np.sin(b * x))))

    def over(f: Any, g: Any) -> FloatArray:
        return np.trapezoid(np.array(f)[:, None] * np.array(g)[None], x, axis=2)

    tension = 0.5 * rho_A * (length**2 - x**2)
    return (rho_A * over(modes, modes), stiffness * over(curvatures, curvatures),
            over(slopes, np.array(slopes) * tension),
            rho_A * np.trapezoid(np.array(modes) * x, x, axis=1), np.array(modes)[:, -1])


def spin_up(t: FloatArray) -> FloatArray:
    """Tip deflection (T,), m, of Kane's beam in its root frame, by three modes."""
    M, K, G, p, end = rotating_beam(10.0, 1.2, 1.4e4)

    def rates(time: float, y: FloatArray) -> FloatArray:
        W = 0.4 * (time - 7.5 / np.pi * np.sin(2 * np.pi * time / 15.0))
        accelerated = 0.4 * (1.0 - np.cos(2 * np.pi * time / 15.0))
        force = -p * accelerated - (K + W**2 * (G - M)) @ y[:3]
        return np.concatenate([y[3:], np.linalg.solve(M, force)])

    found = solve_ivp(rates, (0.0, t[-1]), np.zeros(6), t_eval=t, rtol=1e-8, atol=1e-10)
    return np.asarray(end @ found.y[:3])


@pytest.mark.full
def test_a_spinning_solid_blade() -> None:
    """Tip deflections under a force in and across the plane of rotation, at 0.8 of the lowest
    natural frequency, relative to those at rest, against three modes of a beam with tension."""
    height, modulus, rho = 0.05, 7e8, 2700.0
    M, K, G, _, end = rotating_beam(L, rho * height**2, modulus * height**4 / 12.0)
    spin = 0.8 * 3.51602 * height * np.sqrt(modulus / (12.0 * rho)) / L**2
    rest = end @ np.linalg.solve(K, end)
    want = [end @ np.linalg.solve(K + spin**2 * A, end) / rest for A in (G - M, G)]
    material = {"E": modulus, "nu": 0.0, "rho": rho}
    load = {"f": {"use": "traction", "on": ["b:right"], "traction": [0.0, 500.0, 500.0],
                  "axes": "body", "factor": {"use": "smooth_step", "end": 0.3, "final": 1.0}}}
    still = simulate(scene_of({
        "bodies": {"b": beam(8, True, height, material=material, frame="fixed")}, "loads": load,
        **STILL}))
    turning = simulate(scene_of({
        "bodies": {"b": beam(8, True, height, material=material, damping={"mass": 15.0},
                             frame="spinning", pose={"spin": [0.0, 0.0, spin]})}, "loads": load,
        "joints": {"j": {"use": "prescribed_motion", "of": "b:left", "x": 0.0, "y": 0.0, "z": 0.0,
                         "axis": [0, 0, 1], "angle": {
                             "use": "ramp", "start": 0.0, "end": 100.0, "final": 100.0 * spin}}},
        "time": {"end": 1.2, "step": 0.01}, "output": {"every": 20},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}}))
    np.testing.assert_allclose(tip(turning)[1:] / tip(still)[1:], want, rtol=0.01)


@pytest.mark.full
def test_the_spin_up_of_kane_ryan_and_banerjee() -> None:
    """Beam of 10 m, E I = 1.4e4 N m2, E A = 2.8e7 N, rho A = 1.2 kg/m, brought to 6 rad/s in 15 s
    (Kane, Ryan & Banerjee 1987; Simo & Vu-Quoc 1987): deflection by the independent beam above, and
    the stretch rho A W^2 L^3 / (3 E A) = 5.14e-4 m at the end. Linear strains diverge."""
    height = np.sqrt(12.0 * 5e-4)
    body = beam(16, height=height, damping={"mass": 0.0}) | {
        "thickness": 4e-4 / height, "material": {"E": 7e10, "nu": 0.0, "rho": 3000.0},
        "mesh": {"use": "rectangle", "lower": [0.0, -height / 2], "size": [10.0, height],
                 "divisions": [16, 1]}}
    c, ramp = 0.4 * (7.5 / np.pi) ** 2, {"use": "ramp", "end": 15.0, "final": 15.0}
    angle = {"use": "sum", "terms": [
        {"use": "product", "factors": [0.2, ramp, ramp]},
        {"use": "sine", "amplitude": c, "frequency": 1 / 15, "phase": np.pi / 2, "offset": -c}]}
    run = simulate(scene_of({
        "bodies": {"b": body}, "joints": {"j": {
            "use": "prescribed_motion", "of": "b:left", "x": 0.0, "y": 0.0, "angle": angle}},
        "time": {"end": 15.0, "step": 0.025}, "output": {"every": 10},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}}))
    end = run.points("b")[:, 0] == 10.0
    u = np.array([run.nodal_displacement("b", i)[end].mean(axis=0) for i in range(len(run.times))])
    want = spin_up(run.times)
    assert want.min() == pytest.approx(-0.57, abs=0.01)  # 0.57 to 0.58 m in the literature
    assert np.abs(u[:, 1] - want).max() < 0.02 * np.abs(want).max()
    assert u[-1, 0] == pytest.approx(1.2 * 36.0 * 1000.0 / (3 * 2.8e7), rel=0.02)


def swing(share: float = 0.7, space: bool = False, **more: Any) -> Scene:
    """A cantilever that a force bends and lets swing, with its reduced model."""
    P = share * E * 0.05**4 / 12.0 / 0.05**2
    return scene_of({
        "bodies": {"b": beam(3 if space else 8, space, 0.05, frame="fixed")},
        "loads": {"f": {"use": "traction", "on": ["b:right"],
                        "traction": [0.0, -P, 0.2 * P][: 2 + space],
                        "factor": {"use": "smooth_step", "end": 0.02, "final": 1.0}}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.6},
        "time": {"end": 0.03, "step": 1e-3}, "probes": {"end": {"body": "b", "at": "right"}},
        **more})


@cache
def whole(share: float, space: bool) -> RunResult:
    return simulate(swing(share, space))


def fields(run: RunResult) -> FloatArray:
    return np.array([run.nodal_displacement("b", i) for i in range(len(run.times))])


def with_reducer(use: str, **more: Any) -> dict[str, Any]:
    return {"reducer": {"use": use, "basis": {"use": "pod", "count": 16}, **more}}


@pytest.mark.full
@pytest.mark.parametrize(("space", "use"), [
    (False, "ecsw"), (False, "lspg"), (False, "sparse"), (True, "galerkin"), (True, "deim"),
    (True, "gnat")])
def test_reduced_models_repeat_the_run(space: bool, use: str) -> None:
    """A fifth of the length in ten steps, where each step needs the exact Jacobian. Those that
    minimise residuals in the norm of D^-1 need no more atoms than the others."""
    count = 10 if use in ("lspg", "gnat", "sparse") else 16
    want = fields(whole(0.7, space))
    run = simulate(swing(0.7, space, **with_reducer(use, basis={"use": "pod", "count": count})))
    off = np.linalg.norm(fields(run) - want) / np.linalg.norm(want)
    assert off < 1e-3, off


@pytest.mark.full
@pytest.mark.parametrize("use", ["galerkin", "ecsw", "sparse"])
def test_ten_atoms_are_right_or_warned(use: str) -> None:
    """Far from what they represent: an error of 1 % of the motion has a note or a status."""
    scene = swing(1.0, False, **with_reducer(use, basis={"use": "pod", "count": 10}))
    want = fields(whole(1.0, False))
    try:
        run = simulate(scene)
    except SolveFailed:
        return
    off = np.linalg.norm(fields(run) - want) / np.linalg.norm(want)
    assert off < 0.01 or run.summary["notes"], off


@pytest.mark.full
def test_plain_rows_that_fail_name_the_reducers_that_do_not() -> None:
    """Plain rows of nonlinear strains, with ten atoms in space, lose the motion, which ends as a
    failure; all rows do not (above)."""
    scene = swing(0.7, True, **with_reducer(
        "sparse", basis={"use": "pod", "count": 10}, sampler="deim", residual="plain"))
    with pytest.raises(SolveFailed, match="in b.elastic .*a reducer that tests all rows"):
        simulate(scene)


@pytest.mark.full
def test_a_kept_model_and_a_resumed_run_repeat_the_run(tmp_path: Path) -> None:
    """From a file, with another load; resumed from half the run."""
    scene = swing(0.3, **with_reducer("ecsw"), training={"end": 0.03})
    model = reduce(scene)
    model.save(tmp_path / "b.model")
    kept = load_model(tmp_path / "b.model")
    change = {"loads.f.factor.final": 0.8}
    probe = model.run(change).probe("end")
    np.testing.assert_allclose(kept.run(change).probe("end"), probe, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        simulate(scene.using({**change, "training.overrides": {"loads.f.factor.final": 1.0}}))
        .probe("end"), probe, rtol=0, atol=1e-9)
    for reducer in (scene, scene.using({"reducer": "full"})):
        out = tmp_path / reducer.reducer_name
        simulate(reducer.using({"time.end": 0.015}), out=out)
        again = simulate(reducer, out=out, resume=True)
        np.testing.assert_array_equal(again.probe("end"), simulate(reducer).probe("end"))


def kinds(run: RunResult) -> list[str]:
    return [n.split(";")[0] for n in run.summary["notes"]]


@pytest.mark.full
@pytest.mark.parametrize(("strains", "share", "want"), [
    ("linear", 0.5, "compressed to 50 % of its buckling load"),
    ("linear", -0.3, "stiffened by 30 % at"), ("linear", 0.03, ""),
    ("nonlinear", 2.0, "compressed to 2 times its buckling load at")])
def test_the_limit_of_linear_strains_is_noted(strains: str, share: float, want: str) -> None:
    """One eigenvalue of the geometric stiffness of a pinned bar: P / P_E."""
    found = kinds(simulate(column(strains, share * EULER)))
    assert len(found) == bool(want)
    assert all(want in text for text in found), found


@pytest.mark.full
@pytest.mark.parametrize(("share", "stable"), [(2.0, 0), (0.5, 1)])
def test_a_bar_beyond_its_buckling_load_is_not_called_stable(share: float, stable: int) -> None:
    scene = column("linear", share * EULER).using({
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 4}}})
    found = survey(scene, SurveyPlan(seeds=1))
    assert [e.stable for e in found.entries] == [stable]
    assert len(found.warnings) == 1 - stable
    assert all("2 times its buckling load" in text for text in found.warnings)


@pytest.mark.full
@pytest.mark.parametrize(("every", "within"), [(1, 1.02), (5, 30.0)])
def test_the_error_of_a_reduced_run_is_estimated(every: int, within: float) -> None:
    """Estimated in every step within 1 % at all times; by one step for five 18 times too small at
    the end, which a note says."""
    reducer = {"use": "galerkin", "basis": {"use": "pod", "count": 4}, "error_estimate": every}
    run = simulate(swing(0.1, reducer=reducer))
    off = np.linalg.norm((fields(run) - fields(whole(0.1, False))).reshape(len(run.times), -1),
                         axis=1)
    ratio = (run.error_estimate("b.elastic")[1:] / off[1:])[5 if every == 1 else -1 :]
    assert np.all((ratio > 1 / within) & (ratio < within)), ratio
    assert [f"one step for {every} of the run" in n for n in run.summary["notes"]] == (
        [True] if every > 1 else [])
