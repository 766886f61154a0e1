"""The iteration of a whole step: kinks, cycles, rounding, and how it ends where nothing helps."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.terms.field_kinds import RIGID
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import StepFormula, StepOutcome
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.status import Status
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.newton.factors import Lu
from sparsemor.reducers.step.newton.iteration import solve
from sparsemor.reducers.step.newton.memory import NewtonMemory


@dataclass(frozen=True, slots=True, eq=False)
class Scalar:
    """One equation f(x) = 0, for the iteration alone."""

    f: Any
    slope: Any
    layout: Layout = Layout([Block("ball", RIGID, 1)])
    price: int = 3
    named: tuple[tuple[str, frozenset[str]], ...] = (("sole", frozenset({"ball.rigid"})),)

    def prescribed(self, t: float) -> FloatArray:
        return np.zeros(1)

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, prescribed: FloatArray
    ) -> FloatArray:
        return np.array([self.f(x[0])])

    def jacobian(self, x: FloatArray, *args: Any) -> FloatArray:
        return np.array([[self.slope(x[0])]])

    def factorize(self, J: FloatArray) -> Lu:
        return Lu(J)

    def solved(self, start: float) -> StepOutcome:
        step = StepFormula(0.0, 0.0, 0.0, 0.0, self.layout, np.zeros(1), np.zeros(1))
        return solve(self, step, NewtonMemory.of(np.array([start]), 6, [0]), Tolerances())


def test_a_kink_is_crossed() -> None:
    """Contact stiff by a factor of 1e6 behind a gap: full steps overshoot once, then hit."""
    soft, stiff = 1.0, 1e6
    eq = Scalar(lambda x: soft * x + stiff * max(x - 1.0, 0.0) - 2.0,
                lambda x: soft + stiff * (x > 1.0))
    for start in (-5.0, 0.0, 1.0000001, 40.0):
        out = eq.solved(start)
        assert out.status is Status.DONE and out.iterations < 10
        assert abs(out.x[0] - (1.0 + 1.0 / (stiff + soft))) < 1e-12


def test_full_steps_that_go_back_and_forth_are_shortened() -> None:
    """Newton on sqrt(|x|) jumps from x to -x for ever."""
    eq = Scalar(lambda x: np.sign(x - 1.0) * np.sqrt(abs(x - 1.0)),
                lambda x: 0.5 / np.sqrt(max(abs(x - 1.0), 1e-30)))
    out = eq.solved(3.0)
    assert out.status is Status.DONE and abs(out.x[0] - 1.0) < 1e-9


def test_a_step_without_a_solution_ends_in_words() -> None:
    jump = Scalar(lambda x: x + 1.0 if x > 0 else x - 1.0, lambda x: 1.0).solved(0.7)
    assert jump.status is Status.NOT_CONVERGED and jump.block == "ball.rigid"
    assert "back and forth" in jump.detail and "sole" in jump.detail
    none = Scalar(lambda x: x * x + 1.0, lambda x: 2 * x).solved(3.0)
    assert none.status is Status.NOT_CONVERGED and "sole" in none.detail
    flat = Scalar(lambda x: 1.0, lambda x: 0.0).solved(1.0)
    assert flat.status is Status.SINGULAR
    wild = Scalar(lambda x: np.inf, lambda x: 1.0).solved(1.0)
    assert wild.status is Status.NOT_FINITE


def test_a_block_at_its_rounding_is_not_judged() -> None:
    """x = 0 up to rounding has no size of its own."""
    eq = Scalar(lambda x: (x - 0.3) + 0.3 + 1e-20 * np.sin(1e9 * x), lambda x: 1.0)
    assert eq.solved(0.0).status is Status.DONE


def test_slow_convergence_is_not_taken_for_rounding() -> None:
    """A slope of ten times the true one leaves nine tenths of an error; changes below 1e-9 that
    shrink so slowly were accepted with nine times their size still to come."""
    slow = Scalar(lambda x: x - 0.3, lambda x: 10.0, price=0).solved(0.3 + 5e-9)
    assert slow.status is Status.NOT_CONVERGED and abs(slow.x[0] - 0.3) > 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class Apart:
    """x = 0 in one block, hit at once, and (y - 1)^2 = 0 in another, where Newton halves."""

    layout: Layout = Layout([Block("one", RIGID, 1), Block("two", RIGID, 1)])
    price: int = 0
    named: tuple[tuple[str, frozenset[str]], ...] = ()

    def prescribed(self, t: float) -> FloatArray:
        return np.zeros(2)

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, prescribed: FloatArray
    ) -> FloatArray:
        return np.array([x[0], (x[1] - 1.0) ** 2])

    def jacobian(self, x: FloatArray, *args: Any) -> FloatArray:
        return np.diag([1.0, 2.0 * (x[1] - 1.0)])

    def factorize(self, J: FloatArray) -> Lu:
        return Lu(J)


def test_a_slow_block_is_not_hidden_by_a_quick_one() -> None:
    """The change that is left is estimated block by block."""
    zero = np.zeros(2)
    start = NewtonMemory.of(np.array([5.0, 1.0 + 1e-6]), 6, [0, 1])
    step = StepFormula(0.0, 0.0, 0.0, 0.0, Apart().layout, zero, zero)
    out = solve(Apart(), step, start, Tolerances())
    assert out.status is Status.DONE and abs(out.x[1] - 1.0) < 5e-9
