"""Time steps of error equations: those of the run, or longer ones from one estimate to the next;
and the steps of the run for uncoupled modes k x + d x' + m x'' = f, many at a time."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Integrator, Layout, State, UpdateRule, UpdateRules

FIRST = 4
"""Largest number of steps at the start of a run that have an estimate each, where estimates are
few."""


def begins(step: int, every: int, first: int) -> bool:
    """True for the steps before the first `every`-th that have an estimate where estimates are few:
    the first ones, and with `FIRST` of these also 8, 16, and so on up to half of `every`. Loads
    that act suddenly at the start let displacements vibrate, and give bodies a velocity, which one
    long step would not find."""
    doubled = first == FIRST and step & (step - 1) == 0 and 2 * step <= every
    return 0 < step < every and (step <= first or doubled)


def error_rules(integrator: Integrator, count: int, h: float) -> UpdateRules:
    """Update rules of a step of the error equation over `count` steps of h (s) of the run: those of
    its integrator for one, else implicit Euler. A long step does not resolve vibrations; implicit
    Euler leaves their static part, where rules without numerical damping would keep them."""
    if count == 1:
        return integrator.rules(h)
    h *= count
    return UpdateRules(
        UpdateRule(np.array([h * h, h, 1.0]), np.array([[1.0, h, 0], [0, 1, 0], [0, 0, 0]])),
        UpdateRule(np.array([h, 1.0, 0.0]), np.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0]])))


def error_start(integrator: Integrator, count: int, layout: Layout, error: State) -> State:
    """Errors x, v, a with the history of `error_rules`."""
    return integrator.start(layout, error) if count == 1 else State(
        error.t, error.x, error.v, error.a, np.zeros((layout.size, 0)))


@dataclass(frozen=True, slots=True, eq=False)
class ModalSteps:
    """`count` steps of q modes at a time under loads that change linearly meanwhile from f0 to f:
    z = transition z0 + earlier f0 + later f with z (s, q) = [x, x', x'', history of the integrator]
    of each mode.

    transition (s, s, q), earlier and later (s, q). One step of the run is z = T z0 + L f, from the
    rule z = new p + old z0 with the highest rate p, and the equation
    k x + d x' + m x'' = f at its end. After
    m of them, with loads f0 + (f - f0) i/m at the end of step i,

        transition = T^m,  earlier = sum_i T^(m-i) L (1 - i/m),  later = sum_i T^(m-i) L i/m
    """

    transition: FloatArray
    earlier: FloatArray
    later: FloatArray

    @classmethod
    def from_rule(
        cls, rule: UpdateRule, count: int, stiffness: FloatArray, damping: FloatArray,
        mass: FloatArray
    ) -> "ModalSteps":
        """`count` steps by a rule of modes with stiffness k, damping d and mass m, (q,) each; m = 0
        for first-order equations. The rule z = new p + old z0 gives the rows x, x', x'' first; with
        the equation k x + d x' + m x'' = f at its end a step is z = T z0 + L f."""
        factors = np.stack([stiffness, damping, mass])
        load = rule.new[:, None] / (rule.new[:3] @ factors)  # L (s, q)
        forces = rule.old[:3].T @ factors  # (s, q): those of the old state at zero highest rate
        one = rule.old[:, :, None] - load[:, None] * forces  # T (s, s, q)
        power = np.repeat(np.eye(len(load))[:, :, None], load.shape[1], axis=2)  # T^(m-i)
        earlier, later = np.zeros_like(load), np.zeros_like(load)
        for i in range(count, 0, -1):
            response = (power * load).sum(axis=1)
            earlier += response * (1.0 - i / count)
            later += response * (i / count)
            power = (power[:, :, None] * one).sum(axis=1)
        return cls(power, earlier, later)

    def advance(self, z: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        """State (s, q) `count` steps after z (s, q), between which loads go from `before` to
        `after`, (q,) each."""
        found: FloatArray = (self.transition * z).sum(axis=1)
        found += self.earlier * before + self.later * after
        return found
