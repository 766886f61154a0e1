"""Flexible bodies in space joined to each other, reduced, and probed."""

from typing import Any

import numpy as np
import pytest

from sparsemor import simulate
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

pytestmark = pytest.mark.full

ALPHA = {"use": "generalized_alpha", "rho_inf": 0.8}
GRAVITY = {"g": {"use": "gravity", "g": [0.0, -3.0, -9.81]}}


def bar(
    length: float, columns: int, place: list[float] | None = None, held: str = "left"
) -> dict[str, Any]:
    return {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": held},
            "mesh": BlockMesh(size=(length, 0.1, 0.08), divisions=(columns, 2, 2)),
            "material": {"E": 5e8, "nu": 0.0, "rho": 1000}, "damping": {"stiffness": 1e-4},
            "pose": {"position": place or [0.0, 0.0, 0.0]}}


def tip(got: March, name: str) -> FloatArray:
    """(M, 3) path of the mean of the right end from its start."""
    body: Any = got.model.parts[name]
    u = np.zeros((len(got.t), body.X.size))
    u[:, body.elasticity.free] = got.block(f"{name}.elastic")
    z = (body.X + u.reshape(-1, *body.X.shape))[:, body.points["right"]].mean(axis=1)
    y = got.block(f"{name}.rigid")
    place = y[:, :3] + np.array([rot.rotation(p[3:]) @ c for p, c in zip(y, z, strict=True)])
    return np.asarray(place - place[0])


def test_two_welded_beams_bend_as_one() -> None:
    """The weld joins mean position and mean rotation of two cross-sections, as beam theory does.
    Where a cross-section is held by its own frame, it is rigid; else a frame between them is."""
    common: dict[str, Any] = {"loads": GRAVITY, "time": {"end": 0.2, "step": 2e-3},
                              "integrator": ALPHA}
    ground = {"use": "fixed", "between": ["ground", "one:left"]}
    whole = march(scene_of({"bodies": {"one": bar(0.8, 8)}, "joints": {"A": ground}, **common}))
    plain, parts = (march(scene_of({
        "bodies": {"one": bar(0.4, 4), "two": bar(0.4, 4, [0.4, 0.0, 0.0], held)},
        "joints": {"A": ground, "B": {"use": "fixed", "between": ["one:right", "two:left"]}},
        **common})) for held in ("left", "right"))
    assert plain.block("B.multiplier").shape[1] == 6
    bent = tip(whole, "one")
    assert np.abs(bent[:, 1]).max() > 2e-4 and np.abs(bent[:, 2]).max() > 5e-4
    for got in (plain, parts):
        np.testing.assert_allclose(tip(got, "two"), bent, rtol=0, atol=0.02 * np.abs(bent).max())
    # the weld's first six numbers are what the second half asks of the first, as if cut there
    pull = parts.block("B.multiplier")[-1]
    assert len(pull) == 12
    hung = parts.block("A.multiplier")[-1]
    assert 0.3 < -pull[2] / hung[2] < 0.7


def hinged(reducer: Any = "full", end: float = 0.1) -> dict[str, Any]:
    """Two flexible bars on hinges whose axes are not parallel, and a rigid end."""
    piece = {"use": "rigid", "mass": 0.5, "inertia": [1e-3, 2e-3, 2.5e-3],
             "points": {"a": [0.0, 0.0, 0.0]}, "pose": {"position": [0.8, 0.05, 0.04]}}
    return {
        "bodies": {"one": bar(0.4, 4), "two": bar(0.4, 4, [0.4, 0.0, 0.0], "right"),
                   "end": piece},
        "joints": {
            "A": {"use": "revolute", "between": ["one:left", "ground"], "axis": [0, 1, 0]},
            "B": {"use": "revolute", "between": ["one:right", "two:left"], "axis": [0, 1, 1]},
            "C": {"use": "spherical", "between": ["two:right", "end:a"]}},
        "probes": {"far": {"body": "two", "at": "right"},
                   "load": {"body": "end", "at": [0.1, 0.0, 0.0]}},
        "loads": GRAVITY, "integrator": ALPHA, "reducer": reducer,
        "time": {"end": end, "step": 1e-3}, "training": {"end": end}}


