"""Joint forces that alternate from step to step, a numerical oscillation without physical
meaning."""

from collections.abc import Callable

import numpy as np

from sparsemor.core import (
    Check,
    Findings,
    FloatArray,
    Model,
    Note,
    PreparedRun,
    Quantity,
    RunResult,
)
from sparsemor.core.protocols.layout import joints_with_forces
from sparsemor.plugins.checks import place

LAST = 20
"""Number of steps at the end of a run that are examined."""
LIMIT = 0.1
"""Amplitude, relative to the joint's largest force, above which there is a warning."""
SMALL, ROUNDING = 1e-6, 1e-9
"""Joint forces below the first share of the largest in the scene are round-off, and those below the
second one of stiffness times displacement, the size of the forces in a body that cancel there."""
DIED_OUT = 1e-3
"""Joint forces that have fallen below this share of the joint's largest of the run do not count."""


class AlternatingJointForces(Check):
    """Joint forces that alternate from step to step, without physical meaning."""

    order = place("alternating_joint_forces")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(alternating_forces(run.model, result))


def alternating_forces(model: Model | None, result: RunResult) -> tuple[Note, ...]:
    """Warning for each joint whose stored forces alternate about their mean course over the last
    steps; none if not every step was stored, or too few."""
    if result.scene["output"]["every"] != 1 or len(result.times) < LAST + 3:
        return ()
    last = slice(len(result.times) - LAST - 2, len(result.times))
    blocks = {name: result.layout.multipliers(name) for name in joints_with_forces(result.layout)}
    forces = {name: result.block(b.name) for name, b in blocks.items() if b is not None}
    size = {name: float(np.abs(f[last]).max()) for name, f in forces.items()}
    most = max(size.values(), default=0.0)
    found = {name: alternation(f[last]) for name, f in forces.items()
             if size[name] > max(SMALL * most, DIED_OUT * float(np.abs(f).max()))}
    if max(found.values(), default=0.0) <= LIMIT or most <= ROUNDING * inner_force(
            model, lambda name: result.block(name, slice(last.stop - 1, last.stop))):
        return ()
    return tuple(Note(
        f"the forces of joint {name} alternate from step to step, by {100 * share:.3g} % of their "
        f"size over the last {LAST} steps: they are not physical; take bdf2, or generalized_alpha "
        "with a smaller rho_inf (0.8 or less), and a smaller time.step where that does not help",
        "alternating_forces") for name, share in found.items() if share > LIMIT)


def inner_force(model: Model | None, displacements: Callable[[str], FloatArray]) -> float:
    """Largest stiffness of an elastic block times its largest displacement, N; 0.0 without bodies
    that deform. displacements: block -> its full-order unknowns."""
    return max((
        float(np.abs(model.block_data(b.name).stiffness.diagonal()).max(initial=0.0))
        * float(np.abs(displacements(b.name)).max(initial=0.0))
        for b in model.layout if b.kind.quantity is Quantity.DISPLACEMENT and b.size),
        default=0.0) if model is not None else 0.0


def alternation(forces: FloatArray) -> float:
    """Largest amplitude of the alternating part of joint forces (m, l) in m steps, relative to
    their largest absolute value.

    The second differences of a sequence c + (-1)^k A are 4 A in size and change sign in every step.
    A component counts if all its second differences change sign; their median gives its amplitude.
    """
    bends = forces[2:] - 2.0 * forces[1:-1] + forces[:-2]
    flips = np.all(bends[1:] * bends[:-1] < 0.0, axis=0)
    size = float(np.abs(forces).max(initial=0.0))
    if not flips.any() or size == 0.0:
        return 0.0
    return float(np.median(np.abs(bends[:, flips]), axis=0).max() / (4.0 * size))
