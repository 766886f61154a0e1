"""Rigid bodies in space: free rotation, the heavy top, the spherical double pendulum."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj

from sparsemor.bodies.frames import rotation as rot
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

pytestmark = pytest.mark.full

ALPHA: dict[str, Any] = {"use": "generalized_alpha", "rho_inf": 1.0}
MOMENTS = np.array([1.0, 2.0, 3.0])
SPIN = [0.2, 1.0, 0.5]
DRIFT = [1.0, -2.0, 0.5]
"""Velocity, m/s."""


def run(
    bodies: dict[str, Any], end: float, h: float, integrator: dict[str, Any] = ALPHA, **more: Any
) -> March:
    return march(scene_of({"bodies": bodies, "time": {"end": end, "step": h},
                           "integrator": integrator, **more}))


def rates(got: March, name: str) -> FloatArray:
    """(M, 3) angular velocities in body axes."""
    at = got.model.layout[f"{name}.rigid"]
    return np.array([2 * rot.to_body(x[3:]) @ v[3:]
                     for x, v in zip(got.x[:, at], got.v[:, at], strict=True)])


def turns(got: March, name: str) -> FloatArray:
    """(M, 3, 3): body axes to space axes."""
    return np.array([rot.rotation(x[3:]) for x in got.block(f"{name}.rigid")])


# --------------------------------------------------------------------------- free rotation


def free(h: float, end: float, integrator: dict[str, Any] = ALPHA) -> March:
    body = {"use": "rigid", "mass": 2.0, "inertia": MOMENTS.tolist(),
            "pose": {"spin": SPIN, "velocity": DRIFT}}
    return run({"body": body}, end, h, integrator)


def euler(t: FloatArray) -> FloatArray:
    """Jacobi's solution for moments A < B < C, from the passage of w2 = 0 on (Landau and Lifshitz,
    Mechanics, sec. 37): L^2 > 2 E B."""
    A, B, C = MOMENTS
    w = np.array(SPIN)
    E2, L2 = float(w @ (MOMENTS * w)), float((MOMENTS * w) @ (MOMENTS * w))
    assert L2 > E2 * B
    speed = np.sqrt((C - B) * (L2 - E2 * A) / (A * B * C))
    m = (B - A) * (E2 * C - L2) / ((C - B) * (L2 - E2 * A))
    size = np.sqrt([(E2 * C - L2) / (A * (C - A)), (E2 * C - L2) / (B * (C - B)),
                    (L2 - E2 * A) / (C * (C - A))])
    # w2 starts at a given value of sn and rises or falls with the sign of w1 w3 (C - A) / B > 0
    phase = np.arcsin(w[1] / size[1])
    u0 = solve_ivp(lambda x, u: 1 / np.sqrt(1 - m * np.sin(x) ** 2), (0, phase), [0.0],
                   rtol=1e-12, atol=1e-13).y[0, -1]
    sn, cn, dn, _ = ellipj(u0 + speed * t, m)
    return np.stack([size[0] * cn, size[1] * sn, size[2] * dn], axis=1)


def test_a_free_body_turns_as_jacobis_functions_say() -> None:
    """Second order; the middle axis flips."""
    worst = []
    for h in (4e-3, 2e-3):
        got = free(h, 6.0)
        worst.append(np.abs(rates(got, "body") - euler(got.t)).max())
    assert euler(np.array([0.0]))[0] == pytest.approx(SPIN, rel=1e-12)
    assert worst[1] < 4e-6
    assert np.log2(worst[0] / worst[1]) == pytest.approx(2.0, abs=0.05)


def conserved(x: FloatArray, v: FloatArray) -> tuple[float, float]:
    """Largest relative changes of energy and angular momentum; x, v (M, 7)."""
    w = np.array([2 * rot.to_body(p[3:]) @ dp[3:] for p, dp in zip(x, v, strict=True)])
    A = np.array([rot.rotation(p[3:]) for p in x])
    energy = (MOMENTS * w * w).sum(axis=1)
    momentum = np.einsum("tij,tj->ti", A, MOMENTS * w)
    return (float(np.abs(energy / energy[0] - 1).max()),
            float(np.abs(momentum - momentum[0]).max() / np.linalg.norm(momentum[0])))


@pytest.mark.slow
def test_the_middle_axis_flips_and_energy_and_momentum_are_kept_to_1e_9() -> None:
    """Relative. One run of the second-order rule keeps them to 1e-8 with small steps; two of them
    extrapolated to h = 0 (Richardson) to 1e-9. Smaller steps would meet the round-off of
    coordinates, which makes eps / h in the rates."""
    states = []
    for every, h in ((1, 5e-4), (2, 2.5e-4)):
        got = free(h, 5.12, {"use": "generalized_alpha", "rho_inf": 0.8})
        at = got.model.layout["body.rigid"]
        states.append((got.x[::every, at], got.v[::every, at]))
    assert rates(got, "body")[:, 1].min() < -0.99
    assert max(conserved(*states[1])) < 1e-8
    x, v = ((4 * fine - coarse) / 3 for coarse, fine in zip(*states, strict=True))
    assert max(conserved(x, v)) < 1e-9
    np.testing.assert_allclose(x[:, :3], np.outer(got.t[::2], DRIFT), rtol=0, atol=1e-8)


# --------------------------------------------------------------------------- heavy top

TOP = {"mass": 1.0, "across": 0.02, "along": 0.01, "height": 0.3, "tilt": 0.5}
G = 9.81


def top(spin: list[float], end: float, h: float) -> March:
    """A symmetric top on a spherical joint; its axis is tilted about x at the start."""
    about_com = [TOP["across"], TOP["across"], TOP["along"]]
    body = {"use": "rigid", "mass": TOP["mass"], "inertia": about_com,
            "center": [0.0, 0.0, TOP["height"]], "points": {"tip": [0.0, 0.0, 0.0]},
            "pose": {"axis": [1, 0, 0], "angle": TOP["tilt"], "spin": spin}}
    return run({"top": body}, end, h, {"use": "generalized_alpha", "rho_inf": 0.8},
               joints={"tip": {"use": "spherical", "between": ["ground", "top:tip"]}},
               loads={"gravity": {"use": "gravity", "g": [0.0, 0.0, -G]}})


def axis(got: March) -> FloatArray:
    """(M, 3) direction of the top's axis."""
    return np.asarray(turns(got, "top")[:, :, 2])


