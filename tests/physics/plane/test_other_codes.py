"""Flexible pendulums in the plane by other codes: Exudyn with the same equations, and absolute
coordinates with finite strains."""

import numpy as np
import pytest

from absolute_pendulum import absolute, absolute_tip, swing, tip
from sparsemor.core.arrays import FloatArray

INTERVAL = 0.01
AGREE = 1e-6
"""Largest distance of two tips, m, for E 7e8 Pa or more."""


EXUDYN: dict[tuple[int, float], list[tuple[float, float]]] = {
}
"""Tips at 0.25, 0.5, 0.75 and 1 s by Exudyn 1.13.6 (Gerstmayr 2023, doi 10.1007/s11044-023-09937-1),
m, by number of bars and E, Pa, with steps of 1e-4 s: printed by tests/benchmarks/other_code.py."""


def apart(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(a - b, axis=1).max())


def extrapolated(links: int, E: float, h: float, end: float) -> FloatArray:
    """Tips of the product's runs with steps h and h / 2, whose error is of order 2."""
    coarse, fine = (tip(swing(links, E, step, end, INTERVAL)) for step in (h, h / 2))
    return fine + (fine - coarse) / 3


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2])
def test_a_second_in_absolute_coordinates(links: int) -> None:
    """The distance is the theory's (small strains and rotations of the bar in its frame): it falls
    with the square of the deflection until what the time steps leave is larger."""
    far = {}
    for E, h in ((7e7, 2e-4), (7e8, 1e-4)):
        start = swing(links, E, 1e-3, 1e-3, 1e-3)
        other, _ = absolute_tip(start, E, 1.0, INTERVAL)
        far[E] = apart(extrapolated(links, E, h, 1.0), other)
    assert far[7e8] < AGREE
    assert far[7e8] < far[7e7] / 5


@pytest.mark.full
def test_a_bar_in_absolute_coordinates() -> None:
    run = swing(1, 7e8, 2e-4, 0.05, INTERVAL)
    other, step = absolute_tip(run, 7e8, 0.05, INTERVAL)
    halved, _ = absolute_tip(run, 7e8, 0.05, INTERVAL, halved=1)
    assert apart(other, halved) < 1e-8
    assert apart(extrapolated(1, 7e8, 2e-4, 0.05), halved) < AGREE


def test_absolute_coordinates_keep_the_energy_and_do_not_strain_when_they_turn() -> None:
    """The check of the other computation itself."""
    other, _ = absolute(swing(1, 7e8, 1e-3, 1e-3, 1e-3), 7e8)
    c, s = np.cos(1.0), np.sin(1.0)
    _, strain, _ = other.stresses(other.start @ np.array([[c, s], [-s, c]]) + 3.0)
    assert np.abs(strain).max() < 1e-13
    assert other.fastest() > 1e4
    _, energies = other.fall(2e-5, 500, 100)
    moved = other.energy(other.start, np.zeros_like(other.start)) - energies
    assert np.abs(moved).max() < 1e-7
