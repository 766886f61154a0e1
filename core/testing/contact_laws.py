"""Law kits of the constitutive laws of contact: normal pressure and friction."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.contact import FrictionLaw, NormalLaw
from sparsemor.core.testing.random_inputs import law

STEP = 1e-6


def check_normal_law(normal: NormalLaw, seed: int = 0, trials: int = 20) -> None:
    """Laws of a normal pressure law: zero pressure at zero penetration, at any rate; derivatives
    equal to those of the pressure away from the breaks (kinks); equal values for equal arguments.
    Penetrations are drawn around the breaks."""
    rng, breaks = np.random.default_rng(seed), _breaks(normal.breaks)
    law(all(b > 0 for b in breaks), "breaks are penetrations above 0")
    unit = max(breaks, default=1e-6)
    for _ in range(trials):
        depth = unit * 10.0 ** rng.uniform(-2, 2, (3, 4))
        rate = rng.standard_normal((3, 4)) * 10.0 ** rng.uniform(-4, 0)
        p, by_depth, by_rate = normal.pressure(depth, rate)
        law(p.shape == by_depth.shape == by_rate.shape == depth.shape, "shapes differ")
        law(np.array_equal(p, normal.pressure(depth, rate)[0]), "two values from equal arguments")
        start = normal.pressure(0.0 * depth, rate)[0]
        law(not start.any(), "pressure where surfaces just meet: it would jump there")
        # away: 1 where a difference quotient does not reach over a break, else 0; p / h: measure of
        # the quotient's rounding
        h, away = STEP * depth, _away(depth, breaks)
        one, two = (normal.pressure(depth + s, rate)[0] for s in (h, -h))
        _same(by_depth, (one - two) / (2 * h), p / h, away, "depth")
        h = STEP * np.abs(rate).max() * np.ones_like(rate)
        one, two = (normal.pressure(depth, rate + s)[0] for s in (h, -h))
        _same(by_rate, (one - two) / (2 * h), p / h, np.ones_like(away), "rate")


def check_friction_law(friction: FrictionLaw, seed: int = 0, trials: int = 20) -> None:
    """Laws of a friction law: friction opposes slip and vanishes with it, without a jump if nothing
    sticks; the derivative is that of the friction ratio away from the breaks (kinks); equal values
    for equal arguments. Slip rates are drawn around the breaks."""
    rng, breaks = np.random.default_rng(seed), _breaks(friction.breaks)
    # sticks: deflection, m, and number of bristles of a law with static friction, else None
    unit, sticks = max(map(abs, breaks), default=1.0), friction.bristles
    none, least, most = np.abs(friction.ratio(unit * np.array([0.0, 1e-9, 1.0]))[0])
    law(none == 0.0 and (sticks or least <= 1e-3 * most), "friction without slip")
    law(sticks is None or min(least, *sticks) > 0, "bristles without friction or a deflection")
    for _ in range(trials):
        slip = rng.choice([-1.0, 1.0], (3, 4)) * unit * 10.0 ** rng.uniform(-2, 2, (3, 4))
        ratio, slope = friction.ratio(slip)
        law(ratio.shape == slope.shape == slip.shape, "shapes differ")
        law(np.array_equal(ratio, friction.ratio(slip)[0]), "two values from equal arguments")
        law(bool((ratio * slip >= 0).all()), "friction that drives the slip")
        # ratio / h: measure of the difference quotient's rounding; compared away from the breaks
        h = STEP * np.abs(slip)
        one, two = (friction.ratio(slip + s)[0] for s in (h, -h))
        _same(slope, (one - two) / (2 * h), ratio / h, _away(np.abs(slip), breaks), "slip")


def _breaks(values: tuple[float, ...]) -> FloatArray:
    breaks = np.array(values, dtype=np.float64)
    law(bool(np.isfinite(breaks).all() and (np.diff(breaks) > 0).all()), "breaks must increase")
    return breaks


def _away(values: FloatArray, breaks: FloatArray) -> FloatArray:
    """Mask: 1 where a central difference does not straddle a break, else 0."""
    near = np.abs(values[..., None] - np.abs(breaks)) <= 2 * STEP * values[..., None]
    return np.asarray(~near.any(axis=-1), dtype=np.float64)


def _same(
    got: FloatArray, want: FloatArray, noise: FloatArray, away: FloatArray, by: str
) -> None:
    error = np.abs(got - want) * away
    allowed = 1e-5 * np.abs(want) + 1e-13 * np.abs(noise) + 1e-9 * np.abs(got).max()
    law(bool((error <= allowed).all()), f"the derivative by {by} is not that of the value")
