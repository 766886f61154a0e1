"""Law kit of a function of time."""

from collections.abc import Callable

import numpy as np

from sparsemor.core.protocols.time_function import Function
from sparsemor.core.testing.random_inputs import keeps_contract, law

STEP = 1e-6
KINKS = 0.05
"""Share of random times that may fall next to a kink or a jump."""


def check_function(function: Function, seed: int = 0, span: float = 10.0) -> None:
    """Laws of a function of time: finite values, equal ones when evaluated again, and `rate` is the
    slope of `value` at nearly all of 200 random times between -span and span (s), because kinks and
    jumps are allowed. A `curvature`, if there is one, is the slope of the rate."""
    keeps_contract("function", function)
    times = np.random.default_rng(seed).uniform(-span, span, 200).tolist()
    _slope("value", function.value, "rate", function.rate, times, seed)
    if function.curvature(0.0) is not None:
        _slope("rate", function.rate, "curvature", lambda t: function.curvature(t) or 0.0, times,
               seed)


def _slope(
    name: str, of: Callable[[float], float], slope_name: str, slope: Callable[[float], float],
    times: list[float], seed: int,
) -> None:
    """Checks a derivative against difference quotients, except at kinks."""
    off = []
    for t in times:
        value, rate = of(t), slope(t)
        law(np.isfinite(value) and np.isfinite(rate), f"not finite at t = {t:g} s")
        law(value == of(t) and rate == slope(t), f"two values at t = {t:g} s")
        ahead, behind = of(t + STEP), of(t - STEP)
        found = (ahead - behind) / (2 * STEP)
        noise = 1e-9 * max(abs(ahead), abs(behind), abs(value)) / STEP
        if abs(found - rate) > 1e-4 * abs(found) + noise + 1e-6:
            off.append(t)
    law(len(off) <= KINKS * len(times),
        f"{slope_name} is not the slope of {name} at {len(off)} of {len(times)} times, such as "
        f"t = {off[0] if off else 0:g} s (seed {seed})")
