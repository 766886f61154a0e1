"""Joint forces that alternate from step to step, which is numerical and not physical."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.results.run_result import RunResult

LAST = 20
"""Steps at the end of a run that are looked at."""
LIMIT = 0.1
"""Amplitude, relative to the joint's forces, from which on it is noted."""
SMALL = 1e-6
"""Joint forces below this share of the largest in the scene are round-off."""


def joints_with_forces(layout: Layout) -> tuple[str, ...]:
    """Names of the joints whose forces are unknowns. The multiplier of a quaternion's length is
    not a joint's."""
    return tuple(b.owner for b in layout
                 if b.kind.order == 0 and layout.of(b.owner, Quantity.POSE) is None)


def alternating_forces(result: RunResult) -> tuple[Note, ...]:
    """A note for each joint whose stored forces alternate about their course over the last steps.

    Nothing where not every step was stored, or too few."""
    if result.scene["output"]["every"] != 1 or len(result.times) < LAST + 3:
        return ()
    last = slice(len(result.times) - LAST - 2, len(result.times))
    blocks = {name: result.layout.multipliers(name) for name in joints_with_forces(result.layout)}
    forces = {name: result.block(b.name, last) for name, b in blocks.items() if b is not None}
    most = max((float(np.abs(f).max()) for f in forces.values()), default=0.0)
    found = {name: alternation(f) for name, f in forces.items()
             if float(np.abs(f).max()) > SMALL * most}
    return tuple(Note(
        f"the forces of joint {name} alternate from step to step, by {100 * share:.3g} % of their "
        f"size over the last {LAST} steps: they are not physical; take generalized_alpha with "
        "rho_inf 0.8 or bdf2, and a smaller time.step where that does not help",
        "alternating_forces") for name, share in found.items() if share > LIMIT)


def alternation(forces: FloatArray) -> float:
    """Largest amplitude of an alternating sequence in forces (m, l) over their largest size.

    The second differences of a sequence c + (-1)^k A are 4 A in size and change sign in every step;
    a component counts where all of them do, by their median.
    """
    bends = forces[2:] - 2.0 * forces[1:-1] + forces[:-2]
    flips = np.all(bends[1:] * bends[:-1] < 0.0, axis=0)
    size = float(np.abs(forces).max(initial=0.0))
    if not flips.any() or size == 0.0:
        return 0.0
    return float(np.median(np.abs(bends[:, flips]), axis=0).max() / (4.0 * size))
