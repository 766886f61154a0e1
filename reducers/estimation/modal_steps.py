"""Time steps of error equations: those of the run, or longer ones from one estimate to the next,
and steps of uncoupled modes k x + d x' + m x'' = f."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Integrator, Layout, State, UpdateRule, UpdateRules


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
    """Step of q modes: z = transition z + load f, with z (s, q) = [x, x', x'', history of the
    integrator] of each mode.

    transition (s, s, q), load (s, q). They follow from the rule z = new p + old z of a step with
    the highest rate p, and the equation k x + d x' + m x'' = f at the end of the step, f its load.
    """

    transition: FloatArray
    load: FloatArray

    @classmethod
    def from_rule(
        cls, rule: UpdateRule, stiffness: FloatArray, damping: FloatArray, mass: FloatArray
    ) -> "ModalSteps":
        """Steps of modes with stiffness k, damping d and mass m, (q,) each; m = 0 for first-order
        equations."""
        factors = np.stack([stiffness, damping, mass])
        load = rule.new[:, None] / (rule.new[:3] @ factors)
        forces = rule.old[:3].T @ factors  # (s, q): those of the old state at zero highest rate
        return cls(rule.old[:, :, None] - load[:, None] * forces, load)

    def advance(self, z: FloatArray, f: FloatArray) -> tuple[FloatArray, FloatArray]:
        """State z (s, q) after j steps with loads f (j, q), and the values x (j, q) at each."""
        x = np.empty_like(f)
        for i, force in enumerate(f):
            z = (self.transition * z).sum(axis=1)
            z += self.load * force
            x[i] = z[0]
        return z, x
