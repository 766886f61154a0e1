"""The iteration of a whole step: kinks, cycles, rounding, and how it ends where nothing helps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from sparsemor.bodies.terms.field_kinds import RIGID
from sparsemor.core import StepFormula
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.protocols.poses import turns
from sparsemor.core.status import Status
from sparsemor.core.testing.in_memory_run import march, scene_of
from sparsemor.reducers.step import newton_loop
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.jacobian_factors import Lu
from sparsemor.reducers.step.newton_loop import Ended, KeptJacobian, Linearisation, Loop

Function = Callable[[FloatArray], FloatArray]


@dataclass(eq=False)
class Equations(newton_loop.StepEquations):
    """Equations f(x) = 0 of blocks of one unknown each, for the iteration alone."""

    f: Function
    slope: Function
    layout: Layout
    price: int
    named: tuple[tuple[str, frozenset[str]], ...] = ()

    def working(self, memory: object = None) -> "Equations":
        return self

    def begin(self, step: StepFormula, d: FloatArray) -> None: ...

    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        return self.f(d)

    def jacobian(self, at: Linearisation) -> FloatArray:
        return self.slope(at.x)

    def factorize(self, J: FloatArray) -> Lu:
        return Lu(J)

    def ended(self, *start: float) -> Ended:
        """The iteration from x with no free motion, so that the departure is x itself."""
        x, zero = np.array(start), np.zeros(len(start))
        step = StepFormula(0.0, 0.0, 0.0, 0.0, self.layout, zero, zero)
        return Loop(self.layout, Tolerances()).solve(self, step, x, KeptJacobian.empty(len(x)), x)


def scalar(
    f: Callable[[float], float], slope: Callable[[float], float], price: int = 3
) -> Equations:
    return Equations(
        lambda x: np.array([f(x[0])]), lambda x: np.array([[slope(x[0])]]),
        Layout([Block("ball", RIGID, 1)]), price, (("sole", frozenset({"ball.rigid"})),))


def test_a_kink_is_crossed() -> None:
    """Contact stiff by a factor of 1e6 behind a gap: full steps overshoot once, then hit."""
    soft, stiff = 1.0, 1e6
    eq = scalar(lambda x: soft * x + stiff * max(x - 1.0, 0.0) - 2.0,
                lambda x: soft + stiff * (x > 1.0))
    for start in (-5.0, 0.0, 1.0000001, 40.0):
        out = eq.ended(start)
        assert out.status is Status.DONE and out.iterations < 10
        assert abs(out.d[0] - (1.0 + 1.0 / (stiff + soft))) < 1e-12


def test_full_steps_that_go_back_and_forth_are_shortened() -> None:
    """Newton on sqrt(|x|) jumps from x to -x for ever."""
    eq = scalar(lambda x: np.sign(x - 1.0) * np.sqrt(abs(x - 1.0)),
                lambda x: 0.5 / np.sqrt(max(abs(x - 1.0), 1e-30)))
    out = eq.ended(3.0)
    assert out.status is Status.DONE and abs(out.d[0] - 1.0) < 1e-9


def test_a_step_without_a_solution_ends_in_words() -> None:
    jump = scalar(lambda x: x + 1.0 if x > 0 else x - 1.0, lambda x: 1.0).ended(0.7)
    assert jump.status is Status.NOT_CONVERGED and jump.block == "ball.rigid"
    assert "back and forth" in jump.detail and "sole" in jump.detail
    none = scalar(lambda x: x * x + 1.0, lambda x: 2 * x).ended(3.0)
    assert none.status is Status.NOT_CONVERGED and "sole" in none.detail
    flat = scalar(lambda x: 1.0, lambda x: 0.0).ended(1.0)
    assert flat.status is Status.SINGULAR
    wild = scalar(lambda x: np.inf, lambda x: 1.0).ended(1.0)
    assert wild.status is Status.NOT_FINITE


def test_a_block_at_its_rounding_is_not_judged() -> None:
    """x = 0 up to rounding has no size of its own."""
    eq = scalar(lambda x: (x - 0.3) + 0.3 + 1e-20 * np.sin(1e9 * x), lambda x: 1.0)
    assert eq.ended(0.0).status is Status.DONE


def test_slow_convergence_is_not_taken_for_rounding() -> None:
    """A slope of ten times the true one leaves nine tenths of an error; changes below 1e-9 that
    shrink so slowly were accepted with nine times their size still to come."""
    slow = scalar(lambda x: x - 0.3, lambda x: 10.0, price=0).ended(0.3 + 5e-9)
    assert slow.status is Status.NOT_CONVERGED and abs(slow.d[0] - 0.3) > 1e-11


def test_a_slow_block_is_not_hidden_by_a_quick_one() -> None:
    """x = 0 in one block, hit at once, and (y - 1)^2 = 0 in another, where Newton halves: the
    change that is left is estimated block by block."""
    apart = Equations(
        lambda x: np.array([x[0], (x[1] - 1.0) ** 2]), lambda x: np.diag([1.0, 2 * (x[1] - 1.0)]),
        Layout([Block("one", RIGID, 1), Block("two", RIGID, 1)]), 0)
    out = apart.ended(5.0, 1.0 + 1e-6)
    assert out.status is Status.DONE and abs(out.d[1] - 1.0) < 5e-9


@pytest.mark.full
def test_a_jacobian_turns_with_the_attitude_of_a_body() -> None:
    p, q = np.array([[0.1, 0.7, -0.5, 0.5], [0.0, 0.0, 0.6, 0.8]]), np.eye(4)[1:3]
    L = turns(p, q)
    np.testing.assert_allclose((L @ q[:, :, None])[:, :, 0], p, atol=1e-15)
    np.testing.assert_allclose(L @ L.transpose(0, 2, 1), [np.eye(4)] * 2, atol=1e-15)
    # a slender rod that swings and spins keeps its Jacobian: 2.3 iterations without turns
    run = march(scene_of({
        "bodies": {"rod": {"use": "rigid", "mass": 0.8, "center": [0.5, 0.0, 0.0],
                           "inertia": [1e-4, 0.05, 0.05], "points": {"eye": [0.0, 0.0, 0.0]},
                           "pose": {"axis": [0, 1, 0], "angle": 0.6, "spin": [1.0, 0.0, 4.0]}}},
        "joints": {"hook": {"use": "spherical", "between": ["ground", "rod:eye"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, 0.0, -9.81]}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0},
        "time": {"end": 0.3, "step": 1e-3}}))
    assert np.mean(run.iterations[10:]) <= 1.5
