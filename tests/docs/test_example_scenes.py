"""The scene files of docs/examples: what they give at the end, against closed forms or tables."""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from math import atan2, degrees
from pathlib import Path

import numpy as np
import pytest

import analysed
from sparsemor import compare, load, open_result, reduce, simulate
from sparsemor import solve as analyse
from sparsemor.core.cli import app
from sparsemor.core.model.assembly import assemble
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.plugins.commands.body_summary import body_facts
from sparsemor.plugins.export.fmu import export_fmu

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
                      "calculix_rod", "engine", "gearbox_shaft", "cooled_brake", "robot_arm",
                      "blade", "circuit_board"}


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


@pytest.mark.slow
def test_an_engine_with_a_rod_of_a_step_file(solve: Solve) -> None:
    """Mass of the geometry, path of rigid bodies x = r cos a + sqrt(l^2 - r^2 sin^2 a)."""
    pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # type: ignore[arg-type]
    text = FOLDER / "engine.yaml"
    assert len(text.read_text(encoding="utf-8").splitlines()) <= 40
    scene = load(text)
    mass = body_facts(assemble(scene), ["rod"])["rod"].mass
    assert mass == pytest.approx(7850 * 67264.942e-9, rel=1e-4)  # conrod_step.py
    run = solve(scene)
    a = 300.0 * run.times
    path = 0.045 * np.cos(a) + np.sqrt(0.14**2 - (0.045 * np.sin(a)) ** 2)
    assert np.abs(run.block("piston.rigid")[:, 0] - path).max() < 2e-5
    largest = max(float(run.von_mises("rod", step).max()) for step in range(0, 211, 10))
    assert largest == pytest.approx(33.2e6, rel=2e-2)


@pytest.mark.slow
def test_a_warm_shaft_on_two_bearings(tmp_path: Path) -> None:
    """Bearing forces by the law of the lever, elongation by the mean temperature."""
    scene = load(FOLDER / "gearbox_shaft.yaml")
    warm = analyse(scene, "steady_heat", out=tmp_path / "warm")
    T = [analysed.value(warm, f"shaft: {which} temperature") for which in ("lowest", "highest")]
    np.testing.assert_allclose(T, (316.74, 347.25), atol=0.02)
    loaded = analyse(scene.using({"initial.result": str(tmp_path / "warm")}), "static")
    carried = analysed.value(loaded, "bearing_left.force_y")
    assert carried == pytest.approx(2000.0 * 190 / 280, rel=1e-3)
    ends = [analysed.value(loaded, f"bearing_{side}.first.rigid.z") for side in ("left", "right")]
    result = warm.result
    z, heat = result.points("shaft")[:, 2], result.nodal_temperature("shaft", 0)
    levels = np.unique(np.round(z, 6))
    means = [heat[np.abs(z - level) < 1e-6].mean() for level in levels]
    within = (levels > 0.0099) & (levels < 0.2901)
    longer = 1.2e-5 * np.trapezoid(np.array(means)[within] - 293.15, levels[within])
    assert ends[1] - ends[0] - 0.28 == pytest.approx(longer, rel=0.03)


def test_a_brake_stops_a_car_five_times(solve: Solve) -> None:
    """Highest surface temperatures of the first and of the fifth stop; reduced as full."""
    run, full = (solve(load(FOLDER / "cooled_brake.yaml"), r) for r in (None, "full"))
    T = run.probe("face")[:, -1]
    peaks = [T[(run.times >= 60 * i) & (run.times < 60 * i + 60)].max() for i in (0, 4)]
    np.testing.assert_allclose(peaks, (403.4, 564.6), atol=0.2)
    assert compare(reference=full, reduced=run).errors["reduced"]["thermal"] < 1e-4
    assert run.summary["notes"] == []


def test_a_blade_stiffens_as_it_turns() -> None:
    """Southwell: f^2 = f_0^2 + 1.193 (spin / 2 pi)^2 out of the plane of rotation."""
    scene = load(FOLDER / "blade.yaml")
    rest = analyse(scene, "frequencies", count=1).column("frequency_hz")[0]
    fast = analyse(scene, "frequencies", count=1, spin=True).column("frequency_hz")[0]
    np.testing.assert_allclose([rest, fast], (39.476, 79.476), rtol=1e-3)
    assert fast == pytest.approx(np.sqrt(rest**2 + 1.193 * (400 / 2 / np.pi) ** 2), rel=1e-2)


@pytest.mark.slow
def test_a_circuit_board_loses_the_heat_of_its_parts(solve: Solve) -> None:
    scene = load(FOLDER / "circuit_board.yaml")
    run = solve(scene)
    assert run.probe("processor")[-1, -1] == pytest.approx(334.08, abs=0.02)
    assert run.summary["elements_touched"]["board.thermal"] < 200
    steady = analyse(scene.using({"reducer": "full"}), "steady_heat")
    assert analysed.value(steady, "processor.temperature") == pytest.approx(334.09, abs=0.02)
    T, points = steady.result.nodal_temperature("board", 0), steady.result.points("board")
    lost, area = 0.0, 0.1 * 0.08 / (50 * 40)
    for z in (0.0, 0.0016):  # both sides, by the rule of trapezoids
        on = np.isclose(points[:, 2], z)
        edge = [np.isclose(points[on, i], 0.0) | np.isclose(points[on, i], size)
                for i, size in ((0, 0.1), (1, 0.08))]
        share = area * 0.5 ** (edge[0].astype(int) + edge[1])
        air = 8.0 * (T[on] - 298.15) + 0.85 * 5.670374419e-8 * (T[on] ** 4 - 298.15**4)
        lost += float(share @ air)
    assert lost == pytest.approx(4.5, rel=1e-3)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler, which an FMU needs")
def test_a_robot_arm_reaches_its_goal(tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    model = reduce(load(FOLDER / "robot_arm.yaml"))
    export_fmu(model, tmp_path / "arm.fmu")
    done = subprocess.run(
        [sys.executable, FOLDER / "robot_arm.py", "arm.fmu", "arm.png"], cwd=tmp_path, check=True,
        capture_output=True, text=True)
    x, y, torque = (float(found) for found in re.findall(
        r"grip at ([\d.]+), ([\d.]+) mm.*torque ([\d.]+)", done.stdout)[0])
    np.testing.assert_allclose((x, y, torque), (301.03, 799.98, 21.43), atol=0.02)
    assert (tmp_path / "arm.png").stat().st_size > 10_000
