"""Flexible bodies in space: what free flight must conserve, and limits with known answers."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.in_memory_run import March, march, scene_of

CORNERS = ["left_front_bottom", "right_front_bottom", "left_back_bottom"]
BAR: dict[str, Any] = {
    "use": "flexible", "fields": ["elastic"], "material": {"E": 2e8, "nu": 0.3, "rho": 1100},
    "mesh": BlockMesh(lower=(-0.1, -0.05, -0.03), size=(0.5, 0.1, 0.06), divisions=(6, 2, 1)),
    "reference": {"chord": CORNERS},
    "pose": {"position": [0.3, -0.2, 0.1], "axis": [1, 2, 3], "angle": 0.4,
             "velocity": [1.0, 2.0, 0.5], "spin": [6.0, -9.0, 20.0]}}


def the(got: March, name: str) -> FloatingBody:
    body = got.model.parts[name]
    assert isinstance(body, FloatingBody)
    return body


def nodal(got: March, name: str, at: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, velocities and accelerations (N, 3) of the nodes in space axes."""
    body, fields = the(got, name), []
    for values in (got.x, got.v, got.a):
        u = np.zeros(body.X.size)
        if body.elasticity is not None:
            u[body.elasticity.free] = values[at, got.model.layout[f"{name}.elastic"]]
        fields.append((values[at, got.model.layout[f"{name}.rigid"]], u.reshape(-1, 3)))
    (y, u0), (dy, u1), (ddy, u2) = fields
    A, turn = rot.rotation(y[3:]), 2 * rot.to_body(y[3:])
    z, w, al = body.X + u0, turn @ dy[3:], turn @ ddy[3:]
    speed = u1 + np.cross(w, z)
    push = u2 + np.cross(al, z) + np.cross(w, np.cross(w, z)) + 2 * np.cross(w, u1)
    return y[:3] + z @ A.T, dy[:3] + speed @ A.T, ddy[:3] + push @ A.T


def moments(body: FloatingBody, place: FloatArray, vector: FloatArray) -> FloatArray:
    """(6,): sum m vector and sum place x m vector."""
    assert body.mass_matrix is not None
    p = body.mass_matrix @ vector
    return np.concatenate([p.sum(axis=0), np.cross(place, p).sum(axis=0)])


def energy(got: March, name: str, at: int) -> float:
    body = the(got, name)
    assert body.mass_matrix is not None and body.elasticity is not None
    v, free = nodal(got, name, at)[1], body.elasticity.free
    u = got.x[at, got.model.layout[f"{name}.elastic"]]
    strain = u @ (body.elasticity.stiffness[free][:, free] @ u)
    return 0.5 * float(np.sum(v * (body.mass_matrix @ v)) + strain)


def flight(h: float, rho: float = 1.0, end: float = 0.05, **change: Any) -> March:
    return march(scene_of({"bodies": {"bar": {**BAR, **change}}, "time": {"end": end, "step": h},
                           "integrator": {"use": "generalized_alpha", "rho_inf": rho}}))


@cache
def flights() -> tuple[March, March]:
    return flight(5e-4), flight(2.5e-4)


@pytest.mark.full
def test_inertia_forces_of_a_free_body_balance_at_every_instant() -> None:
    """To round-off: the equations hold at the step's end, whatever the integrator."""
    got = flights()[0]
    bar = the(got, "bar")
    assert np.abs(got.block("bar.elastic")).max() > 5e-5  # it does deform
    for at in (1, 10, 100):
        place, _, acceleration = nodal(got, "bar", at)
        assert bar.inertia is not None and bar.mass_matrix is not None
        size = np.abs(bar.mass_matrix @ acceleration).sum()
        assert size > 50.0
        assert np.abs(moments(bar, place, acceleration)).max() < 1e-8 * size


@pytest.mark.full
def test_momentum_and_energy_are_kept_to_second_order() -> None:
    """rho_inf = 1: nothing is damped."""
    drifts, losses = [], []
    for got in flights():
        at = range(0, len(got.t), 5)
        kept = np.array([moments(the(got, "bar"), *nodal(got, "bar", i)[:2]) for i in at])
        work = np.array([energy(got, "bar", i) for i in at])
        drifts.append(float(np.abs(kept - kept[0]).max() / np.abs(kept[0]).max()))
        losses.append(float(np.abs(work - work[0]).max() / work[0]))
    assert drifts[1] < 2e-4 and losses[1] < 2e-3
    assert np.log2(drifts[0] / drifts[1]) > 1.8
    assert np.log2(losses[0] / losses[1]) > 1.8


@pytest.mark.slow
def test_energy_and_momentum_do_not_drift() -> None:
    """3000 steps, one turn of the bar: what is lost in the first half comes back."""
    got = flight(1e-4, end=0.3)
    at = range(0, len(got.t), 10)
    work = np.array([energy(got, "bar", i) for i in at])
    kept = np.array([moments(the(got, "bar"), *nodal(got, "bar", i)[:2]) for i in at])
    lost = np.abs(work / work[0] - 1.0)
    off = np.abs(kept - kept[0]).max(axis=1) / np.abs(kept[0]).max()
    half = len(work) // 2
    for found in (lost, off):
        assert found.max() < 1e-5
        assert found[half:].max() < 1.3 * found[:half].max()


