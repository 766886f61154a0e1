"""The scene files of docs/examples: what they give at the end, against closed forms or tables."""

from collections.abc import Callable
from math import atan2, degrees
from pathlib import Path

import numpy as np
import pytest

from sparsemor import compare, load, open_result, simulate
from sparsemor.core.analysis.bodies import body_facts
from sparsemor.core.cli import app
from sparsemor.core.model.assembly import assemble
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache

pytestmark = pytest.mark.full

FOLDER = Path(__file__).parents[2] / "docs" / "examples"
Solve = Callable[..., RunResult]


@pytest.fixture
def solve(tmp_path: Path) -> Solve:
    """solve(scene, **overrides by reducer): one run, offline products kept for this test."""
    cache = Cache(tmp_path / "cache")

    def run(scene: Scene, reducer: str | None = None) -> RunResult:
        chosen = scene if reducer is None else scene.using({"reducer": reducer})
        return simulate(chosen, out=tmp_path / f"{reducer}", cache=cache)

    return run


def test_every_scene_is_tested_here() -> None:
    scenes = {p.stem for p in FOLDER.glob("*.yaml")}
    assert scenes == {"rigid_pendulum", "cantilever", "radiating_plate", "slider_crank",
                      "calculix_rod"}


def test_rigid_pendulum_has_the_published_angles(solve: Solve) -> None:
    """BDF1 in (R, theta, lambda), origins at the first bore: the table of independent codes."""
    run = solve(load(FOLDER / "rigid_pendulum.yaml"))
    angles = [degrees(run.block(f"link{i}.rigid")[-1, 2]) for i in (1, 2)]
    np.testing.assert_allclose(angles, (-153.0982, -146.0232), atol=2e-3)
    elbow, tip = run.probe("elbow")[-1], run.probe("tip")[-1]
    np.testing.assert_allclose(degrees(atan2(elbow[1], elbow[0])), angles[0], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*(tip - elbow)[:2]), 1.0, atol=1e-12)


def test_cantilever_bends_as_a_beam(solve: Solve) -> None:
    """F L^3 / (3 E I) = 1.905 mm, of and shear adds 0.4 %: quadratic triangles 20 x 2."""
    scene = load(FOLDER / "cantilever.yaml")
    run, full = solve(scene), solve(scene, "full")
    beam = 1000.0 / (3.0 * 7.0e10 * 0.03 * 0.1**3 / 12.0)
    tip = -run.probe("tip")[-1, 3]
    assert beam < tip < 1.005 * beam
    np.testing.assert_allclose(tip, 1.91278e-3, rtol=1e-5)
    assert run.summary["atoms"] == {"beam.elastic": 5}
    assert compare(reference=full, reduced=run).errors["reduced"]["elastic"] < 1e-8


def test_radiating_plate_balances_its_heat(solve: Solve) -> None:
    """Few of the 60 facets that radiate have weights; the end is that of full order."""
    scene = load(FOLDER / "radiating_plate.yaml")
    run, full = solve(scene), solve(scene, "full")
    touched = run.summary["elements_touched"]["plate.thermal"]
    assert 0 < touched < 30
    assert full.summary["elements_touched"] == {"plate.thermal": 60}
    top, bottom = run.probe("top")[-1, -1], run.probe("bottom")[-1, -1]
    np.testing.assert_allclose((top, bottom), (944.152, 893.506), atol=1e-2)
    assert compare(reference=full, sampled=run).errors["sampled"]["thermal"] < 1e-4
    _check_energy(full)


def _check_energy(run: RunResult) -> None:
    """Heat stored = heat in - heat lost, from surface temperatures by the trapezoidal rule."""
    t, sigma, T_inf, thickness = run.times, 5.670374419e-8, 293.15, 0.01
    T = run.block("plate.thermal")
    points = run.points("plate")
    stored = 7850 * 475 * thickness * _mean(T[-1] - T[0], run) * 0.2 * 0.05
    lost = np.zeros(len(t))
    for axis, value, law in [
            (1, 0.0, lambda x: 50.0 * (x - T_inf)),
            *((a, v, lambda x: 0.9 * sigma * (x**4 - T_inf**4))
              for a, v in ((1, 0.05), (0, 0.0), (0, 0.2)))]:
        on = np.flatnonzero(np.isclose(points[:, axis], value))
        along = points[on, 1 - axis]
        order = np.argsort(along)
        lost += thickness * np.trapezoid(law(T[:, on[order]]), along[order], axis=1)
    given = 1.0e5 * 0.2 * thickness * t[-1]
    np.testing.assert_allclose(given - np.trapezoid(lost, t), stored, rtol=2e-3)


def _mean(values: np.ndarray, run: RunResult) -> float:
    """Mean over the plate of nodal values (N,)."""
    p, cells = run.points("plate"), run.cells("plate")
    a, b, c = (p[cells[:, i]] for i in range(3))
    area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    return float(area @ values[cells].mean(axis=1) / area.sum())


def test_slider_crank_by_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What docs/examples.md says, on the first 40 ms: the motor turns, and reduced as full."""
    assert len((FOLDER / "slider_crank.yaml").read_text().splitlines()) <= 60
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))

    def command(text: str) -> None:
        with pytest.raises(SystemExit) as ended:
            app(text.split())
        assert ended.value.code == 0, capsys.readouterr().err

    out = tmp_path / "out"
    command(f"compare {FOLDER / 'slider_crank.yaml'} --reducers full,galerkin --out {out} "
            "--no-charts --quiet --set time.end=0.04 --set training.end=0.04")
    full, reduced = (open_result(out / name) for name in ("full", "galerkin"))
    assert compare(reference=full, reduced=reduced).errors["reduced"]["elastic"] < 1e-6
    command(f"animate {out / 'galerkin'} --field stress --frames 3 --quiet")
    assert (out / "galerkin" / "animation.gif").read_bytes()[:4] == b"GIF8"
    command(f"pictures {out / 'full'} --fields stress --quiet")
    assert {"stress.png", "joint_forces.png"} <= {
        p.name for p in (out / "full" / "pictures").iterdir()}
    command(f"export {out / 'full'} --fields stress --at 0.04 --quiet")
    # the crank's moments about the hub: torque - r x (force on the pin) = I theta''
    a = full.block("crank.rigid")[:, 2]
    forces = full.joint_forces()["crank_pin"]
    assert full.joint_forces()["return_spring"]["tension", "N"][0] == pytest.approx(-100.0)
    x, y = (forces[f"force {axis}", "N"] for axis in "xy")
    late = full.times > 0.021
    moment = 25.0 - 0.1 * (np.cos(a) * y - np.sin(a) * x)
    rate = np.gradient(np.gradient(a, full.times), full.times)
    np.testing.assert_allclose(4e-3 * rate[late][:-3], moment[late][:-3], atol=0.05)


def test_a_rod_from_calculix_bends_in_a_crank(solve: Solve) -> None:
    """113.9918 Hz: CalculiX 2.20 for the same mesh, clamped at its big end."""
    scene = load(FOLDER / "calculix_rod.yaml")
    first = body_facts(assemble(scene), ["rod"])["rod"].frequencies[0]
    np.testing.assert_allclose(first, 113.9918, rtol=1e-6)
    run, full = solve(scene), solve(scene, "full")
    np.testing.assert_allclose(full.probe("wrist")[-1, 4], 9.031e-5, rtol=1e-3)
    np.testing.assert_allclose(run.probe("wrist")[-1, 4], full.probe("wrist")[-1, 4], rtol=1e-6)
