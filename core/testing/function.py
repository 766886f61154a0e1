"""Laws of a function of time."""

import numpy as np

from sparsemor.core.protocols import TimeFunction
from sparsemor.core.testing.data import law

STEP = 1e-6
KINKS = 0.05
"""Share of random times that may fall beside a kink or a jump."""


def check_function(function: TimeFunction, seed: int = 0, span: float = 10.0) -> None:
    """Finite, the same when asked again, and `rate` is the slope at nearly all of 200 random
    times between -span and span (s); kinks and jumps are allowed between them."""
    times = np.random.default_rng(seed).uniform(-span, span, 200)
    off = []
    for t in times.tolist():
        value, rate = function.value(t), function.rate(t)
        law(np.isfinite(value) and np.isfinite(rate), f"not finite at t = {t:g} s")
        law(value == function.value(t) and rate == function.rate(t), f"two answers at t = {t:g} s")
        ahead, behind = function.value(t + STEP), function.value(t - STEP)
        slope = (ahead - behind) / (2 * STEP)
        noise = 1e-9 * max(abs(ahead), abs(behind), abs(value)) / STEP
        if abs(slope - rate) > 1e-4 * abs(slope) + noise + 1e-6:
            off.append(t)
    law(len(off) <= KINKS * len(times),
        f"rate is not the slope of value at {len(off)} of {len(times)} times, such as "
        f"t = {off[0] if off else 0:g} s (seed {seed})")
