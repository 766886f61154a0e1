"""Orders, damping and an index-3 pendulum; what the law kit of integrators catches."""

from dataclasses import replace

import numpy as np
import pytest

from sparsemor.bodies.terms.field_kinds import ELASTIC, THERMAL
from sparsemor.core import Integrator, State, StepFormula, StepOutcome, UpdateRule, UpdateRules
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.status import Status
from sparsemor.core.testing import check_integrator
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.core.testing.integrator import integrate
from sparsemor.integrators.bdf1 import Bdf1
from sparsemor.integrators.bdf2 import Bdf2
from sparsemor.integrators.generalized_alpha import GeneralizedAlpha
from tiers import full

RADII = (0.0, 0.5, 0.8, 1.0)
OSCILLATOR = Layout([Block("b", ELASTIC, 1)])


@pytest.mark.parametrize(
    ("integrator", "order"),
    [(Bdf1(), 1.0), full(Bdf2(), 2.0),
     *(full(GeneralizedAlpha(rho_inf=rho), 2.0) for rho in RADII)],
    ids=repr,
)
def test_observed_orders(integrator: Integrator, order: float) -> None:
    errors = [integrate(integrator, steps).errors for steps in (200, 400)]
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), order, atol=0.15)


def oscillate(integrator: Integrator, w: float, h: float, state: State) -> State:
    """One step of x'' + w^2 x = 0."""
    rules = integrator.rules(h)
    f = step_formula(rules, OSCILLATOR, state, h)
    return after(rules, OSCILLATOR, state, f, -f.r2 / (f.c2 + w * w))


def after(
    rules: UpdateRules, layout: Layout, state: State, f: StepFormula, x: FloatArray
) -> State:
    return advanced(rules, layout, state, f, StepOutcome(x, Status.DONE, 1))


def one(x: float, v: float, a: float, memory: FloatArray) -> State:
    return State(0.0, np.array([x]), np.array([v]), np.array([a]), memory)


def amplification(integrator: Integrator, w: float, h: float) -> FloatArray:
    """One-step matrix of (w x, v, memory) with a = -w^2 x, as every computed state has."""
    size = 2 + integrator.start(OSCILLATOR, one(1.0, 0.0, 0.0, np.zeros((1, 0)))).memory.shape[1]
    columns = []
    for unit in np.eye(size):
        x = unit[0] / w
        start = one(x, unit[1], -w * w * x, unit[None, 2:] * w)
        end = oscillate(integrator, w, h, start)
        columns.append(np.concatenate([w * end.x, end.v, end.memory[0] / w]))
    return np.array(columns).T


@pytest.mark.parametrize("wh", [0.1, 1.0, 30.0])
def test_bdf1_damps_as_the_closed_form_says(wh: float) -> None:
    radius = np.abs(np.linalg.eigvals(amplification(Bdf1(), wh / 0.01, 0.01))).max()
    assert radius == pytest.approx(1.0 / np.sqrt(1.0 + wh * wh), rel=1e-12)


@pytest.mark.parametrize("wh", [1e-3, 0.1, 1.0, 2.0, 30.0, 1e4])
def test_bdf2_damps_every_frequency_and_forgets_the_high_ones(wh: float) -> None:
    """The roots of (3/2 - 2 z + z^2/2)^2 + (wh)^2 = 0, z the inverse of the factor per step."""
    radius = np.abs(np.linalg.eigvals(amplification(Bdf2(), wh / 0.01, 0.01))).max()
    roots = np.roots(np.polyadd(np.polymul([0.5, -2.0, 1.5], [0.5, -2.0, 1.5]), [wh * wh]))
    assert radius == pytest.approx(1.0 / np.abs(roots).min(), rel=1e-6)
    assert radius < 1.0
    if wh > 1e3:
        assert radius < 0.01


@pytest.mark.full
def test_bdf2_remakes_its_history_at_another_step_to_second_order() -> None:
    """x'' + w^2 x = 0 over 2 s, the step halved and doubled again on the way."""
    w, errors = 3.0, []
    for n in (100, 200, 400):
        integrator, state = Bdf2(), one(1.0, 0.0, -w * w, np.zeros((1, 0)))
        for part, steps in ((0.5, n), (0.5, 2 * n), (1.0, 2 * n)):
            state = integrator.start(OSCILLATOR, state)
            for _ in range(steps):
                state = oscillate(integrator, w, part / steps, state)
        errors.append(abs(state.x[0] - np.cos(w * state.t)))
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.parametrize("rho", RADII)
def test_spectral_radius_at_high_frequency_is_rho_inf(rho: float) -> None:
    G = amplification(GeneralizedAlpha(rho_inf=rho), 1e7, 1.0)
    # at rho_inf two or three eigenvalues meet, so that each is known to a root of round-off
    assert np.abs(np.linalg.eigvals(G)).max() == pytest.approx(rho, abs=2e-3)


