"""Flexible pendulums in the plane by other codes: Exudyn with the same equations, and absolute
coordinates with finite strains."""

import numpy as np
import pytest

from absolute_pendulum import absolute, absolute_tip, swing, tip
from sparsemor.core.arrays import FloatArray

INTERVAL = 0.01
AGREE = 1e-6
"""Largest distance of two tips, m."""


EXUDYN: dict[tuple[int, float], list[tuple[float, float]]] = {
    (1, 7e7): [(0.917897662, -0.397049664), (0.059264885, -0.998474777),
              (-0.884235824, -0.467273331), (-0.999995084, -0.003373576)],
    (2, 7e8): [(1.933126211, -0.217244553), (1.363167002, -1.303493272),
              (-0.614158037, -1.819143577), (-1.756143714, -0.953574524)],
}
"""Tips at 0.25, 0.5, 0.75 and 1 s, m, by number of bars and E, Pa, with steps of 1e-4 s: Exudyn
1.13.6 (Gerstmayr 2023, doi 10.1007/s11044-023-09937-1), by tests/benchmarks/other_code.py."""


def apart(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(a - b, axis=1).max())


def extrapolated(links: int, E: float, h: float, end: float) -> FloatArray:
    """Tips of the product's runs with steps h and h / 2, whose error is of order 2."""
    coarse, fine = (tip(swing(links, E, step, end, INTERVAL)) for step in (h, h / 2))
    return fine + (fine - coarse) / 3


@pytest.mark.slow
@pytest.mark.parametrize("links,E", EXUDYN)
def test_a_second_in_exudyn(links: int, E: float) -> None:
    """The same equations and steps in another code: a floating frame, nodal coordinates. Its joints
    hold the mean of the end's nodes, ours the mean over the end's length, which the warping of the
    end sets 8e-6 m apart at most; with means over nodes the distance was below 1e-6 m."""
    run = tip(swing(links, E, 1e-4, 1.0, 0.25))
    assert apart(run[1:], np.array(EXUDYN[links, E])) < 10 * AGREE


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2])
def test_a_second_in_absolute_coordinates(links: int) -> None:
    """The distance is the theory's (small strains and rotations of the bar in its frame), so that
    it falls as bars get stiffer; steps of 1e-4 and 5e-5 s leave less."""
    far = {}
    for E in (7e7, 7e8):
        start = swing(links, E, 1e-3, 1e-3, 1e-3)
        other, _ = absolute_tip(start, E, 1.0, INTERVAL)
        far[E] = apart(extrapolated(links, E, 1e-4, 1.0), other)
    assert far[7e8] < 2 * AGREE
    assert far[7e8] < far[7e7] / 10


@pytest.mark.full
def test_a_bar_in_absolute_coordinates() -> None:
    run = swing(1, 7e8, 2e-4, 0.05, INTERVAL)
    other, _ = absolute_tip(run, 7e8, 0.05, INTERVAL)
    halved, _ = absolute_tip(run, 7e8, 0.05, INTERVAL, halved=1)
    assert apart(other, halved) < 1e-8
    assert apart(extrapolated(1, 7e8, 2e-4, 0.05), halved) < AGREE


@pytest.mark.full
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