def along(speed: float, precession: float = 0.0) -> list[float]:
    """Spin about the tilted axis and about the vertical, space axes."""
    a = TOP["tilt"]
    return [0.0, float(-speed * np.sin(a)), float(speed * np.cos(a) + precession)]


def test_a_top_precesses_steadily_where_the_closed_form_says() -> None:
    """I1 W^2 cos a - I3 w3 W + m g l = 0 (Goldstein, Classical Mechanics, sec. 5.7)."""
    I1, I3 = TOP["across"] + TOP["mass"] * TOP["height"] ** 2, TOP["along"]
    w3, c, drive = 120.0, np.cos(TOP["tilt"]), TOP["mass"] * G * TOP["height"]
    W = (I3 * w3 - np.sqrt((I3 * w3) ** 2 - 4 * I1 * c * drive)) / (2 * I1 * c)
    got = top(along(w3 - W * c, W), 1.0, 5e-4)
    z = axis(got)
    assert W == pytest.approx(3.3615, rel=1e-4)
    assert np.abs(z[:, 2] - c).max() < 1e-4
    turned = np.unwrap(np.arctan2(z[:, 1], z[:, 0]))
    assert (turned[-1] - turned[0]) == pytest.approx(W * 1.0, rel=1e-3)


@cache
def nutation(speed: float, end: float) -> tuple[float, float, float, float]:
    """Tilt and precession angle at the end, and the least and largest cosine of the tilt, of a top
    let go with its axis at rest: two integrals of motion leave one equation for u = cos a."""
    I1, I3 = TOP["across"] + TOP["mass"] * TOP["height"] ** 2, TOP["along"]
    a0, drive = TOP["tilt"], TOP["mass"] * G * TOP["height"]
    p_psi, p_phi = I3 * speed, I3 * speed * np.cos(a0)

    def motion(t: float, y: FloatArray) -> list[float]:
        a, da, _ = y
        s, c = np.sin(a), np.cos(a)
        turn = (p_phi - p_psi * c) / (I1 * s * s)
        return [da, turn * turn * s * c - p_psi * turn * s / I1 + drive * s / I1, turn]

    y = solve_ivp(motion, (0, end), [a0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13).y
    # (u0 - u) (2 drive I1 (1 - u^2) - p_psi^2 (u0 - u)) = 0 at the turning points
    u0 = np.cos(a0)
    roots = np.roots([-2 * drive * I1, p_psi**2, 2 * drive * I1 - p_psi**2 * u0])
    low = float(min(r.real for r in roots if -1 <= r.real <= u0))
    return float(y[0, -1]), float(y[2, -1]), low, float(u0)


def test_a_top_let_go_nutates_between_the_roots_of_the_cubic() -> None:
    speed, end = 120.0, 0.6
    tilt, turned, low, high = nutation(speed, end)
    errors = []
    for h in (5e-4, 2.5e-4):
        z = axis(top(along(speed), end, h))
        angle = np.unwrap(np.arctan2(z[:, 1], z[:, 0]))
        errors.append([abs(np.arccos(z[-1, 2]) - tilt), abs(angle[-1] - angle[0] - turned)])
    assert z[:, 2].min() == pytest.approx(low, abs=1e-4)
    assert z[:, 2].max() == pytest.approx(high, abs=1e-6)
    assert high - low > 0.29
    assert np.max(errors[1]) < 1e-3
    np.testing.assert_allclose(np.log2(np.array(errors[0]) / errors[1]), 2.0, atol=0.2)


# --------------------------------------------------------------------------- double pendulum

LINKS: list[dict[str, Any]] = [
    {"mass": 1.2, "inertia": [0.02, 0.05, 0.06], "center": [0.25, 0.01, -0.02],
     "tip": [0.5, 0.0, 0.03], "axis": [0.0, 1.0, 0.2], "angle": 0.3, "spin": [1.0, -0.5, 2.0]},
    {"mass": 0.7, "inertia": [0.01, 0.03, 0.035], "center": [0.2, 0.0, 0.01],
     "tip": [0.4, 0.0, 0.0], "axis": [1.0, 0.5, 0.0], "angle": 1.1, "spin": [-2.0, 1.0, 0.5]}]


def turn_of(link: dict[str, Any]) -> FloatArray:
    """Rodrigues' formula, written independently of the package."""
    a = np.array(link["axis"]) / np.linalg.norm(link["axis"])
    K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.asarray(np.eye(3) + np.sin(link["angle"]) * K + (1 - np.cos(link["angle"])) * K @ K)


def pendulum_rates(t: float, y: FloatArray) -> FloatArray:
    """Two rotation matrices and two angular velocities (space axes): virtual power of both links
    in the six rates, with the spherical joints built in."""
    A, w = y[:18].reshape(2, 3, 3), y[18:].reshape(2, 3)
    M, f = np.zeros((6, 6)), np.zeros(6)
    hang, bias = np.zeros((3, 6)), np.zeros(3)  # acceleration of the hinge: hang @ al + bias
    for i, link in enumerate(LINKS):
        at = slice(3 * i, 3 * i + 3)
        J = A[i] @ np.diag(link["inertia"]) @ A[i].T
        com, tip = A[i] @ np.array(link["center"]), A[i] @ np.array(link["tip"])
        P = hang.copy()
        P[:, at] += np.cross(np.eye(3), com).T  # al x com as a matrix on al
        c = bias + np.cross(w[i], np.cross(w[i], com))
        M += link["mass"] * P.T @ P
        M[at, at] += J
        f += link["mass"] * P.T @ (np.array([0.0, 0.0, -G]) - c)
        f[at] -= np.cross(w[i], J @ w[i])
        hang[:, at] += np.cross(np.eye(3), tip).T
        bias = bias + np.cross(w[i], np.cross(w[i], tip))
    al = np.linalg.solve(M, f)
    dA = np.stack([np.cross(w[i], A[i].T).T for i in range(2)])
    return np.concatenate([dA.ravel(), al])


@cache
def pendulum_reference(end: float) -> tuple[FloatArray, FloatArray]:
    start = np.concatenate([*(turn_of(k).ravel() for k in LINKS), *(k["spin"] for k in LINKS)])
    y = solve_ivp(pendulum_rates, (0, end), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return y[:18].reshape(2, 3, 3), y[18:].reshape(2, 3)


def pendulum(h: float, end: float, integrator: dict[str, Any] = ALPHA) -> March:
    one, two = LINKS
    hinge = turn_of(one) @ np.array(one["tip"])
    poses: list[dict[str, Any]] = [
        {"spin": one["spin"]}, {"spin": two["spin"], "position": hinge.tolist(),
                                "velocity": np.cross(one["spin"], hinge).tolist()}]
    bodies = {name: {
        "use": "rigid", "mass": k["mass"], "inertia": k["inertia"], "center": k["center"],
        "points": {"a": [0.0, 0.0, 0.0], "b": k["tip"]},
        "pose": {**pose, "axis": k["axis"], "angle": k["angle"]}}
        for name, k, pose in zip(("one", "two"), LINKS, poses, strict=True)}
    return run(bodies, end, h, integrator,
               joints={"A": {"use": "spherical", "between": ["ground", "one:a"]},
                       "B": {"use": "spherical", "between": ["one:b", "two:a"]}},
               loads={"gravity": {"use": "gravity", "g": [0.0, 0.0, -G]}})


@pytest.mark.parametrize(("integrator", "order"), [
    ({"use": "bdf1"}, 1), ({"use": "bdf2"}, 2), ({"use": "generalized_alpha", "rho_inf": 0.8}, 2)])
def test_spherical_double_pendulum_comes_to_the_independent_integration(
    integrator: dict[str, Any], order: int
) -> None:
    end = 1.0
    A, w = pendulum_reference(end)
    worst = []
    for h in (1e-3, 5e-4):
        got = pendulum(h, end, integrator)
        B = np.stack([turns(got, n)[-1] for n in ("one", "two")])
        v = np.stack([B[i] @ rates(got, n)[-1] for i, n in enumerate(("one", "two"))])
        worst.append([np.abs(B - A).max(), np.abs(v - w).max()])
    np.testing.assert_allclose(np.log2(np.array(worst[0]) / worst[1]), order, atol=0.1)
    assert np.max(worst[1]) < {1: 0.2, 2: 2e-3}[order]


def test_reactions_of_the_pendulum_are_those_of_its_acceleration() -> None:
    """Newton's law for both links together: the ground carries weight less inertia."""
    got = pendulum(5e-4, 0.3, {"use": "generalized_alpha", "rho_inf": 0.8})
    at = -1
    total = np.zeros(3)
    layout = got.model.layout
    for i, name in enumerate(("one", "two")):
        k, x, v, a = LINKS[i], *(q[at, layout[f"{name}.rigid"]] for q in (got.x, got.v, got.a))
        A, G_ = rot.rotation(x[3:]), rot.to_body(x[3:])
        spin, al = A @ (2 * G_ @ v[3:]), A @ (2 * G_ @ a[3:])
        com = A @ np.array(k["center"])
        acc = a[:3] + np.cross(al, com) + np.cross(spin, np.cross(spin, com))
        total += k["mass"] * (acc - np.array([0.0, 0.0, -G]))
    np.testing.assert_allclose(-got.block("A.multiplier")[at], total, rtol=0, atol=1e-9 * G)
