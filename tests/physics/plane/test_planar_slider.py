"""The prismatic joint in the plane: inclined guides, turning guides, rigid and flexible sides."""

from typing import Any

import numpy as np
import pytest

from joint_runs import run
from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.kinematic_pairs import Prismatic
from sparsemor.core import InputError
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.prescribed_quantities import Followed
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.testing import check_joint
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from tests.laws.simulation.test_rigid_stage_in_space import stage_of
from tiers import quick

G, SLOPE = 9.81, 0.4
AXIS = [float(np.cos(SLOPE)), -float(np.sin(SLOPE))]  # downhill
WEIGHT = {"weight": {"use": "gravity", "g": [0.0, -G]}}
BLOCK = {"use": "rigid", "mass": 2.0, "inertia": 0.03, "center": [0.05, 0.1],
         "points": {"foot": [0.0, 0.0]}, "pose": {"position": [0.3, 0.2], "angle": -SLOPE}}
SHAPE = {"use": "rectangle", "lower": [-0.1, 0.0], "size": [0.2, 0.1], "divisions": [4, 2]}
SOFT = {"use": "flexible", "thickness": 0.02, "fields": ["elastic"], "mesh": SHAPE,
        "material": {"E": 5e7, "nu": 0.3, "rho": 1000}, "reference": {"clamp": "top"},
        "damping": {"stiffness": 2e-4}, "pose": {"angle": -SLOPE}}
MASS = 1000 * 0.2 * 0.1 * 0.02


def slope(end: float = 0.2, *between: str, **block: Any) -> March:
    rail = {"use": "prismatic", "between": list(between) or ["ground", "block:foot"], "axis": AXIS}
    return run({"block": {**BLOCK, **block}}, {"rail": rail}, end, 2e-3, WEIGHT)


@pytest.mark.full
def test_a_block_slides_down_with_g_sin_and_presses_with_g_cos() -> None:
    got = slope()
    x = got.block("block.rigid")
    along = 0.5 * G * np.sin(SLOPE) * got.t**2
    np.testing.assert_allclose(x[:, :2] - x[0, :2], np.outer(along, AXIS), rtol=0, atol=1e-12)
    assert np.abs(x[:, 2] + SLOPE).max() < 1e-12
    # multipliers are on the left-hand side: minus the force of the guide along J axis, and minus
    # its moment about the foot; the centre of mass is 0.05 m ahead of it
    force = -2.0 * G * np.cos(SLOPE)
    want = [force, 0.05 * force]
    np.testing.assert_allclose(got.block("rail.multiplier"), np.tile(want, (len(got.t), 1)),
                               rtol=1e-8)


def in_space() -> dict[str, Any]:
    return {"use": "rigid", "mass": 2.0, "inertia": [0.02, 0.02, 0.03], "center": [0.05, 0.1, 0.0],
            "points": {"foot": [0.0, 0.0, 0.0]}, "pose": {"position": [0.3, 0.2, 0.0],
                                                          "angle": -SLOPE}}


@pytest.mark.parametrize("between", [("ground", "block:foot"), ("block:foot", "ground")])
def test_its_multipliers_have_the_meaning_of_those_in_space(between: tuple[str, str]) -> None:
    """Forces as vectors, and the moment about z."""
    flat = slope(0.02, *between)
    rail = {"use": "prismatic", "between": list(between), "axis": [*AXIS, 0.0]}
    got = run({"block": in_space()}, {"rail": rail}, 0.02, 2e-3,
              {"weight": {"use": "gravity", "g": [0.0, -G, 0.0]}})
    lines = np.array(across(np.array([*AXIS, 0.0])))
    force = got.block("rail.multiplier")[:, :2] @ lines
    normal = np.array(across(np.array(AXIS)))
    np.testing.assert_allclose(flat.block("rail.multiplier")[:, :1] @ normal, force[:, :2],
                               rtol=1e-8)
    assert np.abs(force[:, 2]).max() < 1e-8
    np.testing.assert_allclose(flat.block("rail.multiplier")[:, 1],
                               got.block("rail.multiplier")[:, 4], rtol=1e-8)


