"""The spherical pendulum as general motion in space: a rod on a ball, with no axis that stays."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.special import ellipj, ellipk

from sparsemor.bodies.frames import rotation as rot
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import march, scene_of

G = 9.81
ROD = {"mass": 0.8, "arm": 0.5, "across": 0.05, "along": 1e-3, "down": 0.6}
"""down: angle below the level at the start, rad."""
PULL = ROD["mass"] * G * ROD["arm"] / (ROD["across"] + ROD["mass"] * ROD["arm"] ** 2)
"""Weight's moment over inertia, 1/s^2."""


def swinging(speed: float, end: float, h: float) -> FloatArray:
    """(M, 3) directions of a rod on a spherical joint, thrown sideways at an angular speed (1/s):
    seven coordinates, and no axis that stays."""
    s, c = np.sin(ROD["down"]), np.cos(ROD["down"])
    body = {"use": "rigid", "mass": ROD["mass"], "center": [ROD["arm"], 0.0, 0.0],
            "inertia": [ROD["along"], ROD["across"], ROD["across"]],
            "points": {"eye": [0.0, 0.0, 0.0]},
            "pose": {"axis": [0, 1, 0], "angle": ROD["down"],
                     "spin": [speed * s, 0.0, speed * c]}}
    got = march(scene_of({
        "bodies": {"rod": body}, "time": {"end": end, "step": h},
        "joints": {"hook": {"use": "spherical", "between": ["ground", "rod:eye"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, 0.0, -G]}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0}}))
    at = got.model.layout["rod.rigid"]
    x, v = got.x[:, at], got.v[:, at]
    about = [2 * rot.to_body(q[3:])[0] @ p[3:] for q, p in zip(x, v, strict=True)]
    assert np.abs(about).max() < 1e-9 * speed  # nothing turns it about itself
    return np.array([rot.rotation(q[3:])[:, 0] for q in x])


def height(t: FloatArray, speed: float) -> FloatArray:
    """Closed form of a start at a turning point: z'^2 = 2 k (z - z1) (z2 - z) (z3 - z) is solved by
    z1 + (z2 - z1) sn^2 (Landau and Lifshitz, Mechanics, sec. 14)."""
    z0 = -np.sin(ROD["down"])
    energy = speed**2 / (2 * PULL) + z0
    about = speed * np.cos(ROD["down"])
    low, high, far = np.sort(np.roots(
        [1.0, -energy, -1.0, energy - about**2 / (2 * PULL)]).real)
    m, beat = (high - low) / (far - low), np.sqrt(PULL * (far - low) / 2)
    start = 0.0 if abs(z0 - low) < abs(z0 - high) else ellipk(m)
    return np.asarray(low + (high - low) * ellipj(start + beat * t, m)[0] ** 2)


@pytest.mark.full
@pytest.mark.parametrize("speed", [2.0, 6.0])
def test_a_spherical_pendulum_swings_as_elliptic_functions_say(speed: float) -> None:
    """Height and azimuth, over several swings, below the level and above it; second order."""
    end, worst = 2.0, []
    for h in (2e-3, 1e-3):
        e = swinging(speed, end, h)
        t = h * np.arange(len(e))
        z = height(t, speed)
        turning = speed * np.cos(ROD["down"]) / (1 - z**2)
        around = cumulative_simpson(turning, x=t, initial=0)
        seen = np.unwrap(np.arctan2(e[:, 1], e[:, 0]))
        worst.append([np.abs(e[:, 2] - z).max(), np.abs(seen - around).max()])
    assert np.ptp(z) > 0.3 and around[-1] > np.pi
    np.testing.assert_allclose(np.log2(np.array(worst[0]) / worst[1]), 2.0, atol=0.1)
    assert np.max(worst[1]) < 1e-3


@pytest.mark.full
def test_a_conical_pendulum_goes_around_at_one_height() -> None:
    rate = np.sqrt(PULL / np.sin(ROD["down"]))
    e = swinging(rate * np.cos(ROD["down"]), 1.0, 1e-3)
    np.testing.assert_allclose(e[:, 2], -np.sin(ROD["down"]), rtol=0, atol=1e-4)
    assert np.unwrap(np.arctan2(e[:, 1], e[:, 0]))[-1] == pytest.approx(rate, rel=1e-4)
