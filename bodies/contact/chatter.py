"""A normal force that goes back and forth to the end of a run."""

import numpy as np

from sparsemor.core import FloatArray

RESTLESS = 0.02
"""Mean change of the normal force from step to step, over its mean, that is reported."""


def chatter_ratio(normal: FloatArray) -> float:
    """Mean change of the normal force (T,) from step to step over its mean, in the second half of a
    run in which it goes up and down within four steps; else 0.

    A motion that the steps resolve turns less often: what does not is the step's own.
    """
    late = normal[len(normal) // 2:]
    change = np.diff(late)
    if len(change) < 8 or not late.any():
        return 0.0
    turns = float((change[1:] * change[:-1] < 0).mean())
    size = float(np.abs(change).mean() / late.mean())
    return size if turns > 0.5 and size > RESTLESS else 0.0


def chatter_warning(name: str, normal: FloatArray) -> str:
    """Warning about the normal force (T,), N, of a contact at the steps of a run; ""
    if nothing."""
    size = chatter_ratio(normal)
    return "" if size == 0.0 else (
        f"contact {name}: to the end its normal force changes by {100 * size:.2g} % from "
        "step to step, back and forth: the step does not resolve the motion on the foundation, "
        "and the integrator does not damp it; forces, and friction above all, are not to be "
        "trusted: take a smaller time.step, or bdf1, bdf2 or a smaller rho_inf")