def arm(h: float) -> March:
    """A block slides on a rod that turns about a pin: no friction, no weight lost."""
    rod = {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"pin": [0, 0], "seat": [0.3, 0]},
           "pose": {"spin": 6.0}}
    ring = {"use": "rigid", "mass": 0.5, "inertia": 0.01, "points": {"middle": [0, 0]},
            "pose": {"position": [0.3, 0.0], "velocity": [0.0, 1.8], "spin": 6.0}}
    return run({"rod": rod, "ring": ring},
               {"pin": {"use": "revolute", "between": ["ground", "rod:pin"]},
                "rail": {"use": "prismatic", "between": ["ring:middle", "rod:seat"],
                         "axis": [1, 0]}}, 0.4, h, WEIGHT,
               {"use": "generalized_alpha", "rho_inf": 1.0})


def energy(got: March) -> FloatArray:
    total = np.zeros(len(got.t))
    for name, mass, inertia in (("rod", 1.0, 0.1), ("ring", 0.5, 0.01)):
        x, v = got.block(f"{name}.rigid"), got.v[:, got.model.layout[f"{name}.rigid"]]
        total += mass * G * x[:, 1] + 0.5 * (mass * (v[:, :2] ** 2).sum(axis=1)
                                             + inertia * v[:, 2] ** 2)
    return total


@pytest.mark.full
def test_on_a_turning_guide_energy_is_kept_to_the_order_of_the_integrator() -> None:
    drifts = []
    for h in (4e-3, 2e-3):
        got = arm(h)
        E = energy(got)
        drifts.append(float(np.abs(E - E[0]).max()))
        rod, ring = got.block("rod.rigid"), got.block("ring.rigid")
        out = ring[:, :2] - rod[:, :2]
        across_rod = np.cos(rod[:, 2]) * out[:, 1] - np.sin(rod[:, 2]) * out[:, 0]
        assert np.abs(across_rod).max() < 1e-10 and np.ptp(np.linalg.norm(out, axis=1)) > 0.1
        np.testing.assert_allclose(ring[:, 2], rod[:, 2], rtol=0, atol=1e-12)
    assert 3.5 < drifts[0] / drifts[1] < 4.5
    assert drifts[1] < 1e-3 * 9.0  # J, of 9 J of kinetic energy at the start


def center(got: March, name: str) -> FloatArray:
    """(M, 2) centre of mass of a flexible body, m."""
    body: Any = got.model.parts[name]
    u = np.zeros((len(got.t), body.X.size))
    u[:, body.elasticity.free] = got.block(f"{name}.elastic")
    m = np.asarray(body.mass_matrix.sum(axis=1)).ravel()
    z = np.einsum("n,tnd->td", m / m.sum(), body.X + u.reshape(-1, *body.X.shape))
    y = got.block(f"{name}.rigid")
    c, s = np.cos(y[:, 2]), np.sin(y[:, 2])
    return y[:, :2] + np.stack([c * z[:, 0] - s * z[:, 1], s * z[:, 0] + c * z[:, 1]], axis=1)


def soft_slope(h: float = 1e-3, end: float = 0.1, integrator: Any = "bdf1", **more: Any) -> Any:
    return {"bodies": {"block": SOFT}, "joints": {"rail": {
        "use": "prismatic", "between": ["ground", "block:bottom"], "axis": AXIS}},
        "loads": WEIGHT, "time": {"end": end, "step": h}, "integrator": integrator, **more}


@pytest.mark.full
def test_a_flexible_block_slides_as_a_rigid_one_and_settles_on_its_guide() -> None:
    """Nothing acts along the guide but weight; the vibration across it dies out."""
    got = march(scene_of(soft_slope(integrator={"use": "generalized_alpha", "rho_inf": 0.8})))
    way = (center(got, "block") - center(got, "block")[0]) @ AXIS
    np.testing.assert_allclose(way, 0.5 * G * np.sin(SLOPE) * got.t**2, rtol=0, atol=1e-9)
    assert np.abs(got.block("block.elastic")).max() > 1e-7
    force = got.block("rail.multiplier")[-1]
    # about the bottom's mean point: the centre of mass is 0.05 m above it, on no lever along x
    np.testing.assert_allclose(force, [-MASS * G * np.cos(SLOPE), 0.0], rtol=0,
                               atol=1e-3 * MASS * G)


