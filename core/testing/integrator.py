"""Law kit of an integrator, on equations with closed-form solutions."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.integrator import (
    Integrator,
    NextStep,
    State,
    StepFormula,
    StepOutcome,
    UpdateRules,
    advanced,
    next_time,
    step_formula,
)
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.status import Status
from sparsemor.core.testing.random_inputs import (
    DISPLACEMENTS,
    FORCES,
    TEMPERATURES,
    copied,
    keeps_contract,
    law,
    unchanged,
)

LAYOUT = Layout([Block("b", DISPLACEMENTS, 2), Block("b", TEMPERATURES, 2), Block("j", FORCES, 1)])
DAMPING, STIFFNESS, DECAY = 0.3, np.array([1.0, 9.0]), np.array([0.5, 2.0])
"""Coefficients of x'' + DAMPING x' + STIFFNESS x = 0 (1/s, 1/s2) and T' + DECAY T = 0 (1/s); the
multiplier is x[0]."""


@dataclass(frozen=True, slots=True, eq=False)
class RunEnd:
    """Last state of a run and its errors in x of second order, v of second order, x of first
    order."""

    state: State
    errors: FloatArray


def check_integrator(integrator: Integrator, seed: int = 0) -> None:
    """Laws of an integrator: its rules are those of an implicit method, `start` changes nothing but
    the memory, a state of rest persists, and the stated order is observed on damped oscillators (x
    and v) and exponential decays."""
    keeps_contract("integrator", integrator)
    _rules_are_implicit(integrator, seed)
    _rest_stays_rest(integrator)
    coarse, fine = (integrate(integrator, steps).errors for steps in (320, 640))
    observed = np.log2(coarse / fine)
    names = ("x of second order", "v of second order", "x of first order")
    for name, order in zip(names, observed, strict=True):
        law(order > integrator.order - 0.2,
            f"order {integrator.order} is stated, {order:.2f} observed for {name}")


def integrate(integrator: Integrator, steps: int, end: float = 2.0) -> RunEnd:
    """Solves the test equations from t = 0 to `end` (s) in `steps` steps: two oscillators x'' +
    DAMPING x' + STIFFNESS x = 0, two decays T' + DECAY T = 0, a multiplier equal to the first x."""
    def solve(f: StepFormula) -> StepOutcome:
        new = np.zeros(5)  # two x, two T, multiplier; with v = c1 x + r1, a = c2 x + r2
        left = f.c2 + DAMPING * f.c1 + STIFFNESS
        new[:2] = -(f.r2[:2] + DAMPING * f.r1[:2]) / left
        new[2:4] = -f.r1[2:4] / (f.c1_first + DECAY)
        new[4] = new[0]
        return StepOutcome(new, Status.DONE, 1)

    h = end / steps
    rules, (x, v, a) = integrator.rules(h), exact(0.0)
    state = integrator.start(LAYOUT, State(0.0, x, v, a, np.zeros((5, 0))))
    for _ in range(steps):
        outcome, state = integrator.advance(
            solve, NextStep(rules, LAYOUT, state, h, next_time(state.t, h)))
        law(outcome.status.ok, f"a step ended with {outcome.status.value}")
    x, v, _ = exact(state.t)
    errors = [state.x[:2] - x[:2], state.v[:2] - v[:2], state.x[2:4] - x[2:4]]
    return RunEnd(state, np.array([np.linalg.norm(e) for e in errors]))


def exact(t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Exact x, v, a (5,) of the test equations at time t (s), from x = 1 at rest and T = 1: two
    damped oscillators, two decays T, a multiplier equal to the first x."""
    half = DAMPING / 2.0
    w = np.sqrt(STIFFNESS - half**2)
    fade = np.exp(-half * t)
    q = fade * (np.cos(w * t) + half / w * np.sin(w * t))
    qd = -fade * (STIFFNESS / w) * np.sin(w * t)
    T = np.exp(-DECAY * t)
    x, v, a = np.concatenate([q, T, q[:1]]), np.zeros(5), np.zeros(5)
    v[:2], v[2:4] = qd, -DECAY * T
    a[:2] = -DAMPING * qd - STIFFNESS * q
    return x, v, a


def _advanced(rules: UpdateRules, state: State, formula: StepFormula, x: FloatArray) -> State:
    return advanced(rules, LAYOUT, state, formula, StepOutcome(x, Status.DONE, 1))


def _rules_are_implicit(integrator: Integrator, seed: int) -> None:
    """Checks shapes of the update rules, that the new value enters with a positive factor, and that
    they give the highest rate itself."""
    rng, h = np.random.default_rng(seed), 0.01
    state = _random_state(integrator, rng)
    columns, rules = 3 + state.memory.shape[1], integrator.rules(h)
    for kind, rule, highest in (("second", rules.second, 2), ("first", rules.first, 1)):
        law(rule.new.shape == (columns,) and rule.old.shape == (columns, columns),
            f"the rule of {kind} order must have shapes ({columns},) and ({columns}, {columns})")
        law(bool(np.isfinite(rule.new).all() and np.isfinite(rule.old).all()),
            f"the rule of {kind} order has entries that are not finite")
        law(rule.new[0] > 0, f"the rule of {kind} order is not implicit: new[0] must be > 0")
        law(rule.new[highest] == 1.0 and not rule.old[highest].any(),
            f"the rule of {kind} order must give the highest rate q itself in row {highest}")
    law(rules.second.new[1] > 0, "the rule of second order does not change v with a")
    for trial in range(10):
        x, where = rng.standard_normal(5), f"(seed {seed}, trial {trial})"
        f = step_formula(rules, LAYOUT, state, h)
        new = _advanced(rules, state, f, x)
        law(np.isfinite(new.memory).all(), f"the memory is not finite {where}")
        state = new


def _random_state(integrator: Integrator, rng: np.random.Generator) -> State:
    x, v, a = rng.standard_normal((3, 5))
    first = State(0.7, x, v, a, np.zeros((5, 0)))
    before = copied(first)
    state = integrator.start(LAYOUT, first)
    law(unchanged(first, before), "start wrote to its first state")
    same = all(np.array_equal(getattr(state, n), getattr(first, n)) for n in ("x", "v", "a"))
    law(same and state.t == first.t, "start may set the memory only")
    law(state.memory.ndim == 2 and state.memory.shape[0] == 5, "memory must have shape (n, j)")
    return state


def _rest_stays_rest(integrator: Integrator) -> None:
    x, zero = np.arange(1.0, 6.0), np.zeros(5)
    state = integrator.start(LAYOUT, State(0.0, x, zero, zero, np.zeros((5, 0))))
    for h in (1e-3, 0.1, 10.0):
        _, new = integrator.advance(
            lambda f: StepOutcome(x, Status.DONE, 1),
            NextStep(integrator.rules(h), LAYOUT, state, h, h))
        still = np.abs(new.v[:4]).max() * h + np.abs(new.a[:2]).max() * h * h
        law(still < 1e-12, f"a body at rest that stays where it is gets a speed (h = {h} s)")
