"""Bodies from matrices with rotations and with generalized coordinates: beams, superelements."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh

from exported_matrices import built, superelement
from frame_beam import beam, saved
from reduced_runs import learnt
from sparsemor.bodies.frames import rotation as rot
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.testing.in_memory_run import March, march, scene_of

SOLID: dict[str, Any] = {
    "use": "flexible", "fields": ["elastic"], "material": {"E": 2e8, "nu": 0.3, "rho": 1100},
    "mesh": {"use": "block", "lower": [0.0, 0.0, 0.0], "size": [0.5, 0.1, 0.06],
             "divisions": [4, 1, 1]},
    "reference": {"clamp": "left"}, "damping": {"ratio": 0.02, "modes": 4},
    "pose": {"position": [0.3, -0.2, 0.1], "axis": [1, 2, 3], "angle": 0.4,
             "spin": [1.0, -2.0, 4.0]}}
REST: dict[str, Any] = {
    "joints": {"hinge": {"use": "revolute", "between": ["ground", "bar:left"], "axis": [0, 1, 0]}},
    "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -9.81]},
              "push": {"use": "point_force", "on": "bar:right", "force": [0.0, 0.0, 3.0]}},
    "time": {"end": 0.02, "step": 1e-3}, "probes": {"tip": {"body": "bar", "at": "right"}}}


def tip(run: March) -> FloatArray:
    """(T, d) position of the probe in space."""
    probe, maps = run.model.probes[0], run.solver.dictionaries
    u = run.block("bar.elastic")
    if "bar.elastic" in maps:
        u = maps["bar.elastic"].offset + u @ maps["bar.elastic"].atoms.T
    assert probe.displacement is not None
    y, z = run.block("bar.rigid"), probe.point + u @ probe.displacement
    if len(probe.point) == 2:
        turned = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in y[:, 2]]
    else:
        turned = [rot.rotation(p) for p in y[:, 3:]]
    return np.stack([r + A @ at for r, A, at in zip(y[:, : len(probe.point)], turned, z,
                                                  strict=True)])


def part(folder: Path, modes: int, whole: bool) -> dict[str, Any]:
    """Superelement of the solid with its two ends as interface."""
    body = built(scene_of({"bodies": {"bar": SOLID}, "time": REST["time"]}), "bar")
    ends = np.unique(np.concatenate([body.points["left"], body.points["right"]]))
    nodes = np.arange(len(body.X)) if whole else ends
    sets = {}
    for which in ("left", "right"):
        at, centre = body.points[which], body.centre_of(which, body.points[which])
        sets[which] = {"nodes": (np.searchsorted(nodes, at) + 1).tolist(),
                       "weights": centre.weights[at].tolist()}
    kept = {k: SOLID[k] for k in ("reference", "damping", "pose")}
    return {**superelement(body, ends, modes, folder, whole), "sets": sets, **kept}


def path_of(bar: dict[str, Any], **changes: Any) -> March:
    return march(scene_of({**REST, "bodies": {"bar": bar}, **changes}))


@pytest.mark.full
def test_shapes_that_span_all_displacements_are_the_mesh(tmp_path: Path) -> None:
    one, two = path_of(SOLID), path_of(part(tmp_path, 36, True))  # of 36 unknowns inside
    assert two.block("bar.elastic").shape == one.block("bar.elastic").shape
    np.testing.assert_allclose(tip(two), tip(one), rtol=0.0, atol=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("whole", [True, False])
def test_reduced_superelements(whole: bool, tmp_path: Path) -> None:
    bar = part(tmp_path, 6, whole)
    full = path_of(bar)
    for use in ("galerkin", "sparse") if whole else ("deim", "ecsw"):
        basis = {"use": "modal", "count": 6} if use == "galerkin" else {"use": "pod", "count": 4}
        got = march(scene_of({**REST, "bodies": {"bar": bar}, "reducer": {
            "use": use, "basis": basis}}), model=full.model, snapshots=learnt(full))
        np.testing.assert_allclose(tip(got), tip(full), rtol=0.0, atol=3e-4, err_msg=use)


def test_without_shapes_rigid_inertia_is_exact_and_the_rest_is_noted(tmp_path: Path) -> None:
    body = built(scene_of({"bodies": {"bar": SOLID}, "time": REST["time"]}), "bar")
    found = built(scene_of({"bodies": {"bar": part(tmp_path, 6, False)}, "time": REST["time"]}),
                  "bar")
    assert body.inertia is not None and found.inertia is not None
    np.testing.assert_allclose(found.inertia.mass, body.inertia.mass, rtol=1e-12)
    np.testing.assert_allclose(found.inertia.moment, body.inertia.moment, rtol=1e-12)
    np.testing.assert_allclose(found.inertia.second, body.inertia.second, rtol=0.0,
                               atol=1e-12 * body.inertia.second.max())
    assert [n.kind for n in found.notes] == ["few_nodes"]


def test_shapes_with_rigid_motion_need_a_reference(tmp_path: Path) -> None:
    bar = {k: v for k, v in part(tmp_path, 2, True).items() if k != "reference"}
    with pytest.raises(InputError, match="reference"):
        built(scene_of({"bodies": {"bar": bar}, "time": REST["time"]}), "bar")


# ---------------------------------------------------------------------- nodes with rotations

def mast(folder: Path, d: int, turn: FloatArray | None = None) -> dict[str, Any]:
    """Beam of four elements, its axis turned within the body frame."""
    X, M, K = beam(4, 0.5, d=d)
    if turn is not None:
        T = block_diag(*(2 * len(X) * [turn]))
        X, M, K = X @ turn.T, T @ M @ T.T, T @ K @ T.T
    folder.mkdir(exist_ok=True)
    return {"use": "matrices", **saved(folder, X, mass=M, stiffness=K), "damping": {
        "stiffness": 1e-4}, "sets": {"left": {"nodes": [1]}, "right": {"nodes": [5]}},
        "reference": {"clamp": "left"}}


def swing(bar: dict[str, Any], d: int, h: float) -> FloatArray:
    """Path of a turning beam on a hinge under its weight and a torque at its end."""
    space = {"axis": [0, 0, 1]} if d == 3 else {}
    return tip(march(scene_of({
        **REST, "time": {"end": 0.02, "step": h}, "bodies": {"bar": bar},
        "joints": {"hinge": {"use": "revolute", "between": ["ground", "bar:left"], **space}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81, 0.0][:d]},
                  "turn": {"use": "torque", "on": "bar:right",
                           "torque": 2.0 if d == 2 else [0.0, 0.0, 2.0]}}})))


@pytest.mark.full
def test_a_beam_with_rotations_swings_in_space_as_in_the_plane(tmp_path: Path) -> None:
    """But for the time error, as one steps an angle and the other a quaternion; and as with its
    axis turned within the body frame."""
    turn = rot.rotation(rot.about((0.3, -0.5, 0.8), 1.1))
    pose = {"axis": [0.3, -0.5, 0.8], "angle": -1.1, "spin": [0.0, 0.0, -8.0]}
    far = []
    for h in (1e-3, 5e-4):
        flat = swing({**mast(tmp_path / "a", 2), "pose": {"spin": -8.0}}, 2, h)
        solid = swing({**mast(tmp_path / "b", 3), "pose": {"spin": [0.0, 0.0, -8.0]}}, 3, h)
        far.append(np.abs(solid[:, :2] - flat).max())
        turned = swing({**mast(tmp_path / "c", 3, turn), "pose": pose}, 3, h)
        np.testing.assert_allclose(turned, solid, rtol=0.0, atol=1e-11)
    assert far[0] < 3e-7 and far[1] < 0.28 * far[0]


def test_frequency_of_a_cantilever_with_rotations(tmp_path: Path) -> None:
    body = built(scene_of({"bodies": {"bar": mast(tmp_path, 2)}, "time": REST["time"]}), "bar")
    e = body.elasticity
    assert e is not None
    M = np.load(tmp_path / "mass.npy")[np.ix_(e.free, e.free)]
    first = np.sqrt(eigh(e.stiffness[e.free][:, e.free].toarray(), M, eigvals_only=True)[0])
    np.testing.assert_allclose(first, 1.8751041**2 * np.sqrt(40.0 / 2.0) / 0.5**2, rtol=1e-4)


@pytest.mark.full
def test_load_vectors_are_forces_and_moments_that_turn_with_the_body(tmp_path: Path) -> None:
    bar = {**mast(tmp_path, 3), "pose": {"axis": [1, 2, 3], "angle": 0.4}}
    joints = {"hinge": {"use": "spherical", "between": ["ground", "bar:left"]}}
    file = tmp_path / "loads.csv"
    file.write_text("5, 2, 3.0\n5, 3, -1.0\n5, 4, 0.2\n5, 6, 0.5\n")
    one = path_of(bar, joints=joints, loads={
        "force": {"use": "point_force", "on": "bar:right", "force": [0.0, 3.0, -1.0],
                  "axes": "body"},
        "moment": {"use": "torque", "on": "bar:right", "torque": [0.2, 0.0, 0.5],
                   "axes": "body"}})
    two = path_of({**bar, "load_vectors": {"all": str(file)}}, joints=joints,
                  loads={"all": {"use": "load_vector", "on": "bar:all"}})
    assert np.ptp(tip(one), axis=0).max() > 1e-3
    np.testing.assert_allclose(tip(two), tip(one), rtol=0.0, atol=1e-10)


def test_heat_of_a_load_vector_is_kept(tmp_path: Path) -> None:
    """C_T T grows by the heat: 7 W over 0.02 s, from W and mm."""
    C, K = np.diag([2.0, 3.0, 4.0]), np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    options = saved(tmp_path, np.zeros((3, 2)) + np.arange(3)[:, None], capacity=C, conductivity=K)
    (tmp_path / "q.csv").write_text("2 11 4.0e6\n3 11 3.0e6\n")
    got = march(scene_of({
        "bodies": {"rod": {"use": "matrices", **options, "frame": "fixed", "load_vectors": {
            "q": str(tmp_path / "q.csv")}, "units": {"length": 1e-3}}},
        "loads": {"q": {"use": "load_vector", "on": "rod:q"}}, "time": REST["time"]}))
    T = got.block("rod.thermal")
    np.testing.assert_allclose(1e-6 * np.diag(C) @ (T[-1] - T[0]), 7.0 * 0.02, rtol=1e-9)


def lumped(folder: Path, rotary: float) -> dict[str, Any]:
    """Beam with masses at the nodes, and a rotary inertia of them, kg m2."""
    X, M, K = beam(4, 0.5, d=3)
    one = np.array([1.0, 1.0, 1.0, 4e-4, rotary, rotary])
    share = np.array([0.5, 1.0, 1.0, 1.0, 0.5]) * 2.0 * 0.125
    folder.mkdir(exist_ok=True)
    return {"use": "matrices", **saved(folder, X, mass=np.diag(np.kron(share, one)), stiffness=K),
            "sets": {"left": {"nodes": [1]}, "right": {"nodes": [5]}},
            "reference": {"clamp": "left"}}


@pytest.mark.full
def test_rotations_without_mass_are_condensed(tmp_path: Path) -> None:
    """As the limit of small rotary inertia, of which frequencies are as if it were none."""
    paths = [tip(path_of(lumped(tmp_path / str(i), size), loads={
        "push": {"use": "point_force", "on": "bar:right", "force": [0.0, 0.0, 3.0]},
        "turn": {"use": "torque", "on": "bar:right", "torque": [0.0, -0.5, 0.0]}},
        joints={"foot": {"use": "fixed", "between": ["ground", "bar:left"]}}))
        for i, size in enumerate((0.0, 1e-9))]
    assert np.ptp(paths[0], axis=0).max() > 1e-4
    np.testing.assert_allclose(paths[1], paths[0], rtol=0.0, atol=1e-7)
