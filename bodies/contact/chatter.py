"""Detection of a normal force that oscillates from step to step (chatter)."""

import numpy as np

from sparsemor.core import FloatArray

RESTLESS = 0.02
"""Mean change of the normal force per step, relative to its mean, above which a warning is issued.
"""


def chatter_ratio(normal: FloatArray) -> float:
    """Mean change per step of the normal force (T,) relative to its mean, in the second half of a
    run, if it reverses its direction in more than half of the steps; else 0.

    A motion that the time step resolves reverses less often: faster oscillation is numerical.
    """
    late = normal[len(normal) // 2:]
    change = np.diff(late)
    if len(change) < 8 or not late.any():
        return 0.0
    turns = float((change[1:] * change[:-1] < 0).mean())
    size = float(np.abs(change).mean() / late.mean())
    return size if turns > 0.5 and size > RESTLESS else 0.0


def chatter_warning(name: str, normal: FloatArray) -> str:
    """Warning if the normal force (T,), N, of the contact `name` oscillates from step to step; ""
    otherwise."""
    size = chatter_ratio(normal)
    return "" if size == 0.0 else (
        f"contact {name}: to the end its normal force changes by {100 * size:.2g} % from "
        "step to step, back and forth: the step does not resolve the motion on the foundation, "
        "and the integrator does not damp it; forces, and friction above all, are not to be "
        "trusted: take a smaller time.step, or bdf1, bdf2 or a smaller rho_inf")
