"""Time steps of uncoupled modes k x + d x' + m x'' = f, by any integrator with linear rules."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, UpdateRule


@dataclass(frozen=True, slots=True, eq=False)
class ModalSteps:
    """Step of q modes: z = transition z + load f, with z (s, q) = [x, x', x'', history of the
    integrator] of each mode.

    transition (s, s, q), load (s, q). They follow from the rule z = new p + old z of a step with
    the highest rate p, and the equation at the end of the step.
    """

    transition: FloatArray
    load: FloatArray

    @classmethod
    def of(
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