def test_a_hinge_between_flexible_bodies_turns_about_its_axis_alone() -> None:
    got = march(scene_of(hinged()))
    axes = []
    for name, at in (("one", "right"), ("two", "left")):
        body: Any = got.model.parts[name]
        u = np.zeros(body.X.size)
        u[body.elasticity.free] = got.block(f"{name}.elastic")[-1]
        nodes = body.points[at]
        arm = body.X[nodes] - body.X[nodes].mean(axis=0)
        slip = u.reshape(-1, 3)[nodes] - u.reshape(-1, 3)[nodes].mean(axis=0)
        J = (arm**2).sum() * np.eye(3) - arm.T @ arm
        turn = np.linalg.solve(J, np.cross(arm, slip).sum(axis=0))
        A = rot.rotation(got.block(f"{name}.rigid")[-1][3:])
        d = np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
        axes.append(A @ (d + np.cross(turn, d)))
    cosine = axes[0] @ axes[1] / np.linalg.norm(axes[0]) / np.linalg.norm(axes[1])
    assert cosine == pytest.approx(1.0, abs=1e-9)
    one, two = (rot.rotation(got.block(f"{n}.rigid")[-1][3:]) for n in ("one", "two"))
    assert np.trace(one.T @ two) < 2.995  # they do turn against each other
    textbook = march(scene_of(hinged({"use": "full", "method": "newton"}, 0.02)))
    for name in ("one.rigid", "two.elastic", "B.multiplier"):
        want = textbook.block(name)[-1]
        np.testing.assert_allclose(got.block(name)[20], want, rtol=0,
                                   atol=1e-6 * np.abs(want).max())


@pytest.mark.slow
def test_reduced_runs_repeat_the_run_they_were_trained_on() -> None:
    """Galerkin and DEIM with 20 atoms a bar; probes read the same points."""
    full = simulate(scene_of(hinged()))
    far = full.probe("far")
    assert far.shape[1] == 6 and np.abs(far[-1, :3] - far[0, :3]).max() > 0.01
    for kind in ("galerkin", "deim"):
        run = simulate(scene_of(hinged({"use": kind, "basis": {"use": "pod", "count": 20}})))
        for name in ("one.rigid", "two.rigid", "end.rigid"):
            np.testing.assert_allclose(run.block(name), full.block(name), rtol=0, atol=1e-6)
        np.testing.assert_allclose(run.probe("far"), far, rtol=0, atol=1e-6)


def test_a_reduced_run_starts_with_the_accelerations_of_a_driven_hinge() -> None:
    """The first hinge follows half a sine from the start: its angular acceleration there is not
    zero, and the reduced model must know it (a second-order rule would keep the fault)."""
    scene = hinged(end=0.05)
    scene["joints"]["drive"] = {
        "use": "prescribed_motion", "of": "one:left", "axis": [0, 1, 0],
        "angle": {"use": "sine", "amplitude": 0.05, "frequency": 3.0, "offset": -0.05,
                  "phase": np.pi / 2}}
    full = march(scene_of(scene))
    snapshots = {n: full.block(n).T for n in ("one.elastic", "two.elastic")}
    reduced = march(scene_of({**scene, "reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 20}}}), snapshots=snapshots)
    q1, q2 = (x[0, full.model.layout["one.rigid"]][3:] for x in (reduced.v, reduced.a))
    turn = reduced.block("one.rigid")[0, 3:]
    assert not np.any(q1)
    angular = 2 * rot.to_body(turn) @ q2
    np.testing.assert_allclose(angular, [0.0, -0.05 * (6 * np.pi) ** 2, 0.0], rtol=0, atol=1e-3)
    np.testing.assert_allclose(reduced.block("one.rigid"), full.block("one.rigid"), rtol=0,
                               atol=1e-5)


