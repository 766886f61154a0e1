"""The packaged brake disk (scenes.md 3): closed forms of its motion and heat, and its numbers.

The quick tests run a short time on a coarse mesh; the slow one is the scene as packaged.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.model.prescribed_quantities import AtStart
from sparsemor.core.protocols.prescribed_motion import Stage
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache

COARSE: dict[str, Any] = {
    "bodies.disk.mesh.refine": 0.4, "bodies.pad.mesh.refine": 0.6, "time.end": 0.012,
    "training.end": 0.012, "reducer": "full"}
F, MU, W0, J_CAR = 18e3, 0.7, 66.667, 28.125
EFFUSIVITY = {"disk": np.sqrt(44.5 * 7850 * 475), "pad": np.sqrt(8.7 * 2000 * 935)}
GAMMA = EFFUSIVITY["disk"] / sum(EFFUSIVITY.values())
RHO_C = {"disk": 7850 * 475, "pad": 2000 * 935}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def coarse(cache: Cache) -> RunResult:
    """Insulated, so that all heat stays."""
    return simulate(load("brake_disk", COARSE | {"loads.air.film": 1e-9}), cache=cache)


def friction_radius(run: RunResult) -> float:
    """Integral of r over the pad's face by its area: where friction acts, were it one force."""
    points, cells = run.points("pad"), run.cells("pad")
    faces = np.sort(np.concatenate([np.delete(cells, i, axis=1) for i in range(4)]), axis=1)
    facets = np.unique(faces[(points[faces][:, :, 2] < 0.013 + 1e-9).all(axis=1)], axis=0)
    p = points[facets][:, :, :2]
    edges = p[:, 1:] - p[:, :1]
    area = 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    b = np.stack(np.meshgrid(*[np.arange(12)] * 2), -1).reshape(-1, 2)
    b = b[b.sum(axis=1) < 12]
    b = np.column_stack([b + 1 / 3, 12 - b.sum(axis=1) - 2 / 3]) / 12
    r = np.linalg.norm(np.einsum("qi,fid->fqd", b, p), axis=2).mean(axis=1)
    return float((r * area).sum() / area.sum())


def stage_of(run: RunResult) -> Stage:
    stage = run.stage()
    assert stage is not None
    return stage


def stored_heat(run: RunResult, body: str) -> float:
    """J: rho c times the integral of the rise of temperature."""
    corners = run.points(body)[run.cells(body)]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    rise = run.nodal_temperature(body, -1) - 293.15
    return float(RHO_C[body] * volume @ rise[run.cells(body)].mean(axis=1))


def inertia(run: RunResult) -> float:
    """J of car and meshed disk, kg m2."""
    corners = run.points("disk")[run.cells("disk")]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0
    x = corners[:, :, :2]
    second = (x.sum(axis=1) ** 2 + (x**2).sum(axis=1)).sum(axis=1) / 20.0
    return float(J_CAR + 7850 * volume @ second)


@pytest.mark.full
@pytest.mark.parametrize("name", ["brake_disk", "brake_disk_published"])
def test_unknowns_of_the_packaged_scenes(name: str) -> None:
    scene = load(name)
    parts: dict[str, Any] = dict(assemble(scene, AtStart()).parts)
    sizes = {body: (len(parts[body].mesh.cells), len(parts[body].X),
                    len(parts[body].elasticity.free)) for body in ("disk", "pad")}
    assert sizes == {"disk": (10344, 2715, 7018), "pad": (900, 279, 831)}
    assert round(scene.time.end / scene.time.step) == 1200


def test_both_packaged_scenes_are_one_problem() -> None:
    one, other = (load(f"brake_disk{kind}").dump() for kind in ("", "_published"))
    assert {key for key in one if one[key] != other[key]} == {"title", "reducer"}


@pytest.mark.full
def test_the_pad_is_pressed_in_at_once(coarse: RunResult) -> None:
    """Critical damping of the foundation (about 20 us) is far below the step: the first step
    already carries all but the inertia of 46 g that come to rest."""
    normal = stage_of(coarse).contacts["brake"]["normal"]
    assert normal[0] == 0.0
    assert abs(normal[1] / F - 1) < 1e-4
    np.testing.assert_allclose(normal[4:], F, rtol=1e-6)
    sunk = -stage_of(coarse).frames["pad"].pose[-1, 2]
    area = stage_of(coarse).contacts["brake"]["area"][-1]
    assert sunk == pytest.approx(F / (3.1e11 * area), rel=1e-6)
    assert stage_of(coarse).contacts["brake"]["pressure"][-1] == pytest.approx(F / area, rel=1e-6)