def swings(h: float) -> tuple[float, float, float]:
    """Largest changes of energy and of angular momentum about the vertical, relative, and largest
    displacement over the length, of a bar that swings on a ball without staying in a plane."""
    spin = [2.0, 3.0, 6.0]
    got = march(scene_of({
        "bodies": {"bar": {**BAR, "mesh": BlockMesh(size=(0.5, 0.1, 0.06), divisions=(6, 2, 1)),
                           "sets": {"eye": {"nearest": [0.0, 0.0, 0.0]}},
                           "material": {"E": 2e7, "nu": 0.3, "rho": 1100},
                           "pose": {"spin": spin}}},
        "joints": {"hook": {"use": "spherical", "between": ["ground", "bar:eye"]}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -9.81]}},
        "time": {"end": 0.25, "step": h},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0}}))
    body, whole, about = the(got, "bar"), [], []
    assert body.mass_matrix is not None
    for at in range(0, len(got.t), len(got.t) // 40):
        place, speed, _ = nodal(got, "bar", at)
        lifted = 9.81 * float((body.mass_matrix @ place)[:, 2].sum())
        whole.append(energy(got, "bar", at) + lifted)
        about.append(moments(body, place, speed)[5])
    moved = float(np.abs(got.block("bar.elastic")).max()) / 0.5
    return (float(np.ptp(whole)) / abs(energy(got, "bar", 0)),
            float(np.ptp(about)) / abs(about[0]), moved)


@pytest.mark.full
def test_a_bar_that_swings_on_a_ball_keeps_energy_and_turn_about_the_vertical() -> None:
    """General motion under gravity, rho_inf = 1: to second order over a factor of four in the step;
    from one halving to the next the order scatters (1.7 to 2.2), since the longer steps hardly
    resolve the vibrations."""
    coarse, fine = (np.array(swings(h)) for h in (2e-3, 5e-4))
    assert fine[2] > 1e-3  # it does bend
    assert np.all(fine[:2] < 2e-5)
    assert np.all(np.log2(coarse[:2] / fine[:2]) / 2.0 > 1.8)


@pytest.mark.full
def test_reference_conditions_do_not_change_the_motion() -> None:
    """Other ties of the displacements describe the same body: nodes in space agree to the time
    error, which falls with the square of the step."""
    other = {"chord": ["right_back_top", "left_back_top", "right_front_top"]}
    gaps = []
    for h, plain in zip((5e-4, 2.5e-4), flights(), strict=True):
        swapped = flight(h, reference=other)
        gaps.append(np.abs(nodal(plain, "bar", -1)[0] - nodal(swapped, "bar", -1)[0]).max())
    assert gaps[1] < 2e-4
    assert np.log2(gaps[0] / gaps[1]) > 1.5


@pytest.mark.full
def test_a_very_stiff_flexible_body_is_the_rigid_body_of_its_numbers() -> None:
    """Hung on one corner, under gravity."""
    joint = {"A": {"use": "spherical", "between": ["ground", "bar:left_front_bottom"]}}
    more: dict[str, Any] = {
        "loads": {"g": {"use": "gravity"}}, "time": {"end": 0.3, "step": 1e-3}, "joints": joint,
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}}
    pose = {"spin": [1.0, 2.0, 3.0], "velocity": [0.0, 0.0, 0.0]}
    corner = np.array([-0.1, -0.05, -0.03])
    pose["velocity"] = (-np.cross(pose["spin"], corner)).tolist()
    stiff = march(scene_of({"bodies": {"bar": {
        **BAR, "material": {"E": 2e13, "nu": 0.3, "rho": 1100}, "damping": {"stiffness": 1e-5},
        "pose": pose}}, **more}))
    bar = the(stiff, "bar")
    assert bar.inertia is not None
    center = bar.inertia.moment / bar.inertia.mass
    sides = np.array([0.5, 0.1, 0.06])
    about = bar.inertia.mass / 12 * ((sides**2).sum() - sides**2)
    np.testing.assert_allclose(center, corner + sides / 2, rtol=0, atol=1e-12)
    rigid = march(scene_of({"bodies": {"bar": {
        "use": "rigid", "mass": bar.inertia.mass, "center": center.tolist(),
        "inertia": about.tolist(), "points": {"left_front_bottom": corner.tolist()},
        "pose": pose}}, **more}))
    assert bar.inertia.mass == pytest.approx(1100 * 0.5 * 0.1 * 0.06)
    x = rigid.block("bar.rigid")
    assert np.ptp(x, axis=0).max() > 0.5
    np.testing.assert_allclose(stiff.block("bar.rigid"), x, rtol=0, atol=5e-6)
    late = slice(100, None)
    force = rigid.block("A.multiplier")[late]
    np.testing.assert_allclose(stiff.block("A.multiplier")[late], force, rtol=0,
                               atol=1e-3 * np.abs(force).max())