@pytest.mark.parametrize("rho", RADII)
@pytest.mark.parametrize("wh", [1e-2, 1.0, 100.0])
def test_no_frequency_grows(rho: float, wh: float) -> None:
    G = amplification(GeneralizedAlpha(rho_inf=rho), wh, 1.0)
    assert np.abs(np.linalg.eigvals(G)).max() < 1.0 + 1e-7


def test_fast_decays_vanish_under_generalized_alpha() -> None:
    """First-order unknowns follow BDF2: roots z of (3/2 + r) z^2 - 2 z + 1/2 = 0 at the decay r."""
    layout, integrator = Layout([Block("b", THERMAL, 1)]), GeneralizedAlpha(rho_inf=1.0)
    rate, columns = 1e7, []
    for T, before in np.eye(2):
        state = one(T, -rate * T, 0.0, np.array([[before - T - rate * T]]))
        rules = integrator.rules(1.0)
        f = step_formula(rules, layout, state, 1.0)
        columns.append([after(rules, layout, state, f, -f.r1 / (f.c1_first + rate)).x[0], T])
    assert np.abs(np.linalg.eigvals(np.array(columns).T)).max() == pytest.approx(
        np.sqrt(0.5 / rate), rel=1e-3)


def test_a_radius_outside_0_1_is_refused() -> None:
    for rho in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match="rho_inf"):
            GeneralizedAlpha(rho_inf=rho)


class Broken(Integrator):
    fault: str

    @property
    def order(self) -> int:
        return 2 if self.fault == "boasts" else 1

    def start(self, layout: Layout, state: State) -> State:
        if self.fault == "moves at start":
            return Bdf1().start(layout, replace(state, x=state.x + 1.0))
        return Bdf1().start(layout, state)

    def rules(self, h: float) -> UpdateRules:
        good = Bdf1().rules(h)
        second, first = good.second, good.first
        if self.fault == "explicit":
            return replace(good, first=replace(first, new=np.array([0.0, 1.0, 0.0])))
        if self.fault == "half rate":
            return replace(good, first=replace(first, new=np.array([h, 0.5, 0.0])))
        if self.fault == "drifts":
            return replace(good, second=replace(second, old=second.old + 1e-3 * np.array(
                [[1.0, 0, 0], [0, 0, 0], [0, 0, 0]])))
        if self.fault == "lacks columns":
            return replace(good, second=UpdateRule(second.new[:2], second.old[:2, :2]))
        return good


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("boasts", "order 2 is stated"),
        ("moves at start", "memory only"),
        ("explicit", "not implicit"),
        ("half rate", "highest rate q itself"),
        ("drifts", "gets a speed"),
        ("lacks columns", "must have shapes"),
    ],
)
def test_a_broken_integrator_fails_its_law(fault: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_integrator(Broken(fault=fault))


def named(bodies: dict[str, object], **more: object) -> str:
    """Integrator of a scene, as its dump names it."""
    scene = scene_of({"bodies": bodies, "time": {"end": 1.0, "step": 0.1}, **more})
    return str(scene.dump()["integrator"])


def test_a_scene_that_names_none_has_one_of_second_order() -> None:
    """generalized_alpha with rho_inf 0.8 where something moves or deforms, bdf2 for heat alone."""
    ball = {"use": "rigid", "mass": 1.0, "inertia": 1.0}
    plate = {"use": "flexible", "mesh": {"use": "rectangle", "size": [1.0, 1.0],
                                         "divisions": [1, 1]}, "thickness": 0.1, "frame": "fixed",
             "material": {"rho": 1.0, "E": 1.0, "nu": 0.3, "k": 1.0, "c": 1.0}}
    alpha, bdf2 = "{'use': 'generalized_alpha', 'rho_inf': 0.8}", "{'use': 'bdf2'}"
    heat = {**plate, "fields": ["thermal"]}
    assert named({"ball": ball}) == named({"ball": ball, "plate": heat}) == alpha
    assert named({"plate": {**plate, "fields": ["elastic"]}}) == alpha
    assert named({"plate": {**heat, "frame": "floating"}}) == alpha
    assert named({"plate": heat}) == bdf2
    assert named({"plate": heat}, integrator="bdf1") == "{'use': 'bdf1'}"
    assert named({"plate": heat}, integrator={"rho_inf": 0.5}) == alpha.replace("0.8", "0.5")
    assert named({"ball": ball}, integrator={"rho_inf": 0.5}) == alpha.replace("0.8", "0.5")