@pytest.mark.full
def test_the_disk_slows_down_as_friction_says(coarse: RunResult) -> None:
    """w' = -mu F r_m / J while it slips: BDF1 has it exactly, and the angle by its sum."""
    turned, h = stage_of(coarse).frames["disk"], 1e-3
    slowing = MU * F * friction_radius(coarse) / inertia(coarse)
    w = turned.rate[:, 3]
    np.testing.assert_allclose(np.diff(w)[2:], -slowing * h, rtol=1e-3)
    n = len(w) - 1
    assert w[-1] == pytest.approx(W0 - slowing * n * h, rel=1e-5)
    assert turned.pose[-1, 3] == pytest.approx(
        n * h * W0 - slowing * h * h * n * (n + 1) / 2, rel=1e-5)
    assert stage_of(coarse).frames["car"].rate[-1, 3] == pytest.approx(w[-1], rel=1e-12)
    np.testing.assert_allclose(turned.pose[:, :3], 0.0, atol=1e-12)
    np.testing.assert_allclose(stage_of(coarse).frames["pad"].pose[:, 3:] - [1.0, 0, 0, 0], 0.0,
                               atol=1e-12)


@pytest.mark.full
def test_the_caliper_takes_friction_and_its_moment(coarse: RunResult) -> None:
    """Two forces across the axis, of size mu F; along it nothing is held."""
    force = stage_of(coarse).reactions["caliper"][-1]
    contact = stage_of(coarse).contacts["brake"]
    assert np.hypot(*force[:2]) == pytest.approx(contact["friction"][-1], rel=1e-9)
    assert contact["friction"][-1] < MU * F  # directions differ over the pad
    assert contact["friction"][-1] == pytest.approx(MU * F, rel=0.03)


@pytest.mark.full
def test_heat_balance(coarse: RunResult) -> None:
    """The friction work, shared by effusivity: gamma mu F r_m times the angle, in step ends."""
    h, n = 1e-3, len(coarse.times) - 1
    w = stage_of(coarse).frames["disk"].rate[1:, 3]
    work = MU * F * friction_radius(coarse) * h * float(w.sum())
    power = stage_of(coarse).contacts["brake"]["power"]
    assert h * float(power[1:].sum()) == pytest.approx(work, rel=1e-3)
    for body, share in (("disk", GAMMA), ("pad", 1 - GAMMA)):
        assert stored_heat(coarse, body) == pytest.approx(share * h * power[1:].sum(), rel=1e-7)
    assert n == 12


def test_one_override_makes_the_mesh_coarser() -> None:
    """The load stays: it is a force, not a pressure on an area that the mesh decides."""
    body: Any = load("brake_disk", {"bodies.disk.mesh.refine": 0.5}).bodies["disk"]

    mesh = body.mesh.build(Path())
    assert len(mesh.cells) == pytest.approx(10344 * 0.5**3, rel=0.1)
    assert len(outer_facets(mesh)) > 0


def probes(run: RunResult, k: int = -1) -> tuple[FloatArray, FloatArray]:
    """Temperature, K, and size of the displacement, m, from the inner probe to the outer one."""
    rows = [run.probe(p)[k] for p in ("inner", "second", "third", "outer")]
    return (np.array([r[-1] for r in rows]),
            np.array([np.linalg.norm(r[3:6]) for r in rows]))


@pytest.mark.slow
def test_the_scene_as_packaged(cache: Cache) -> None:
    run = simulate(load("brake_disk", {"reducer": "full"}), cache=cache)
    disk = stage_of(run).frames["disk"]
    assert disk.rate[-1, 3] == pytest.approx(5.36, abs=0.02)
    assert disk.pose[-1, 3] == pytest.approx(43.22, abs=0.05)
    assert run.block("disk.thermal", slice(-1, None)).max() == pytest.approx(427, abs=6)
    power = stage_of(run).contacts["brake"]["power"]
    assert GAMMA * 1e-3 * power[1:].sum() == pytest.approx(47.4e3, abs=0.2e3)
    temperature, size = probes(run)
    assert np.all(np.diff(size) > 0)
    assert size[-1] > 2 * size[0]
    assert temperature[1] > temperature[0] < temperature[2] > temperature[3]