# --------------------------------------------------------------------------- spin about an axis


@pytest.mark.full
def test_a_spin_about_a_principal_axis_is_cheap_and_as_wide_as_statics_say() -> None:
    """On a hinge along the axis: the shape is the static answer to the centrifugal force, one
    factor serves the whole run, and a step takes one or two iterations."""
    spin = 60.0
    disk = {**BAR, "mesh": BlockMesh(lower=(-0.1, -0.1, -0.01), size=(0.2, 0.2, 0.02),
                                 divisions=(6, 6, 2)),
            "material": {"E": 2e9, "nu": 0.3, "rho": 7800}, "damping": {"stiffness": 1e-3},
            "sets": {"hub": {"box": [(-0.04, 0.04), (-0.04, 0.04), (-0.02, 0.02)]}},
            "reference": {"clamp": "hub"}, "pose": {"spin": [0.0, 0.0, spin]}}
    got = march(scene_of({
        "bodies": {"disk": disk},
        "joints": {"axle": {"use": "revolute", "between": ["ground", "disk:hub"],
                            "axis": [0, 0, 1]}},
        "time": {"end": 0.5, "step": 1e-3}}))
    body = the(got, "disk")
    e, m = body.elasticity, body.mass_matrix
    assert e is not None and m is not None
    W = np.diag([1.0, 1.0, 0.0])
    pull = (m @ body.X @ W).ravel()[e.free]
    K = e.stiffness.toarray()[np.ix_(e.free, e.free)]
    M = np.kron(m.toarray(), W)[np.ix_(e.free, e.free)]
    static = np.linalg.solve(K - spin**2 * M, spin**2 * pull)
    u = got.block("disk.elastic")[-1]
    now = got.v[-1, got.model.layout["disk.rigid"]][3:]
    w = 2 * rot.to_body(got.block("disk.rigid")[-1][3:]) @ now
    np.testing.assert_allclose(w[:2], 0.0, atol=1e-6)
    np.testing.assert_allclose(u, static * (w[2] / spin) ** 2, rtol=0,
                               atol=2e-3 * np.abs(static).max())
    assert np.mean(got.iterations[100:]) <= 2.0
    memory = got.solver.start(got.end)[1]
    assert got.solver.counters(memory)["factorizations"] == 1


# --------------------------------------------------------------------------- ties and heat


@pytest.mark.full
def test_held_components_are_the_ties_that_a_body_needs() -> None:
    """`hold` of the chord's own components is the chord; a plane body has two."""
    chord = flight(1e-3, end=0.01)
    corners = [{"hold": {CORNERS[0]: "xyz", CORNERS[1]: "yz", CORNERS[2]: "z"}}]
    held = flight(1e-3, end=0.01, reference=corners[0])
    np.testing.assert_array_equal(held.x, chord.x)
    flat = {"use": "flexible", "fields": ["elastic"], "material": BAR["material"],
            "mesh": {"use": "rectangle", "size": [1.0, 0.5], "divisions": [2, 1]},
            "thickness": 0.1, "reference": {"hold": {"bottom": "y", "bottom_left": "x"}}}
    body = assemble(scene_of({"bodies": {"plate": flat}, "time": {"end": 1.0, "step": 0.1}}))
    assert body.layout["plate.elastic"].stop - body.layout["plate.elastic"].start == 2 * 6 - 4


# --------------------------------------------------------------------------- heat, bad input


@pytest.mark.parametrize(("change", "words"), [
    ({"thickness": 0.1}, "the mesh is 3-D"),
    ({"model": "plane_stress"}, "take solid"),
    ({"reference": {"chord": CORNERS[:2]}}, "a chord is 3 one-point sets"),
    ({"reference": {"chord": [CORNERS[0], CORNERS[1], "mid"]}}, "lie on one line"),
    ({"reference": {"clamp": "edge"}}, "lie on one line"),
    ({"pose": {"spin": 1.0}}, "this body is in space"),
    ({"reference": {"hold": {"left": "xy"}}}, "still has 1 rigid motion"),
    ({"reference": {"hold": {"edge": "xyz"}}}, "still has 1 rigid motion:"),
    ({"reference": {"hold": {"edge": "x"}}}, "still has 5 rigid motions"),
    ({"reference": {"hold": {"nowhere": "x"}}}, "no set 'nowhere'"),
])
def test_wrong_bodies_are_told(change: dict[str, Any], words: str) -> None:
    sets = {"mid": {"nearest": [0.15, -0.05, -0.03]},
            "edge": {"where": "y < -0.0499 and z < -0.0299"}}
    scene = scene_of({"bodies": {"bar": {**BAR, "sets": sets, **change}},
                      "time": {"end": 1.0, "step": 0.1}})
    with pytest.raises(InputError, match=words):
        assemble(scene)
