"""Contact in space at given positions: closed forms, Newton's third law, the plane."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.along_prescribed_motion import AT_ONCE
from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core import MeshPlugin
from sparsemor.core.model.assembly import assemble
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.testing.in_memory_run import scene_of

K = 1e9
SIDE, WIDTH = 0.1, 0.06
COULOMB = {"use": "coulomb", "coefficient": 0.4, "critical_velocity": 0.05}


class Ball(MeshPlugin):
    """An octahedron's faces split `times` times, blown up to a sphere of `radius` (m); set skin."""

    radius: float
    times: int

    def build(self, base: Path) -> Mesh:
        points = np.vstack([np.eye(3), -np.eye(3)])
        faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2],
                          [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
        for _ in range(self.times):
            corners = points[faces]
            middle = corners + np.roll(corners, -1, axis=1)
            new = np.concatenate([corners.reshape(-1, 3), middle.reshape(-1, 3)])
            new /= np.linalg.norm(new, axis=1, keepdims=True)
            points, at = np.unique(np.round(new, 12), axis=0, return_inverse=True)
            a, m = at.reshape(2, -1, 3)
            faces = np.concatenate([
                np.stack([a[:, 0], m[:, 0], m[:, 2]], 1), np.stack([m[:, 0], a[:, 1], m[:, 1]], 1),
                np.stack([m[:, 2], m[:, 1], a[:, 2]], 1), m])
        n = len(points)
        cells = np.concatenate([np.full((len(faces), 1), n), faces], axis=1)
        return Mesh(np.vstack([self.radius * points, [[0.0, 0.0, 0.0]]]), cells,
                    {"skin": np.arange(n)})


def block(divisions: tuple[int, int, int]) -> BlockMesh:
    return BlockMesh(lower=(0.0, 0.0, 0.0), size=(SIDE, WIDTH, SIDE), divisions=divisions)


PLATE = BlockMesh(lower=(-0.2, -0.2, -0.1), size=(0.4, 0.4, 0.1), divisions=(7, 5, 1))


def contact_of(
    mesh: Any, surface: str, swap: bool = False, plate: Any = PLATE, fields: tuple[str, ...] = (),
    **options: Any,
) -> ContactPart:
    """`mesh` above a plate whose top is z = 0."""
    material = {"rho": 1000, "k": 50, "c": 500}
    thing = {"use": "flexible", "mesh": mesh, "fields": list(fields), "material": material,
             "sets": {"skirt": {"where": f"z < 1e-9 or x > {SIDE} - 1e-9"}} if surface == "skirt"
             else {},
             "pose": {"position": [0.0, 0.0, 1.0]}}
    base = {"use": "flexible", "mesh": plate, "fields": list(fields), "material": material}
    between = [f"thing:{surface}", "plate:top"]
    normal = {"use": "elastic_foundation", "stiffness": K}
    model = assemble(scene_of({
        "bodies": {"thing": thing, "plate": base}, "time": {"end": 1.0, "step": 0.1},
        "contacts": {"touch": {"use": "polygonal", "normal": normal,
                               "between": between[::-1] if swap else between, **options}}}))
    part = model.parts["touch"]
    assert isinstance(part, ContactPart)
    return part


def history_of(
    places: Any, turns: Any, velocity: Any = None, spin: Any = None
) -> FrameHistory:
    """At places (T, 3) with quaternions (T, 4), velocities and angular velocities (space axes)."""
    R, p = np.atleast_2d(places), np.atleast_2d(turns)
    pose = np.concatenate([R + 0 * p[:, :3], p + 0 * R[:, :1]], axis=1)
    rate = np.zeros_like(pose)
    if velocity is not None:
        rate[:, :3] = velocity
    if spin is not None:
        rate[:, 3:] = [rot.rates(q, w) for q, w in zip(
            pose[:, 3:], np.broadcast_to(spin, (len(pose), 3)), strict=True)]
    return FrameHistory(np.arange(float(len(pose))), pose, rate, 0 * pose)


UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def test_a_flat_block_presses_with_stiffness_times_depth_times_area() -> None:
    part = contact_of(block((3, 2, 1)), "bottom")
    found = part.history({"thing": history_of([[0, 0, -1e-6], [0.031, 0.01, -2e-6]], UPRIGHT)})
    area = SIDE * WIDTH
    assert found["normal"] == pytest.approx([K * 1e-6 * area, K * 2e-6 * area])
    assert found["pressure"] == pytest.approx([K * 1e-6, K * 2e-6])
    assert found["area"] == pytest.approx([area, area])
    assert not found["friction"].any() and not found["power"].any()


def test_a_block_over_the_end_of_a_surface_presses_with_what_is_over_it() -> None:
    part = contact_of(block((3, 2, 1)), "bottom")
    turned = rot.about([0, 0, 1], np.pi / 4)
    found = part.history({"thing": history_of([[0.163, 0, -1e-6], [0.2, 0, -1e-6]],
                                              [UPRIGHT, turned])})
    corner = WIDTH**2 / 2  # left of its y axis the turned block is half a square of its width
    assert found["area"] == pytest.approx([0.037 * WIDTH, corner], rel=1e-9)
    assert found["normal"] == pytest.approx(K * 1e-6 * found["area"])


@pytest.mark.parametrize("swap", [False, True])
def test_a_wedge_presses_with_the_square_of_its_depth(swap: bool) -> None:
    """The edge of a block turned by 45 degrees, as in the plane: F = K d^2 times the length."""
    part = contact_of(block((5, 3, 5)), "skirt", swap)
    d = np.array([1e-4, 3e-3, 7e-3])
    q = rot.about([0, 1, 0], np.pi / 4)
    edge = rot.rotation(q) @ [SIDE, 0.0, 0.0]
    motion = {"thing": history_of(-edge - d[:, None] * [0, 0, 1], q)}
    force = part.imported(motion)["plate"].force.sum(axis=1)
    want = K * d**2 * WIDTH
    if swap:  # on the flanks' own foundation depth, area and direction lose sqrt(2) each
        want = want / 2**1.5
        # the skirt holds a triangle of each end face, whose cells take a pyramid at either end
        want = want - K * d**3 / 3
    else:
        found = part.history(motion)
        assert found["normal"] == pytest.approx(want, rel=1e-12)
        assert found["area"] == pytest.approx(2 * d * WIDTH, rel=1e-12)
        assert found["pressure"] == pytest.approx(K * d, rel=1e-12)
    assert -force[:, 2] == pytest.approx(want, rel=1e-9)
    assert np.abs(force[:, :2]).max() < 1e-9 * want.max()


@pytest.mark.full
def test_polyhedra_approach_the_sphere_with_the_square_of_their_facets() -> None:
    """Foundation under a rigid sphere: K times the volume of the cap."""
    radius, depth = 0.05, 2e-3
    want = K * np.pi * depth**2 * (radius - depth / 3)
    rng, error = np.random.default_rng(0), []
    turns = rng.standard_normal((6, 4))  # so that it does not matter what is lowest
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    for times in (3, 4, 5):
        part = contact_of(Ball(radius=radius, times=times), "skin")
        found = part.history({"thing": history_of([[0.01, 0.02, radius - depth]], turns)})
        error.append(abs(found["normal"].mean() / want - 1))
    order = np.log2(error[:-1]) - np.log2(error[1:])
    assert error[-1] < 0.03  # sagitta of a facet over the depth
    assert np.all(order > 1.8), order


@pytest.mark.full
def test_facets_do_not_matter_where_surfaces_are_flat() -> None:
    pose = history_of([[0.013, 0.02, -1e-6]], rot.about([1, 2, 0], 2e-5),
                      [0.3, 0.1, -1e-3], [0.1, -0.2, 0.3])
    coarse = contact_of(block((1, 1, 1)), "bottom", friction=COULOMB)
    fine = contact_of(block((5, 4, 1)), "bottom", friction=COULOMB,
                      plate=PLATE.model_copy(update={"divisions": (9, 4, 1)}))
    one, two = (p.history({"thing": pose}) for p in (coarse, fine))
    for name, values in one.items():
        assert values == pytest.approx(two[name], rel=1e-6), name


@pytest.mark.full
@pytest.mark.parametrize("surface, swap", [("bottom", False), ("skin", True)])
def test_action_is_minus_reaction_in_force_and_torque(surface: str, swap: bool) -> None:
    """However deep, and the heat of both bodies is the friction power."""
    mesh: Any = block((3, 2, 1)) if surface == "bottom" else Ball(radius=0.05, times=1)
    part = contact_of(mesh, surface, swap, fields=("thermal",), heat={"share": 0.3},
                      friction=COULOMB)
    rng = np.random.default_rng(1)
    low, T = 0.0 if surface == "bottom" else 0.05, 30

    def moves(lift: float, tilt: float) -> FrameHistory:
        q = UPRIGHT + tilt * rng.standard_normal((T, 4))
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        place = rng.standard_normal((T, 3)) * [0.02, 0.02, 2e-3] + [0.0, 0.0, lift]
        return history_of(place, q, 0.1 * rng.standard_normal((T, 3)),
                          rng.standard_normal((T, 3)))

    motion = {"thing": moves(low, 0.02), "plate": moves(5e-4, 0.01)}
    loads = part.imported(motion)
    total, torque, size = np.zeros((T, 3)), np.zeros((T, 3)), np.zeros(T)
    for side in (part.first, part.second):
        body = side.body
        h, load = motion[body.name], loads[body.name]
        A = np.stack([rot.rotation(q) for q in h.pose[:, 3:]])
        f = load.force @ A.transpose(0, 2, 1)
        z = h.pose[:, None, :3] + body.X[load.nodes] @ A.transpose(0, 2, 1)
        total, torque = total + f.sum(axis=1), torque + np.cross(z, f).sum(axis=1)
        size += np.linalg.norm(f, axis=2).sum(axis=1)
    assert np.count_nonzero(size) > 10
    assert np.all(np.abs(total) <= 1e-14 * size[:, None])
    assert np.all(np.abs(torque) <= 1e-14 * 0.3 * size[:, None])
    power = part.history(motion)["power"]
    share = 0.7 if swap else 0.3
    assert loads["thing"].heat.sum(axis=1) == pytest.approx(share * power, rel=1e-12)
    assert loads["plate"].heat.sum(axis=1) == pytest.approx((1 - share) * power, rel=1e-12)


def test_the_same_contact_seen_after_a_turn_gives_the_same_loads_in_body_axes() -> None:
    part = contact_of(block((3, 2, 1)), "bottom", friction=COULOMB)
    place, q = np.array([0.013, 0.02, -1e-4]), rot.about([1, 2, 0.5], 3e-3)
    velocity, spin = np.array([0.3, 0.1, -1e-3]), np.array([0.1, -0.2, 0.3])
    plain = part.imported({"thing": history_of(place, q, velocity, spin),
                           "plate": history_of([0.0, 0, 0], UPRIGHT)})
    quarter = rot.about([1, 0, 0], np.pi / 2)
    for turn in (quarter, rot.product(quarter, rot.about([0, 0, 1], np.pi / 2)),
                 rot.about([3, 1, -2], 2.0)):
        A, far = rot.rotation(turn), np.array([0.3, -0.2, 0.5])
        seen = part.imported({
            "thing": history_of(A @ place + far, rot.product(turn, q), A @ velocity, A @ spin),
            "plate": history_of(far, turn)})
        for name in ("thing", "plate"):
            assert np.array_equal(seen[name].nodes, plain[name].nodes)
            size = np.abs(plain[name].force).max()
            assert np.abs(seen[name].force - plain[name].force).max() < 1e-9 * size


def test_a_plane_problem_in_space_has_the_resultants_of_the_plane() -> None:
    """A tilted block that slides over a plate, of unit depth."""
    normal = {"use": "elastic_foundation", "stiffness": K, "damping": 1e6, "damping_depth": 1e-4}
    flat = {"use": "flexible", "fields": [], "thickness": 1.0, "material": {"rho": 1000}}
    mesh = {"use": "rectangle", "lower": [0.0, 0.0], "size": [SIDE, SIDE], "divisions": [3, 1]}
    base = {"use": "rectangle", "lower": [-0.2, -0.1], "size": [0.4, 0.1], "divisions": [7, 1]}
    plane = assemble(scene_of({
        "bodies": {"thing": flat | {"mesh": mesh}, "plate": flat | {"mesh": base}},
        "time": {"end": 1.0, "step": 0.1}, "contacts": {"touch": {
            "use": "polygonal", "between": ["thing:bottom", "plate:top"], "normal": normal,
            "friction": COULOMB}}})).parts["touch"]
    assert isinstance(plane, ContactPart)
    solid = contact_of(BlockMesh(size=(SIDE, 1.0, SIDE), divisions=(3, 2, 1)), "bottom",
                       plate=BlockMesh(lower=(-0.2, -0.5, -0.1), size=(0.4, 2.0, 0.1),
                                   divisions=(7, 3, 1)), normal=normal, friction=COULOMB)
    x, z, tilt = 0.13, -2e-4, np.array([2e-3, -4e-3, 0.0])
    v, w = np.array([0.3, -0.01]), 0.5
    T = len(tilt)
    poses = np.stack([np.full(T, x), np.full(T, z), tilt], axis=1)
    rates = np.tile([*v, w], (T, 1))
    two = {"thing": FrameHistory(np.arange(float(T)), poses, rates, 0 * poses)}
    three = {"thing": history_of(np.tile([x, 0.0, z], (T, 1)),  # turned from z to x: about -y
                                 [rot.about([0, -1, 0], a) for a in tilt],
                                 [v[0], 0.0, v[1]], [0.0, -w, 0.0])}
    a, b = plane.history(two), solid.history(three)
    assert a["normal"].min() > 1e3
    for name in ("normal", "friction", "power", "pressure"):
        assert b[name] == pytest.approx(a[name], rel=1e-9), name
    assert b["area"] == pytest.approx(a["length"], rel=1e-12)


@pytest.mark.full
def test_many_times_are_evaluated_a_few_at_once() -> None:
    """Against the same positions one by one."""
    part = contact_of(block((6, 6, 1)), "bottom", friction=COULOMB)
    rng, T = np.random.default_rng(0), 200
    q = UPRIGHT + 1e-5 * rng.standard_normal((T, 4))
    pose = history_of(rng.standard_normal((T, 3)) * [0.03, 0.03, 1e-5],
                      q / np.linalg.norm(q, axis=1, keepdims=True), [0.1, 0.2, 0.0])
    whole = part.history({"thing": pose})
    assert T * len(part.first.facets) > AT_ONCE // 10
    loads = part.imported({"thing": pose})["plate"]
    for i in (0, 99, 199):
        alone = {"thing": history_of(pose.pose[i, :3], pose.pose[i, 3:], [0.1, 0.2, 0.0])}
        assert all(part.history(alone)[name][0] == pytest.approx(whole[name][i], rel=1e-13)
                   for name in whole)
        one = part.imported(alone)["plate"]
        at = np.searchsorted(loads.nodes, one.nodes)
        force = one.force[0] if whole["normal"][i] else 0.0
        got = loads.force[i, at] if whole["normal"][i] else loads.force[i]
        assert np.abs(got - force).max() <= 1e-12 * max(1.0, np.abs(force).max())