def rail(E: float, **more: Any) -> dict[str, Any]:
    """A block hangs on a rail, a beam that is clamped to the ground; both may be flexible."""
    beam = {**SOFT, "material": {"E": E, "nu": 0.3, "rho": 1000}, "reference": {"clamp": "left"},
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                     "divisions": [5, 2]}, "frame": "fixed", "pose": {}}
    block = {**SOFT, "material": {"E": E, "nu": 0.3, "rho": 1000},
             "pose": {"position": [0.5, 0.0]}, "mesh": {**SHAPE, "lower": [0.0, -0.05]},
             "reference": {"clamp": "right"}}
    return {"bodies": {"beam": beam, "block": block}, "joints": {"rail": {
        "use": "prismatic", "between": ["beam:right", "block:left"], "axis": [0, 1]}},
        "loads": {"pull": {"use": "gravity", "g": [20.0, -3.0]}}, **more}


@pytest.mark.full
@pytest.mark.parametrize("g,want", [([20.0, 0.0], [20.0, 0.0]), ([0.0, -3.0], [0.0, 0.3])])
def test_between_two_flexible_bodies_weight_goes_into_the_guide(
    g: list[float], want: list[float]
) -> None:
    """At rest after long steps of BDF1: what the block pulls on the guide, and the moment about its
    left end, where its weight is held along the axis."""
    hold = {"use": "point_force", "on": "block:left", "force": [0.0, -g[1] * MASS]}
    tree = rail(1e9, time={"end": 1.0, "step": 0.05}, integrator="bdf1")
    loads = {"pull": {"use": "gravity", "g": g}, "hold": hold}
    got = march(scene_of({**tree, "loads": loads}))
    assert np.abs(got.a[-1]).max() < 1e-3
    force = got.block("rail.multiplier")[-1]  # minus the force on the beam, along J y = -x; moment
    np.testing.assert_allclose(force[:2], MASS * np.array(want), rtol=1e-3, atol=1e-6)
    names = got.model.parts["rail"].components  # type: ignore[attr-defined]
    assert names[:2] == (("force across the axis", "N"), ("moment", "N m"))


@pytest.mark.full
@pytest.mark.parametrize("which", quick(["ground", "flexible"], "ground"))
def test_a_run_that_follows_its_own_motion_is_the_same_run(which: str) -> None:
    """What a rigid stage passes on: force and moment on each side."""
    time: Any = {"time": {"end": 0.01, "step": 1e-3}}
    tree = soft_slope(end=0.01) if which == "ground" else {
        **rail(1e7, **time), "integrator": "bdf1"}
    scene = scene_of(tree)
    free = march(scene)
    given = march(scene, model=assemble(scene, Followed(stage_of(free))))
    assert {b.field for b in given.model.layout} == {"elastic"}
    for b in given.model.layout:
        x, y = free.block(b.name), given.block(b.name)
        assert np.abs(x - x[0]).max() > 0
        assert np.abs(x - y).max() < 1e-9 * np.abs(x - x[0]).max(), b.name


@pytest.mark.full
@pytest.mark.parametrize("sides", ["rigid", "first", "both"])
def test_laws_of_the_joint(sides: str) -> None:
    soft = {**SOFT, "sets": {"foot": {"where": "y < 1e-6"}}, "pose": {"angle": 0.3}}
    hard = {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"foot": [0.1, 0.2]},
            "pose": {"angle": 0.3}}
    bodies = {name: soft if sides in (which, "both") else hard
              for name, which in (("one", "first"), ("two", "second"))}
    reach = {name: np.zeros(2) if b is soft else turned([0.1, 0.2], 0.3)
             for name, b in bodies.items()}
    axis = turned([1.0, 0.5], 0.2)
    place = reach["one"] + 0.2 * axis - reach["two"]  # further along the axis
    bodies["two"] = {**bodies["two"], "pose": {"angle": 0.3, "position": place.tolist()}}
    check_joint(Prismatic(between=("one:foot", "two:foot"), axis=tuple(axis.tolist())), bodies)


def turned(z: list[float], angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]) @ z


@pytest.mark.parametrize("change,message", [
    ({"axis": [1, 0, 0]}, "the bodies are plane: give two components"),
    ({"axis": [0, 0]}, "an axis has a direction"),
    ({"between": ["ground", "ground"]}, "both sides are the ground"),
])
def test_bad_input_is_refused_where_it_is(change: dict[str, Any], message: str) -> None:
    joint = {"use": "prismatic", "between": ["ground", "block:foot"], "axis": AXIS, **change}
    tree = {"bodies": {"block": BLOCK}, "joints": {"rail": joint},
            "time": {"end": 1.0, "step": 0.1}}
    with pytest.raises(InputError, match=message) as caught:
        checked_model(scene_of(tree))
    assert all(f.key.startswith("joints.rail.") for f in caught.value.faults)
